"""The joint command as a message: the types that ros2_control's controllers take."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectory

from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.messages.to_ros import duration_to_ros, motion_to_ros
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.ros.qos import QOS_STREAM

# How far ahead [s] the point of a joint_trajectory is.
HORIZON = 0.02


class Commands(Protocol):
    """What publishes the commands of a scheme."""

    @property
    def topic(self) -> str:
        """The topic of the commands."""

    def publish(self, stamp: Time, command: JointCommand) -> None:
        """Publish a command under the stamp of the joint_states that it answers."""

    def count_subscribers(self) -> int:
        """Return how many listen to the commands."""

    def destroy(self) -> None:
        """Take the publishers off the graph."""


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
        self._node = node
        self._joints = list(joints)
        message, self._fill = self._kinds()[kind]
        self._message = message
        self._publisher = node.create_publisher(type(message), topic, qos)

    def publish(self, stamp: Time, command: JointCommand) -> None:
        """Publish a command under the stamp of the joint_states that it answers."""
        self._fill(stamp, command)
        self._publisher.publish(self._message)

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

    def _kinds(self) -> dict[str, tuple[Any, Callable[[Time, JointCommand], None]]]:
        point = JointTrajectoryPoint(time_from_start=duration_to_ros(HORIZON))
        trajectory = JointTrajectory(joint_names=self._joints, points=[point])
        return {
            "joint_state": (JointState(name=self._joints), self._fill_joint_state),
            "joint_trajectory": (trajectory, self._fill_trajectory),
            "forward": (Float64MultiArray(), self._fill_forward),
        }

    def _fill_joint_state(self, stamp: Time, command: JointCommand) -> None:
        self._message.header.stamp = stamp
        if command.q is not None:
            self._message.position = command.q.tolist()
        if command.dq is not None:
            self._message.velocity = command.dq.tolist()
        if command.effort is not None:
            self._message.effort = command.effort.tolist()

    def _fill_trajectory(self, stamp: Time, command: JointCommand) -> None:
        # joint_trajectory_controller refuses a trajectory that ends in the past or with a
        # velocity: the stamp stays 0, which is now, and the point has a position only
        if command.q is not None and command.dq is not None:
            self._message.points[0].positions = (command.q + HORIZON * command.dq).tolist()

    def _fill_forward(self, stamp: Time, command: JointCommand) -> None:
        values = command.effort if command.effort is not None else command.q
        if values is not None:
            self._message.data = values.tolist()


class ComplianceCommands:
    """Publishes the compliant frame, then the efforts that follow it.

    Args:
        node: the node that publishes.
        base_frame, tip_frame: that the compliant frame is stated with.
        efforts: publisher of the efforts; None: the compliant frame is the command.
    """

    def __init__(
        self, node: Node, base_frame: str, tip_frame: str, efforts: Commands | None
    ) -> None:
        self._node, self._efforts = node, efforts
        self._frames = base_frame, tip_frame
        self._publisher = node.create_publisher(
            MultiDOFJointTrajectory, "compliant_frame", QOS_STREAM
        )

    def publish(self, stamp: Time, command: JointCommand) -> None:
        """Publish both under the stamp of the joint_states that they answer."""
        if command.frame is not None:
            msg = motion_to_ros(Trajectory([0.0], [command.frame]), *self._frames)
            msg.header.stamp = stamp
            self._publisher.publish(msg)
        if self._efforts is not None:
            self._efforts.publish(stamp, command)

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
