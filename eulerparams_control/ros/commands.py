"""The joint command as a message: the types that ros2_control's controllers take."""

from collections.abc import Callable, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import QoSProfile
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


class CommandPublisher:
    """Publishes commands of one type on one topic.

    ``joint_state``       sensor_msgs/JointState: what the scheme commands.
    ``joint_trajectory``  trajectory_msgs/JointTrajectory of one point, ``HORIZON`` ahead.
    ``forward``           std_msgs/Float64MultiArray: efforts, else positions.

    Args:
        node: the node that publishes.
        topic: where.
        kind: one of these types.
        joints: names of the joints, in the order of the commands.
        qos: of the publisher.
    """

    def __init__(
        self, node: Node, topic: str, kind: str, joints: Sequence[str], qos: QoSProfile
    ) -> None:
        self._node, self._kind = node, kind
        # joint_trajectory_controller refuses a trajectory that ends in the past or with a
        # velocity: its stamp stays 0, which is now, and its point has a position only
        self._point = JointTrajectoryPoint(time_from_start=duration_to_ros(HORIZON))
        self._message: Any = {
            "joint_state": JointState(name=list(joints)),
            "joint_trajectory": JointTrajectory(joint_names=list(joints), points=[self._point]),
            "forward": Float64MultiArray(),
        }[kind]
        self._publisher = node.create_publisher(type(self._message), topic, qos)

    def publish(self, stamp: Time, command: JointCommand) -> None:
        """Publish a command under the stamp of the joint_states that it answers."""
        if self._fill(stamp, command):
            self._publisher.publish(self._message)

    def _fill(self, stamp: Time, command: JointCommand) -> bool:
        """Write a command into the message; return False if it has nothing for it."""
        (q, dq, effort, _), msg = command, self._message
        if self._kind == "joint_trajectory":
            if q is None or dq is None:
                return False
            self._point.positions = numbers_to_ros(q + HORIZON * dq)
        elif self._kind == "forward":
            if q is None and effort is None:
                return False
            msg.data = numbers_to_ros(q if effort is None else effort)
        else:
            if q is None and dq is None and effort is None:
                return False
            msg.header.stamp = stamp
            msg.position, msg.velocity, msg.effort = map(numbers_to_ros, (q, dq, effort))
        return True

    @property
    def topic(self) -> str:
        """The topic."""
        return str(self._publisher.topic_name)

    def count_subscribers(self) -> int:
        """Return how many listen."""
        return int(self._publisher.get_subscription_count())

    def destroy(self) -> None:
        """Take the publisher off the graph."""
        self._node.destroy_publisher(self._publisher)


class ComplianceCommands:
    """Publishes the efforts, then the compliant frame that they follow.

    Args:
        node: the node that publishes.
        base_frame, tip_frame: that the compliant frame is stated with.
        efforts: publisher of the efforts; None: the compliant frame is the command.
    """

    def __init__(
        self, node: Node, base_frame: str, tip_frame: str, efforts: "Commands | None"
    ) -> None:
        self._node, self._efforts = node, efforts
        start = Trajectory([0.0], [DesiredFrame(AT_ORIGIN.p, AT_ORIGIN.R)])
        self._message = motion_to_ros(start, base_frame, tip_frame)
        self._publisher = node.create_publisher(
            MultiDOFJointTrajectory, "compliant_frame", QOS_STREAM
        )

    def publish(self, stamp: Time, command: JointCommand) -> None:
        """Publish both under the stamp of the joint_states that they answer."""
        if self._efforts is not None:
            self._efforts.publish(stamp, command)
        if command.frame is not None:
            self._message.header.stamp = stamp
            frame_to_ros(command.frame, self._message.points[0])
            self._publisher.publish(self._message)

    @property
    def topic(self) -> str:
        """The topic of the efforts, or of the compliant frame."""
        return self._efforts.topic if self._efforts else str(self._publisher.topic_name)

    def count_subscribers(self) -> int:
        """Return how many listen to it."""
        if self._efforts is not None:
            return self._efforts.count_subscribers()
        return int(self._publisher.get_subscription_count())

    def destroy(self) -> None:
        """Take the publishers off the graph."""
        self._node.destroy_publisher(self._publisher)
        if self._efforts is not None:
            self._efforts.destroy()


Commands = CommandPublisher | ComplianceCommands


class ImpedancePublisher[T]:
    """Publishes on ``~/impedance`` what acts, after the commands.

    It comes with each command while it changes, else once a second, where somebody listens: as
    positions of a sensor_msgs/JointState, by name.

    Args:
        node: the node that publishes.
        to_ros: makes the message of what acts, with a stamp.
    """

    def __init__(self, node: Node, to_ros: Callable[[T, Time], JointState]) -> None:
        self._to_ros = to_ros
        self._publisher = node.create_publisher(JointState, "~/impedance", QOS_STREAM)
        self._shown_at = 0  # [s]
        self._shown: T | None = None

    def show(self, stamp: Time, acting: T | None) -> None:
        """Publish what acts, the same object while nothing changes, under the stamp of a command.

        None: nothing does.
        """
        if acting is None or (acting is self._shown and stamp.sec == self._shown_at):
            return
        if self._publisher.get_subscription_count():
            self._shown, self._shown_at = acting, stamp.sec
            self._publisher.publish(self._to_ros(acting, stamp))
