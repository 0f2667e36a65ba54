"""A recorded run as arrays: from a bag to what was measured, commanded and desired.

    recording = Recording.load("out/demo/euler_parameters")
    recording.command.orientation_error     # (N,) [rad]

Needs no ROS.
"""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from eulerparams_control.bags.reader import Bag, DecodedMessage
from eulerparams_control.errors import BagError, InvalidMessageError, SingularityError
from eulerparams_control.messages import JointStateReader, motion_from_ros, ns_from_ros
from eulerparams_control.motion import DesiredFrame, DesiredMotion
from eulerparams_control.orientation import EulerSequence
from eulerparams_control.robot import Robot
from eulerparams_control.rotations import Array, angle_between

_LASTING = 0.1  # [s] for which a streamed frame holds its twist: the controllers' default


@dataclass(frozen=True)
class Series:
    """Motion of the arm over time, with the desired frame at the same instants.

    Attributes:
        robot: the arm.
        t: (N,) [s] from the beginning of the recording.
        q, dq: (N, n) positions and velocities [rad, rad/s].
        desired: N desired frames, or None where nothing was desired yet.
    """

    robot: Robot
    t: Array
    q: Array
    dq: Array
    desired: Sequence[DesiredFrame | None]

    @cached_property
    def _kinematics(self) -> tuple[Array, Array, Array]:
        """(N, 3) [m], (N, 3, 3) position and orientation of the tip, and (N, 6, n) J."""
        states = map(self.robot.state, self.q, self.dq)
        p, R, J = zip(*((state.p_e, state.R_e, state.J) for state in states), strict=True)
        return np.array(p), np.array(R), np.array(J)

    @cached_property
    def position_error(self) -> Array:
        """(N,) [m] distance of the tip from the desired one; NaN where there is none."""
        pairs = zip(self.desired, self._kinematics[0], strict=True)
        return np.array([np.nan if d is None else np.linalg.norm(d.p_d - p) for d, p in pairs])

    @cached_property
    def orientation_error(self) -> Array:
        """(N,) [rad] angle of the tip from the desired one; NaN where there is none."""
        pairs = zip(self.desired, self._kinematics[1], strict=True)
        return np.array([np.nan if d is None else angle_between(d.R_d, R) for d, R in pairs])

    @cached_property
    def joint_speed(self) -> Array:
        """(N,) [rad/s] largest absolute joint velocity."""
        return np.abs(self.dq).max(axis=1)

    @cached_property
    def smallest_singular_value(self) -> Array:
        """(N,) smallest singular value of J: distance to the kinematic singularities."""
        return np.linalg.svd(self._kinematics[2], compute_uv=False)[:, -1]

    def pole_distance(self, sequence: EulerSequence) -> Array:
        """Return (N,) [rad] the angle of the tip to the pole of a sequence of Euler angles."""
        return np.array([sequence.pole_distance(R) for R in self._kinematics[1]])


@dataclass(frozen=True)
class Recording:
    """One run: what was measured, what was commanded, and how it was set up.

    Attributes:
        path: of the bag.
        robot: the arm.
        measured: from joint_states.
        command: from joint_reference; None if there is none.
        parameters: of the recorded nodes, by node and name.
        warning: what is wrong with the bag; "" if nothing.
    """

    path: Path
    robot: Robot
    measured: Series
    command: Series | None
    parameters: dict[str, dict[str, Any]]
    warning: str

    @classmethod
    def load(cls, path: str | PathLike[str], urdf: str = "", tip_frame: str = "") -> "Recording":
        """Read a bag.

        Args:
            path: folder or file of the bag.
            urdf: text of a URDF; "" takes the robot_description in the bag.
            tip_frame: the link to look at; "" takes that of the reference.

        Raises:
            BagError: if it is no bag, or holds no joint_states.
            RobotError: if the URDF does not fit.
        """
        bag = Bag(path)
        topics = _Topics(bag)
        references = list(topics.messages("reference"))
        base, tip = _frames(references, bag, tip_frame)
        robot = Robot(urdf or bag.robot_description(), base, tip)
        states = list(topics.messages("joint_states"))
        if not states:
            raise BagError(f"{path}: no joint_states; found {', '.join(bag.topics) or 'nothing'}")
        commands = list(topics.messages("joint_reference"))
        start = ns_from_ros(states[0].message.header.stamp)
        desired = _Desired(references, commands or states, robot)
        measured = _series(robot, states, start, desired)
        command = _series(robot, commands, start, desired) if commands else None
        return cls(Path(path), robot, measured, command, _parameters(bag), bag.warning)

    @property
    def name(self) -> str:
        """The name of the bag's folder."""
        return self.path.resolve().name

    @cached_property
    def servo_lag(self) -> tuple[Array, Array]:
        """Times (M,) [s], largest angle (M,) [rad] of a joint between command and measurement.

        At the stamps that both have; empty without a command.
        """
        if self.command is None:
            return np.zeros(0), np.zeros(0)
        t, i, j = np.intersect1d(self.command.t, self.measured.t, return_indices=True)
        return t, np.abs(self.command.q[i] - self.measured.q[j]).max(axis=1, initial=0.0)

    @property
    def leading(self) -> Series:
        """What the controller answers for: its command, else the measured motion."""
        return self.command or self.measured

    @property
    def sequence(self) -> EulerSequence:
        """The sequence of Euler angles of its parameters; XYZ if they name none."""
        return EulerSequence(str(self.parameter("euler_sequence", "XYZ")))

    @cached_property
    def pole_distance(self) -> Array:
        """(N,) [rad] angle to the pole of ``sequence``, of the leading series."""
        return self.leading.pole_distance(self.sequence)

    def parameter(self, name: str, default: Any = None) -> Any:
        """Return the parameter of that name of the first node that has it."""
        for values in self.parameters.values():
            if name in values:
                return values[name]
        return default


