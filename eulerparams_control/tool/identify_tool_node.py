"""The node ``identify_tool``: the tool, and the bias of the sensor, from a few poses at rest.

It listens only: whoever moves the arm lets it rest in one orientation after the other.
"""

import math
import sys
from pathlib import Path

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import (
    ConfigurationError,
    EulerParamsError,
    IdentificationError,
    InvalidMessageError,
    UnknownNameError,
)
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import JointStateReader, ns_from_ros, wrench_from_ros
from eulerparams_control.messages.keys import WorkMode
from eulerparams_control.robot.urdf import UrdfTree
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.qos import QOS, QOS_LATCHED, overridable
from eulerparams_control.ros.runtime import run
from eulerparams_control.tool.identification import LEAST_SPREAD, Identification, identify, spread
from eulerparams_control.tool.mount import SensorMount
from eulerparams_control.tool.parameters import IdentifyToolParameters
from eulerparams_control.tool.poses import Pose, PoseCollector
from eulerparams_control.tool.report import ToolReport

# Silence [s] after which a topic is said to be silent.
_SILENCE = 2.0


class IdentifyToolNode(Node):
    """Takes poses until there are enough; what they say is for ``finish``."""

    parameters_type = IdentifyToolParameters

    def __init__(self) -> None:
        super().__init__("identify_tool")
        self.done = False
        self._health = diagnostics.Health(self)
        self._params = declare(self, self.parameters_type)
        self._params.check()
        self._urdf: UrdfTree | None = None
        self._description = ""
        self._mount: SensorMount | None = None
        self._collector: PoseCollector | None = None
        self._refused = ""  # the last wrench or joint_states that could not be used
        self._started = steady.now()
        self._received = {"joint_states": self._started, "wrench": self._started}
        self._health.check = self._check_time
        self._health.values["poses"] = 0
        self._health.set(diagnostics.OK, "waiting for a robot description", mode=WorkMode.WAITING)
        self._subscribe()

    # --- set-up ------------------------------------------------------------------------

    def _subscribe(self) -> None:
        for kind, topic, callback in (
            (JointState, "joint_states", self._on_joint_states),
            (WrenchStamped, "wrench", self._on_wrench),
        ):
            self.create_subscription(kind, topic, callback, **overridable(QOS))
        if self._params.robot_description:
            self._set_description(self._params.robot_description)
        else:
            self.create_subscription(
                String,
                "robot_description",
                self._on_robot_description,
                **overridable(QOS_LATCHED),
            )

    def _on_robot_description(self, msg: String) -> None:
        if self._mount is None:
            self._set_description(msg.data)

    def _set_description(self, urdf: str) -> None:
        tree = UrdfTree(urdf)
        tree.link(self._params.tip_frame, "tip_frame")
        self._description, self._urdf = urdf, tree
        text = "waiting for the first wrench, which names its frame"
        self._health.set(diagnostics.OK, text, mode=WorkMode.WAITING)

    def _set_sensor(self, frame: str) -> None:
        """Begin to take poses with the sensor in ``frame``; raises InvalidMessageError."""
        assert self._urdf is not None
        p = self._params
        if frame not in self._urdf.links:
            error = UnknownNameError("frame", frame, self._urdf.links)
            raise InvalidMessageError(f"its frame is no link of the robot description: {error}")
        mount = SensorMount(self._description, frame, p.tip_frame, p.joints)
        self._reader = JointStateReader(mount.joints)
        self._collector = PoseCollector(p.pose_options(), mount.orientation, np.array(p.gravity))
        self._mount = mount
        self._health.set(
            diagnostics.OK,
            f"the sensor is at {frame}; let the arm rest in {p.poses} orientations, each tilted by "
            f"{math.degrees(p.min_angle):.0f} deg or more from the others, free of contact",
            mode=WorkMode.WORKING,
        )

    # --- messages ----------------------------------------------------------------------

    def _on_joint_states(self, msg: JointState) -> None:
        self._received["joint_states"] = steady.now()
        if self._collector is None or self.done or not self._reader.concerns(msg):
            return
        try:
            event = self._collector.move(*self._reader.from_ros(msg))
        except InvalidMessageError as error:
            self._reject("joint_states", error)
            return
        if isinstance(event, Pose):
            self._on_pose(event)
        elif event:
            self._health.complain(event)

    def _on_wrench(self, msg: WrenchStamped) -> None:
        self._received["wrench"] = steady.now()
        if self._urdf is None or self.done:
            return
        try:
            if self._collector is None:
                self._set_sensor(msg.header.frame_id)
            assert self._collector is not None
            assert self._mount is not None
            wrench = self._params.wrench_sign * wrench_from_ros(msg, self._mount.frame)
            self._collector.feel(ns_from_ros(msg.header.stamp), wrench)
        except InvalidMessageError as error:
            self._reject("wrench", error)

    def _reject(self, topic: str, error: InvalidMessageError) -> None:
        self._refused = f"{topic} rejected: {error}"
        self._health.reject(topic, error)

    def _on_pose(self, pose: Pose) -> None:
        """Say what was taken; end when it is enough."""
        assert self._collector is not None
        wanted, taken = self._params.poses, len(self._collector.poses)
        different = spread(self._collector.directions) >= LEAST_SPREAD
        self.done = taken >= wanted and different
        self._refused = ""
        self._health.values["poses"] = taken
        text = f"pose {taken} of {wanted} taken: {pose.samples} wrenches, {_force(pose.wrench)}"
        if different:
            text += f"; {self._so_far()}"
        elif taken >= wanted:
            text += "; the poses are too similar, one more is needed: tilt about another axis"
        mode = WorkMode.DONE if self.done else WorkMode.WORKING
        self._health.set(diagnostics.OK, text, mode=mode)

    def _so_far(self) -> str:
        try:
            return f"so far {self._identify().mass:.3f} kg"
        except IdentificationError as error:
            return f"so far {error}"

    def _identify(self) -> Identification:
        poses = self._collector.poses if self._collector is not None else []
        return identify(
            [pose.R_s for pose in poses], [pose.wrench for pose in poses], self._params.gravity
        )

    # --- time --------------------------------------------------------------------------

    def _check_time(self) -> None:
        """Say that a topic is silent; give up after the timeout."""
        now = steady.now()
        for topic, received in self._received.items():
            if now - received > _SILENCE:
                self._health.complain(f"no {topic} within {_SILENCE:g} s", about=topic)
        if 0 < self._params.timeout < now - self._started:
            taken = len(self._collector.poses) if self._collector is not None else 0
            raise IdentificationError(
                f"gave up after {self._params.timeout:g} s with {taken} of {self._params.poses} "
                f"poses, {self._waiting()}"
            )

    def _waiting(self) -> str:
        """Return what it waits for."""
        if self._refused:
            return self._refused
        if self._urdf is None:
            return "waiting for the topic robot_description"
        if self._collector is None:
            return "waiting for the topic wrench"
        return self._collector.doing

    # --- the end -----------------------------------------------------------------------

    def finish(self) -> int:
        """Print, and write, what the poses taken say; return the exit code."""
        try:
            self._finish()
        except EulerParamsError as error:
            print(f"error: {error}", file=sys.stderr, flush=True)
            return 1
        return 0

    def _finish(self) -> None:
        found = self._identify()
        assert self._collector is not None
        assert self._mount is not None
        p = self._params
        report = ToolReport(
            found,
            self._collector.poses,
            self._mount,
            p.wrench_sign,
            p.max_residual_force,
            p.max_residual_torque,
        )
        print(report.table())
        for warning in report.warnings():
            print(f"warning: {warning}")
        print(f"\n{report.yaml()}", flush=True)
        if p.output:
            _write(Path(p.output), report.yaml())
            print(f"written to {p.output}", flush=True)


def _force(wrench: Array) -> str:
    return f"{float(np.linalg.norm(wrench[:3])):.2f} N"


def _write(path: Path, text: str) -> None:
    """Write a new file; raises ConfigurationError, also if it has come to exist meanwhile."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise ConfigurationError(
            f"output: cannot write {path}: {error.strerror}; the result is printed above"
        ) from error


def main(args: list[str] | None = None) -> int:
    """Run the node; then, without ROS, compute and print."""
    made: list[IdentifyToolNode] = []

    def make() -> IdentifyToolNode:
        made.append(IdentifyToolNode())
        return made[0]

    code = run(make, args, tells=False, about=IdentifyToolNode)
    return code or sum(node.finish() for node in made)


if __name__ == "__main__":
    sys.exit(main())
