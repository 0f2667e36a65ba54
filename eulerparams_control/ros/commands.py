"""The joint command as a message: the types that ros2_control's controllers take."""

from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

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
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.ros.qos import QOS_STREAM

# How far ahead [s] the point of a joint_trajectory is.
HORIZON = 0.02


Numbers = Callable[[JointCommand], Sequence[Array]]
"""Returns what of a command is written into a message."""


def _parts(*places: int) -> Numbers:
    """Return what takes the parts of a command that have these places in it."""
    one = itemgetter(slice(places[0], places[0] + 1))
    return itemgetter(*places) if len(places) > 1 else one  # without a call of Python


def _ahead(c: JointCommand) -> list[Array]:
    q, dq, *_ = c
    return [] if q is None or dq is None else [q + HORIZON * dq]


def _numbers(kind: str, c: JointCommand) -> tuple[list[str], Numbers] | None:
    """Return the fields of commands like this one in messages of a type; None: it has none."""
    q, dq, effort, _ = given = [part is not None for part in c]
    if kind == "joint_trajectory":
        return (["positions"], _ahead) if q and dq else None
    if kind == "forward":
        return (["data"], _parts(2 if effort else 0)) if q or effort else None
    names = {name: i for i, name in enumerate(("position", "velocity", "effort")) if given[i]}
    return ([*names], _parts(*names.values())) if names else None


_OF_A_FRAME = "p_d", "eps", "eta", "dp_d", "omega_d", "ddp_d", "domega_d"


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
        self._kind = kind
        self._lacks: tuple[bool, ...] = ()  # what commands like the last one lack
        self._way: tuple[Template, Numbers] | None = None  # of such commands into a message
        self._publisher = node.create_publisher(type(self._message), topic, qos)

    def publish(self, stamp: Any, command: JointCommand) -> None:
        """Publish a command under the stamp of the joint_states that it answers."""
        q, dq, effort, _ = command
        lacks = q is None, dq is None, effort is None
        if lacks != self._lacks:
            self._lacks, self._way = lacks, self._way_of(command)
        if self._way is not None:
            template, numbers = self._way
            stamp = stamp if self._is_stamped else None
            self._publisher.publish(template.filled(stamp, numbers(command)))

    def _way_of(self, command: JointCommand) -> tuple[Template, Numbers] | None:
        """Return the way of commands like this one into a message; None: they have none."""
        found = _numbers(self._kind, command)
        if found is None:
            return None
        names, numbers = found
        for name in ("position", "velocity", "effort") if self._is_stamped else ():
            setattr(self._owner, name, [])
        for name, values in zip(names, numbers(command), strict=True):
            setattr(self._owner, name, values.tolist())
        kind = type(self._message).__name__
        return Template(kind, serialize_message(self._message), names), numbers

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
        self._frames = base_frame, tip_frame
        self._template: Template | None = None
        self._publisher = node.create_publisher(
            MultiDOFJointTrajectory, "compliant_frame", QOS_STREAM
        )

    def publish(self, stamp: Any, command: JointCommand) -> None:
        """Publish both under the stamp of the joint_states that they answer."""
        if self._efforts is not None:
            self._efforts.publish(stamp, command)
        if (frame := command.frame) is not None:
            if self._template is None:
                motion = Trajectory([0.0], [frame])
                msg = motion_to_ros(motion, *self._frames)
                self._template = Template(type(msg).__name__, serialize_message(msg), _OF_A_FRAME)
            Q = quaternion(frame.R_d)
            numbers = frame.p_d, Q.eps, Q.eta, *frame[2:]
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