_TYPES = {
    "joint_states": "sensor_msgs/msg/JointState",
    "joint_reference": "sensor_msgs/msg/JointState",
    "reference": "trajectory_msgs/msg/MultiDOFJointTrajectory",
}


class _Topics:
    """The topics of a bag by the last part of their names; those of another type are not meant."""

    def __init__(self, bag: Bag) -> None:
        self._bag = bag

    def messages(self, name: str) -> Iterator[DecodedMessage]:
        names = [
            topic
            for topic, info in self._bag.topics.items()
            if topic.rsplit("/", 1)[-1] == name and info.type == _TYPES[name]
        ]
        if len(names) > 1:
            raise BagError(f"{self._bag.path} has several topics {name}: {', '.join(names)}")
        return self._bag.messages(names) if names else iter(())


class _Desired:
    """The desired frame at the stamps of a recording, from the references in it."""

    def __init__(
        self, references: list[DecodedMessage], ticks: list[DecodedMessage], robot: Robot
    ) -> None:
        self._frames: dict[int, DesiredFrame] = {}
        pending = list(references)
        motion: DesiredMotion | None = None
        for stamp, log_time in _instants(ticks):
            while pending and pending[0].log_time <= log_time:
                motion = self._follow(motion, pending.pop(0).message, robot)
            if motion is not None:
                with contextlib.suppress(SingularityError):  # the controller held still then
                    self._frames[stamp] = motion.sample(stamp)

    def _follow(
        self, motion: DesiredMotion | None, message: Any, robot: Robot
    ) -> DesiredMotion | None:
        try:
            new, start = motion_from_ros(message, robot.base_frame, robot.tip_frame, _LASTING)
        except InvalidMessageError:
            return motion  # the controller refused it too
        motion = motion or DesiredMotion(new.frames[0])
        motion.follow(new, start)
        return motion

    def at(self, stamp: int) -> DesiredFrame | None:
        return self._frames.get(stamp)


def _instants(messages: list[DecodedMessage]) -> Iterator[tuple[int, int]]:
    """Yield stamp and log time of each message whose stamp is new."""
    last = -1
    for message in messages:
        stamp = ns_from_ros(message.message.header.stamp)
        if stamp > last:
            yield stamp, message.log_time
            last = stamp


def _series(robot: Robot, messages: list[DecodedMessage], start: int, desired: _Desired) -> Series:
    """Return the series of messages, each stamp once, messages that are not valid left out."""
    reader = JointStateReader(robot.joints)
    rows: dict[int, tuple[Array, Array]] = {}
    for message in messages:
        try:
            stamp, q, dq = reader.from_ros(message.message)
        except InvalidMessageError:
            continue
        rows.setdefault(stamp, (q, dq))
    if not rows:
        raise BagError(f"no valid message with the joints {', '.join(robot.joints)}")
    stamps = sorted(rows)
    q, dq = (np.array([rows[stamp][i] for stamp in stamps]) for i in (0, 1))
    t = (np.array(stamps) - start) / 1e9
    return Series(robot, t, q, dq, [desired.at(stamp) for stamp in stamps])


def _frames(references: list[DecodedMessage], bag: Bag, tip_frame: str) -> tuple[str, str]:
    """Return base and tip frame: from the references, else from the parameters."""
    for reference in references:
        if len(reference.message.joint_names) == 1:
            return reference.message.header.frame_id, tip_frame or reference.message.joint_names[0]
    for values in _parameters(bag).values():
        if "tip_frame" in values:
            return str(values.get("base_frame", "")), tip_frame or str(values["tip_frame"])
    if not tip_frame:
        raise BagError(f"{bag.path}: nothing in it names the tip frame; give it with --tip-frame")
    return "", tip_frame


def _parameters(bag: Bag) -> dict[str, dict[str, Any]]:
    """Return the parameters by node and name; what has another form is left out."""
    nodes = {name: node for name, node in bag.parameters().items() if isinstance(node, dict)}
    values = {str(name): node.get("ros__parameters") for name, node in nodes.items()}
    return {name: node for name, node in values.items() if isinstance(node, dict)}
