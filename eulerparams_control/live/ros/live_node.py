"""The node ``live``: between the open pages and the nodes that they show and command.

All is done by the thread of the executor, 30 times a second; the pages leave their orders at the
desk.  What the robot says 1000 times a second is read when it is shown.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import String

from eulerparams_control.control.clock import steady
from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import EulerParamsError
from eulerparams_control.events import Event, tell
from eulerparams_control.live.desk import Deed, Order
from eulerparams_control.live.page import Notices, serve, stop
from eulerparams_control.live.panel import LivePanel
from eulerparams_control.live.ros.exchange import Exchange
from eulerparams_control.live.ros.pilot import Pilot
from eulerparams_control.live.ros.reports import BRIDGE, NodeReports
from eulerparams_control.live.ros.seen_arm import SeenArm
from eulerparams_control.live.scene import Scene
from eulerparams_control.live.view import View
from eulerparams_control.messages.keys import CAUSE, REMEDY
from eulerparams_control.parameters.fields import fields_of
from eulerparams_control.parameters.schemes import SchemeInfo
from eulerparams_control.robot.catalogue import RobotDescription
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.qos import QOS_LATCHED

_HZ = 30.0
_SILENT = 0.6  # [s] without what comes often, after which that is said
_QUIET = 1.6  # [s] the same, of what comes once a second
_OFTEN = 2.0  # [Hz] of what tells within _SILENT that its sender is gone


class LiveNode(Node):
    """Serves the pages of one controller.

    Args:
        host, port: of the server.
        scheme: of the controller.
        robot: if it is known; else it comes from robot_description.
        start: called once the pages are served; returns what tells, in words, which of the
            processes that it started has ended.

    Raises:
        EulerParamsError: if the pages cannot be served, or nothing be started.
    """

    def __init__(
        self,
        host: str,
        port: int,
        scheme: SchemeInfo,
        robot: RobotDescription | None = None,
        start: Callable[["LiveNode"], Callable[[], str]] = lambda _: str,
    ) -> None:
        super().__init__("live")
        self.done = False
        self._name, self._began, self._turned = scheme.name, steady.now(), -math.inf
        self._server = serve(host, port)
        self._notices = Notices(self._server, self.get_logger().error)
        self._exchange = Exchange(
            self,
            scheme.name,
            list(fields_of(scheme.parameters)),
            {Deed.HALT: scheme.name, Deed.RESUME: scheme.name, "unlock": BRIDGE},
            self._notices.show,
            self._notices.alarm,
        )
        self._arm = SeenArm(self, scheme, self._exchange, self._notices)
        self._reports = NodeReports(self, scheme.name, self._notices)
        self._pilot = Pilot(self, self._exchange, self._arm, self._reports, self._notices)
        self.create_subscription(String, "robot_description", self._on_description, QOS_LATCHED)
        desk = self._pilot.desk
        self._panel = LivePanel(self._server, scheme, "eulerparams_control", desk.put)
        self._urdf, self._built = "", ("", "", "")
        self._undrawn = "No robot_description has come: nothing is drawn."
        if robot is not None:
            self._urdf = robot.urdf
            self._build(robot.base_frame, robot.tip_frame)
        self._ended = start(self)
        self._server.on_client_connect(self._on_page)
        self._server.on_client_disconnect(
            lambda client: desk.put(Order(client.client_id + 1, Deed.LEFT))
        )
        self.create_timer(1 / _HZ, self._turn, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.url = f"http://{host}:{self._server.get_port()}"
        print(f"The page is at {self.url} (dark: {self.url}/?darkMode)", flush=True)
        tell(Event.READY, url=self.url)

    def close(self) -> None:
        """End jog and push, and the pages."""
        try:
            self._pilot.close()
        finally:
            stop(self._server)

    def _on_description(self, msg: String) -> None:
        self._urdf = msg.data

    def _build(self, base: str, tip: str) -> None:
        """Draw the robot, if it is another one than before."""
        if not self._urdf or self._built == (self._urdf, base, tip):
            return
        self._built = self._urdf, base, tip
        self._undrawn = "The robot cannot be drawn."
        self._arm.expect(None)
        self._pilot.scene = None
        self._pilot.let_go(steady.now())
        self._server.scene.reset()
        try:
            robot = Robot(self._urdf, base, tip)
            scene = Scene(self._server, robot, self._urdf, self._pilot.drag)
        except (EulerParamsError, OSError, ValueError) as error:
            self._undrawn = f"The robot cannot be drawn: {error}"
        else:
            self._undrawn = ""
            self._arm.expect(robot)
            self._pilot.scene = scene
            for client in self._server.get_clients().values():
                scene.show_to(client.camera)

    def _on_page(self, client: Any) -> None:
        if (scene := self._pilot.scene) is not None:  # it may be drawn again meanwhile
            scene.show_to(client.camera)

    def _turn(self) -> None:
        now = steady.now()
        self._pilot.turn(now)
        self._notices.guarded("No answer", self._exchange.hear, self._turned)
        self._notices.guarded("Not set", self._exchange.turn, now)
        self._notices.guarded("Not drawn", self._show, now)
        self._notices.guarded("Not sent", self._pilot.send, now)
        self._turned = now

    def _show(self, now: float) -> None:
        if p := self._exchange.values:
            self._build(str(p["base_frame"] or ""), str(p["tip_frame"] or ""))
        view, scene = self._look(now), self._pilot.scene
        self._panel.update(view)
        if scene is not None:
            if scene.dragged_by != self._pilot.desk.owner:
                scene.dragged_by = None
            scene.update(view)

    def _look(self, now: float) -> View:
        """Gather what is known."""
        controller, robot = self._reports.of_controller, self._reports.of_robot
        view, takes = self._arm.look(), self.count_subscribers("external_wrench") > 0
        return replace(
            view,
            mode=controller.mode,
            cause=controller.values.get(CAUSE, ""),
            level=controller.level,
            message=controller.message,
            remedy=controller.values.get(REMEDY, ""),
            robot=f"{robot.message}. {robot.values.get(REMEDY, '')}" if robot.level else "",
            trouble=self._what_is_wrong(now),
            parameters=self._exchange.values,
            is_simulated=self._reports.is_simulated(now),
            can_push=takes and view.force is not None,
            owner=self._pilot.desk.owner,
            pages=len(self._server.get_clients()),
        )

    def _what_is_wrong(self, now: float) -> str:
        """Return which node is gone or silent, in words; "" if none is."""
        if ended := self._ended():
            return ended
        controller, states = self._reports.of_controller, self._arm.states
        silence = now - max(states.came, self._began)
        if silence > _SILENT:
            what = "none has come yet" if states.came < 0 else f"for {silence:.0f} s"
            return f"No joint_states, {what}: does the robot run?"
        often = controller.mode in (Mode.HOLDING, Mode.FOLLOWING) and (
            self._exchange.values.get("state_rate", 0.0) >= _OFTEN
        )
        silence = now - max(controller.came, self._arm.pose.came, self._began)
        if silence > (_SILENT if often else _QUIET):
            name = self._name
            return f"{name} is silent for {silence:.0f} s: has it ended? Nothing commands the arm."
        return self._undrawn
