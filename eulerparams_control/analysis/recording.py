"""A recorded run as arrays: from a bag to what was measured, commanded and desired.

    recording = Recording.load("out/demo/euler_parameters")
    recording.leading.orientation_error     # (N,) [rad]

Needs no ROS.
"""

import bisect
import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from eulerparams_control.analysis.compliant import CompliantMotion
from eulerparams_control.analysis.impedance_run import ImpedanceRun, impedance_run
from eulerparams_control.analysis.impedances import impedance_node
from eulerparams_control.analysis.lyapunov import LyapunovSeries, lyapunov_series
from eulerparams_control.analysis.series import Efforts, Frames, Series
from eulerparams_control.analysis.wrenches import SensorSeries, Wrenches, at_the_tip
from eulerparams_control.bags.reader import Bag, DecodedMessage
from eulerparams_control.errors import BagError, InvalidMessageError, SingularityError
from eulerparams_control.messages import (
    BEGAN,
    CommandReader,
    JointStateReader,
    motion_from_ros,
    ns_from_ros,
    wrench_from_ros,
)
from eulerparams_control.motion import DesiredFrame, DesiredMotion
from eulerparams_control.orientation import EulerSequence
from eulerparams_control.robot import Robot
from eulerparams_control.rotations import Array

_LASTING = 0.1  # [s] for which a streamed frame holds its twist: the controllers' default


