"""What the nodes that the page shows say on /diagnostics."""

import math
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from eulerparams_control.control.clock import steady
from eulerparams_control.control.mode import Mode
from eulerparams_control.live.page import Notices
from eulerparams_control.messages.keys import MODE

BRIDGE = "pybullet_bridge"

_LONG = 5.0  # [s] without a word of the simulated robot, after which there is none
_STOPPED = Mode.STOPPED, Mode.RELEASING
_TARGETS = "target_pose", "target_twist", "external_wrench"


@dataclass
class NodeReport:
    """The last report of a node.

    Attributes:
        level: 0 well, 1 a warning, 2 an error.
        message: in words.
        values: by key.
        came: when, steady clock [s].
        refused: how many messages of a page; None before the first report.
    """

    level: int = 0
    message: str = ""
    values: dict[str, str] = field(default_factory=dict)
    came: float = -math.inf
    refused: int | None = None

    @property
    def mode(self) -> str:
        """What the node does."""
        return self.values.get(MODE, "")


class NodeReports:
    """The reports of a controller and of the simulated robot.

    Args:
        node: that listens.
        controller: its name.
        notices: say what a node refused.

    Attributes:
        of_controller, of_robot: the last ones.
        stops: how often the arm has stopped.
    """

    def __init__(self, node: Node, controller: str, notices: Notices) -> None:
        self._notices, self._prefix = notices, node.get_namespace().strip("/")
        self.of_controller, self.of_robot, self.stops = NodeReport(), NodeReport(), 0
        self._reports = {controller: self.of_controller, BRIDGE: self.of_robot}
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            prefix, _, name = status.name.rpartition("/")
            if prefix == self._prefix and name in self._reports:
                self._notices.guarded("A status cannot be read", self._take, name, status)

    def _take(self, name: str, status: DiagnosticStatus) -> None:
        report = self._reports[name]
        before, values = report.mode, {entry.key: entry.value for entry in status.values}
        report.level, report.message, report.values = status.level[0], status.message, values
        if report is self.of_controller and report.mode in _STOPPED and before not in _STOPPED:
            self.stops += 1
        report.came = steady.now()
        refused = sum(int(values.get(f"{topic} rejected", 0)) for topic in _TARGETS)
        if report.refused is not None and refused > report.refused:
            self._notices.show("Not taken", values.get("last rejected", ""))
        report.refused = refused

    def is_simulated(self, now: float) -> bool:
        """Return whether the robot is simulated, ``now`` [s] on the steady clock."""
        return now - self.of_robot.came < _LONG
