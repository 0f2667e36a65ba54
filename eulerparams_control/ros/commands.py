"""The joint command as a message: the types that ros2_control's controllers take."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectory

from eulerparams_control.laws.rotations import Array, quaternion
from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.messages.to_ros import duration_to_ros, motion_to_ros
from eulerparams_control.messages.wire import Template
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.ros.qos import QOS_STREAM

# How far ahead [s] the point of a joint_trajectory is.
HORIZON = 0.02


def _ahead(c: JointCommand) -> Array | None:
    return None if c.q is None or c.dq is None else c.q + HORIZON * c.dq


_NUMBERS: dict[str, Callable[[JointCommand], dict[str, Array | None]]] = {
    "joint_state": lambda c: {"position": c.q, "velocity": c.dq, "effort": c.effort},
    "joint_trajectory": lambda c: {"positions": _ahead(c)},
    "forward": lambda c: {"data": c.q if c.effort is None else c.effort},
}
"""Fields of a command in the messages of a type."""

_OF_A_FRAME = "p_d", "eps", "eta", "dp_d", "omega_d", "ddp_d", "domega_d"


class Commands(Protocol):
    """What publishes the commands of a scheme."""

    @property
    def topic(self) -> str:
        """The topic of the commands."""

    def publish(self, stamp: Any, command: JointCommand) -> None:
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
        self._node, self._is_stamped = node, kind == "joint_state"
        # joint_trajectory_controller refuses a trajectory that ends in the past or with a
        # velocity: its stamp stays 0, which is now, and its point has a position only
        point = JointTrajectoryPoint(time_from_start=duration_to_ros(HORIZON))
        self._message = {
            "joint_state": JointState(name=list(joints)),
            "joint_trajectory": JointTrajectory(joint_names=list(joints), points=[point]),
            "forward": Float64MultiArray(),
        }[kind]
        self._owner: Any = point if kind == "joint_trajectory" else self._message
        self._parts = _NUMBERS[kind]
        self._names: list[str] = []
        self._publisher = node.create_publisher(type(self._message), topic, qos)

    def publish(self, stamp: Any, command: JointCommand) -> None:
        """Publish a command under the stamp of the joint_states that it answers."""
        parts = self._parts(command)
        numbers = {name: values for name, values in parts.items() if values is not None}
        if not numbers:
            return
        if self._names != [*numbers]:
            self._names = [*numbers]
            for name, values in parts.items():
                setattr(self._owner, name, [] if values is None else values.tolist())
            data, kind = serialize_message(self._message), type(self._message).__name__
            self._template = Template(kind, data, self._names)
        stamp = stamp if self._is_stamped else None
        self._publisher.publish(self._template.filled(stamp, numbers.values()))

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
        self, node: Node, base_frame: str, tip_frame: str, efforts: Commands | None
    ) -> None:
        self._node, self._efforts = node, efforts
        self._frames = base_frame, tip_frame
        quaternion.prepare()  # not while an arm moves
        self._template: Template | None = None
        self._publisher = node.create_publisher(
            MultiDOFJointTrajectory, "compliant_frame", QOS_STREAM
        )

    def publish(self, stamp: Any, command: JointCommand) -> None:
        """Publish both under the stamp of the joint_states that they answer."""
        if self._efforts is not None:
            self._efforts.publish(stamp, command)
        if (row := command.frame_row) is not None:
            if self._template is None:
                motion = Trajectory([0.0], [DesiredFrame.of(row)])
                msg = motion_to_ros(motion, *self._frames)
                self._template = Template(type(msg).__name__, serialize_message(msg), _OF_A_FRAME)
            Q = quaternion.row(row[3:12])
            rates = row[12:15], row[15:18], row[18:21], row[21:]
            numbers = row[:3], Q[1:], Q[0], *rates
            self._publisher.publish(self._template.filled(stamp, numbers))

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

    def show(self, stamp: Any, acting: T | None) -> None:
        """Publish what acts, the same object while nothing changes, under the stamp of a command.

        None: nothing does.
        """
        if acting is None or (acting is self._shown and stamp.sec == self._shown_at):
            return
        if self._publisher.get_subscription_count():
            self._shown, self._shown_at = acting, stamp.sec
            time = Time(sec=stamp.sec, nanosec=stamp.nanosec)
            self._publisher.publish(self._to_ros(acting, time))