@dataclass(frozen=True)
class Recording:
    """One run: what was measured, what was commanded, and how it was set up.

    Attributes:
        path: of the bag.
        robot: the arm.
        measured: from joint_states.
        command: from joint_reference; None if there is none.
        effort: from joint_effort; None if there is none.
        parameters: of the recorded nodes, by node and name.
        warning: what is wrong with the bag; "" if nothing.
        diverged: [s] when the simulation ended because the arm left all numbers, or its
            controller gave up; None if it did not.
        sensed: from wrench; None if there is none.
        compliant: from compliant_frame; None if there is none.
        urdf: text of the robot's description.
    """

    path: Path
    robot: Robot
    measured: Series
    command: Series | None
    effort: Efforts | None
    parameters: dict[str, dict[str, Any]]
    warning: str
    diverged: float | None = None
    sensed: SensorSeries | None = None
    compliant: CompliantMotion | None = None
    urdf: str = field(default="", repr=False)

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
        parameters = _parameters(bag)
        urdf = urdf or bag.robot_description()
        robot = _robot(urdf, base, tip, parameters)
        states = list(topics.messages("joint_states"))
        if not states:
            raise BagError(f"{path}: no joint_states; found {', '.join(bag.topics) or 'nothing'}")
        commands = list(topics.messages("joint_reference"))
        efforts = list(topics.messages("joint_effort"))
        start = ns_from_ros(states[0].message.header.stamp)
        starts = _starts(references, list(topics.messages("diagnostics")))
        desired = _Desired(references, commands or efforts or states, robot, starts)
        measured = _series(robot, states, start, desired)
        command = _series(robot, commands, start, desired) if commands else None
        effort = _efforts(robot, efforts, start) if efforts else None
        sensed = _sensed(list(topics.messages("wrench")), start)
        compliant = _compliant(robot, list(topics.messages("compliant_frame")), start, desired)
        return cls(
            Path(path),
            robot,
            measured,
            command,
            effort,
            parameters,
            bag.warning,
            sensed=sensed,
            compliant=compliant,
            urdf=urdf,
        )

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
        """What the controller answers for: its joint_reference, else the measured motion."""
        return self.command or self.measured

    @cached_property
    def wrench(self) -> Wrenches | None:
        """The contact wrench at the tip; None where ``why_no_wrench`` says."""
        return None if isinstance(self._wrench, str) else self._wrench

    @property
    def why_no_wrench(self) -> str:
        """Why there is no ``wrench``; "" if there is."""
        return self._wrench if isinstance(self._wrench, str) else ""

    @cached_property
    def _wrench(self) -> Wrenches | str:
        if self.sensed is None:
            return "no wrench was recorded"
        try:
            return at_the_tip(self.sensed, self.measured, self.parameters)
        except BagError as error:
            return str(error)

    @property
    def contact(self) -> Wrenches | None:
        """The wrench, where anything was felt or an impedance answers it; else None."""
        wrench = self.wrench
        if wrench is None or (self.compliant is None and not wrench.is_felt):
            return None
        return wrench

    @cached_property
    def impedance(self) -> ImpedanceRun | None:
        """What the impedance equations relate; None without a compliant frame."""
        if self.compliant is None:
            return None
        return impedance_run(self.compliant, self.wrench, self.measured, self.parameters)

    def compliant_frames(self, series: Series) -> Frames:
        """Return the compliant frame at each instant of a series, None where there is none."""
        return [None] * len(series.t) if self.compliant is None else self.compliant.at(series.t)

    @cached_property
    def lyapunov(self) -> LyapunovSeries | None:
        """V of the controller that ran, (30), (42) or (68); None where ``why_no_lyapunov`` says."""
        return None if isinstance(self._lyapunov, str) else self._lyapunov

    @property
    def why_no_lyapunov(self) -> str:
        """Why there is no ``lyapunov``; "" if there is."""
        return self._lyapunov if isinstance(self._lyapunov, str) else ""

    @cached_property
    def _lyapunov(self) -> LyapunovSeries | str:
        try:
            return lyapunov_series(self.leading, self.parameters, self.impedance)
        except BagError as error:
            return str(error)

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
    "joint_effort": "sensor_msgs/msg/JointState",
    "reference": "trajectory_msgs/msg/MultiDOFJointTrajectory",
    "compliant_frame": "trajectory_msgs/msg/MultiDOFJointTrajectory",
    "wrench": "geometry_msgs/msg/WrenchStamped",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
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
    """The desired frame at the stamps of a recording, from the references in it.

    A reference counts from when the controller said that it began, else from the first tick
    that was sent after it.

    Args:
        references, ticks: messages.
        robot: the arm.
        starts: [ns] by number of the reference.
    """

    def __init__(
        self,
        references: list[DecodedMessage],
        ticks: list[DecodedMessage],
        robot: Robot,
        starts: dict[int, int],
    ) -> None:
        self._frames: dict[int, DesiredFrame] = {}
        pending = list(references)
        motion: DesiredMotion | None = None
        for stamp, sent in _instants(ticks):
            while pending and _sent(pending[0]) <= sent:
                began = starts.get(len(references) - len(pending))
                motion = self._follow(motion, pending.pop(0).message, robot, began)
            if motion is not None:
                with contextlib.suppress(SingularityError):  # the controller held still then
                    self._frames[stamp] = motion.sample(stamp)

    def _follow(
        self, motion: DesiredMotion | None, message: Any, robot: Robot, began: int | None
    ) -> DesiredMotion | None:
        try:
            new, start = motion_from_ros(message, robot.base_frame, robot.tip_frame, _LASTING)
        except InvalidMessageError:
            return motion  # the controller refused it too
        motion = motion or DesiredMotion(new.frames[0])
        motion.follow(new, start if began is None else began)
        return motion

    def at(self, stamp: int) -> DesiredFrame | None:
        return self._frames.get(stamp)


def _starts(
    references: list[DecodedMessage], diagnostics: list[DecodedMessage]
) -> dict[int, int]:
    """Return when references began [ns], by their number, as far as a controller said it."""
    sent, starts = sorted(map(_sent, references)), dict[int, int]()
    for message in diagnostics:
        for value in (value for status in message.message.status for value in status.values):
            if value.key == BEGAN and int(value.value) not in starts.values():
                before = bisect.bisect_right(sent, _sent(message))
                if before:
                    starts[before - 1] = int(value.value)
    return starts


def _sent(message: DecodedMessage) -> int:
    """Return when a message was sent [ns]; a busy recorder may get it much later."""
    return message.publish_time or message.log_time


