"""The joint command as a message: the types that ros2_control's controllers take."""

from collections.abc import Callable, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectory

from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.messages.to_ros import (
    duration_to_ros,
    frame_to_ros,
    motion_to_ros,
    numbers_to_ros,
)
from eulerparams_control.motion.frames import AT_ORIGIN, DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.ros.qos import QOS_STREAM

# How far ahead [s] the point of a joint_trajectory is.
HORIZON = 0.02

Fill = Callable[[Any, Time, JointCommand], bool]
"""Writes a command into a message; False: the command has nothing for it."""


class CommandPublisher:
    """Publishes commands on one topic, and the compliant frame that they follow on its own.

    ``joint_state``       sensor_msgs/JointState: what the scheme commands.
    ``joint_trajectory``  trajectory_msgs/JointTrajectory of one point, ``HORIZON`` ahead.
    ``forward``           std_msgs/Float64MultiArray: efforts, else positions.
    ``none``              nothing: the compliant frame is the command.

    Args:
        node: the node that publishes.
        topic: where.
        kind: one of these types.
        joints: names of the joints, in the order of the commands.
        frames: base and tip of the compliant frame; None: it is not published.

    Attributes:
        publisher: of the commands.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        kind: str,
        joints: Sequence[str],
        frames: tuple[str, str] | None = None,
    ) -> None:
        self._node = node
        # joint_trajectory_controller refuses a trajectory that ends in the past or with a
        # velocity: its stamp stays 0, which is now, and its point has a position only
        point = JointTrajectoryPoint(time_from_start=duration_to_ros(HORIZON))
        kinds: dict[str, tuple[Any, Fill]] = {
            "joint_state": (JointState(name=list(joints)), _fill_states),
            "joint_trajectory": (
                JointTrajectory(joint_names=list(joints), points=[point]),
                _fill_trajectory,
            ),
            "forward": (Float64MultiArray(), _fill_numbers),
        }
        outputs = {topic: kinds[kind]} if kind in kinds else {}
        if frames is not None:
            start = Trajectory([0.0], [DesiredFrame(AT_ORIGIN.p, AT_ORIGIN.R)])
            outputs["compliant_frame"] = motion_to_ros(start, *frames), _fill_frame
        self._outputs = [
            (node.create_publisher(type(message), name, QOS_STREAM), message, fill)
            for name, (message, fill) in outputs.items()
        ]
        self.publisher = self._outputs[0][0]

    def publish(self, stamp: Time, command: JointCommand) -> None:
        """Publish a command under the stamp of the joint_states that it answers."""
        for publisher, message, fill in self._outputs:
            if fill(message, stamp, command):
                publisher.publish(message)

    def destroy(self) -> None:
        """Take the publishers off the graph."""
        for publisher, *_ in self._outputs:
            self._node.destroy_publisher(publisher)


def _fill_states(msg: JointState, stamp: Time, command: JointCommand) -> bool:
    q, dq, effort, _ = command
    msg.header.stamp = stamp
    msg.position, msg.velocity, msg.effort = map(numbers_to_ros, (q, dq, effort))
    return not (q is None and dq is None and effort is None)


def _fill_trajectory(msg: JointTrajectory, _stamp: Time, command: JointCommand) -> bool:
    if command.q is None or command.dq is None:
        return False
    msg.points[0].positions = numbers_to_ros(command.q + HORIZON * command.dq)
    return True


def _fill_numbers(msg: Float64MultiArray, _stamp: Time, command: JointCommand) -> bool:
    numbers = command.q if command.effort is None else command.effort
    msg.data = numbers_to_ros(numbers)
    return numbers is not None


def _fill_frame(msg: MultiDOFJointTrajectory, stamp: Time, command: JointCommand) -> bool:
    if command.frame is None:
        return False
    msg.header.stamp = stamp
    frame_to_ros(command.frame, msg.points[0])
    return True


class ImpedancePublisher[T]:
    """Publishes on ``~/impedance`` what acts, after the commands.

    It comes with each command while it changes, else once a second, where somebody listens.

    Args:
        node: the node that publishes.
        to_ros: makes the message of what acts, with a stamp.
    """

    def __init__(self, node: Node, to_ros: Callable[[T, Time], JointState]) -> None:
        self._to_ros = to_ros
        self._publisher = node.create_publisher(JointState, "~/impedance", QOS_STREAM)
        self._shown: tuple[T | None, int] = None, 0  # and when [s]

    def show(self, stamp: Time, acting: T | None) -> None:
        """Publish what acts, the same object while nothing changes; None: nothing does."""
        before, at = self._shown
        if acting is None or (acting is before and stamp.sec == at):
            return
        if self._publisher.get_subscription_count():
            self._shown = acting, stamp.sec
            self._publisher.publish(self._to_ros(acting, stamp))