def _instants(messages: list[DecodedMessage]) -> Iterator[tuple[int, int]]:
    """Yield stamp and time of sending of each message whose stamp is new."""
    last = -1
    for message in messages:
        stamp = ns_from_ros(message.message.header.stamp)
        if stamp > last:
            yield stamp, _sent(message)
            last = stamp


def _series(robot: Robot, messages: list[DecodedMessage], start: int, desired: _Desired) -> Series:
    """Return the series of messages with positions."""
    stamps, rows = _rows(robot, messages, JointStateReader(robot.joints).from_ros)
    q, dq = (np.array([row[i] for row in rows]) for i in (1, 2))
    return Series(robot, _times(stamps, start), q, dq, [desired.at(stamp) for stamp in stamps])


def _efforts(robot: Robot, messages: list[DecodedMessage], start: int) -> Efforts:
    """Return the efforts of messages."""
    reader = CommandReader(robot.joints, "torque")
    stamps, rows = _rows(robot, messages, reader.effort_from_ros)
    return Efforts(_times(stamps, start), np.array(rows))


def _sensed(messages: list[DecodedMessage], start: int) -> SensorSeries | None:
    """Return what the sensor said in messages; None if there are none that are valid."""

    def read(message: Any) -> tuple[Array, str]:
        frame = str(message.header.frame_id)
        return wrench_from_ros(message, frame), frame

    stamps, rows = _valid(messages, read)
    if not rows:
        return None
    w, frames = zip(*rows, strict=True)
    return SensorSeries(_times(stamps, start), np.array(w), list(frames))


def _compliant(
    robot: Robot, messages: list[DecodedMessage], start: int, desired: _Desired
) -> CompliantMotion | None:
    """Return the compliant frames of messages; None if there are none that are valid."""

    def read(message: Any) -> DesiredFrame:
        motion, _ = motion_from_ros(message, robot.base_frame, robot.tip_frame, _LASTING)
        return motion.frames[0]

    stamps, frames = _valid(messages, read)
    if not frames:
        return None
    beside = [desired.at(stamp) for stamp in stamps]
    return CompliantMotion(_times(stamps, start), tuple(frames), beside)


def _rows[T](
    robot: Robot, messages: list[DecodedMessage], read: Callable[[Any], T]
) -> tuple[list[int], list[T]]:
    """Return stamps and contents of messages about joints; raise BagError if none is valid."""
    stamps, rows = _valid(messages, read)
    if not rows:
        raise BagError(f"no valid message with the joints {', '.join(robot.joints)}")
    return stamps, rows


def _valid[T](
    messages: list[DecodedMessage], read: Callable[[Any], T]
) -> tuple[list[int], list[T]]:
    """Return stamps and contents, each stamp once, messages that are not valid left out."""
    rows: dict[int, T] = {}
    for message in messages:
        with contextlib.suppress(InvalidMessageError):
            rows.setdefault(ns_from_ros(message.message.header.stamp), read(message.message))
    stamps = sorted(rows)
    return stamps, [rows[stamp] for stamp in stamps]


def _times(stamps: list[int], start: int) -> Array:
    return (np.array(stamps) - start) / 1e9


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


def _robot(
    urdf: str, base: str, tip: str, parameters: dict[str, dict[str, Any]]
) -> Robot:
    """Return the arm, with the gravity that the controller was told."""
    told = (impedance_node(parameters) or {}).get("gravity") or ()
    return Robot(urdf, base, tip, gravity=told) if len(told) == 3 else Robot(urdf, base, tip)


def _parameters(bag: Bag) -> dict[str, dict[str, Any]]:
    """Return the parameters by node and name; what has another form is left out."""
    nodes = {name: node for name, node in bag.parameters().items() if isinstance(node, dict)}
    values = {str(name): node.get("ros__parameters") for name, node in nodes.items()}
    return {name: node for name, node in values.items() if isinstance(node, dict)}
