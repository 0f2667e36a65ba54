"""Messages, checked: from their fields to the types of the core.

The functions take the messages of rclpy as well as those of a bag reader, and need no ROS.  Their
counterparts ``x_to_ros`` are in ``to_ros.py``.  Quaternions are (eta, eps) inside and xyzw in
messages.  What a message may not contain is refused here with InvalidMessageError.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from eulerparams_control.errors import ConfigurationError, InvalidMessageError
from eulerparams_control.laws.rotations import Array, EulerParameters
from eulerparams_control.motion.frames import DesiredFrame, Placement
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.spline import Poses
from eulerparams_control.motion.trajectories import MAX_POINTS, Trajectory

# A unit quaternion of single precision, or printed with 4 digits, is this close to norm 1.
QUATERNION_NORM_TOLERANCE = 1e-3

LARGEST = 1e9
"""No machine measures or is asked for more, in SI units; what is more would overflow a law."""

LARGEST_COMMAND = 1e100
"""Robots limit commands themselves; one that has no limits is to show where a law leads."""

_CLOSEST = 1e-6  # [s] between two points: what is closer is a leap
_SHOWN_NAMES = 20  # of a list of names in an error, each with
_SHOWN_LETTERS = 60


def shown(name: str) -> str:
    """Return a name from a message as it can be shown: in one line, and not too long."""
    text = repr(name)[1:-1]
    return text if len(text) <= _SHOWN_LETTERS else f"{text[:_SHOWN_LETTERS]}..."


def _expect(is_so: bool, found: str, expected: str) -> None:
    """Raise InvalidMessageError with what a message has, if it is not so as it should be."""
    if not is_so:
        raise InvalidMessageError(f"{found}; expected {expected}")


def _fault(values: Any, largest: float = LARGEST) -> str:
    """Return what is wrong with values; "" if all are finite, and none is larger."""
    if (np.abs(values) <= largest).all():  # not so for NaN
        return ""
    return "too large" if np.isfinite(values).all() else "non-finite"


def ns_from_ros(stamp: Any) -> int:
    """Return a stamp or duration in nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def vector_from_ros(v: Any) -> Array:
    """Return a message's x, y, z as (3,)."""
    return np.array([v.x, v.y, v.z])


def quaternion_from_ros(q: Any) -> EulerParameters:
    """Return xyzw as Euler parameters, normalised; raises InvalidMessageError if they are far."""
    norm = math.hypot(q.w, q.x, q.y, q.z)
    found = f"quaternion (x {q.x:g}, y {q.y:g}, z {q.z:g}, w {q.w:g}) has norm {norm:g}"
    _expect(abs(norm - 1) <= QUATERNION_NORM_TOLERANCE, found, "1")
    return EulerParameters(q.w / norm, np.array([q.x, q.y, q.z]) / norm)


class JointReader:
    """Reads joints from messages by name: any order, extra joints ignored.

    Args:
        joints: names of the joints, in the order of the arrays returned.
        topic: for the error messages.
        largest: value that is not refused.
    """

    def __init__(self, joints: Sequence[str], topic: str, largest: float = LARGEST) -> None:
        self._joints, self._topic, self._largest = tuple(joints), topic, largest
        self._names: list[str] | None = None  # of the last message that had all joints
        self._index: list[int] = []

    def concerns(self, msg: Any) -> bool:
        """Whether a message is meant for us: it has one of the joints, or no names at all."""
        names = msg.name
        return names == self._names or not names or not set(self._joints).isdisjoint(names)

    def read(self, msg: Any, what: str) -> Array:
        """Return "position", "velocity" or "effort" (n,); raises InvalidMessageError."""
        index, values = self._index_of(msg), getattr(msg, what)
        if len(values) != len(msg.name):
            raise InvalidMessageError(
                f"{self._topic} has {len(msg.name)} names but {len(values)} values of {what}"
            )
        picked = np.array([values[i] for i in index])
        if fault := _fault(picked, self._largest):
            found = dict(zip(self._joints, picked.tolist(), strict=True))
            raise InvalidMessageError(f"{self._topic} has a {fault} {what}: {found}")
        return picked

    def _index_of(self, msg: Any) -> list[int]:
        """Return where the joints are among the names of a message."""
        if msg.name == self._names:
            return self._index
        names, joints = list(msg.name), self._joints
        missing = [joint for joint in joints if joint not in names]
        listed = ", ".join(map(shown, names[:_SHOWN_NAMES])) or "no names"
        if len(names) > _SHOWN_NAMES:
            listed += f" and {len(names) - _SHOWN_NAMES} more"
        expected = f"{', '.join(joints)}; found {listed}"
        _expect(not missing, f"{self._topic} lacks {', '.join(missing)}", expected)
        twice = [joint for joint in joints if names.count(joint) > 1]
        expected = "each joint once: are there two publishers in one?"
        _expect(not twice, f"{self._topic} has {', '.join(twice)} twice", expected)
        self._names, self._index = names, [*map(names.index, joints)]
        return self._index


class JointStateReader(JointReader):
    """Reads the measured state of the active joints from joint_states.

    A message has no velocities where all are NaN, too: ``needs_velocity`` refuses it, and
    ``has_velocity`` says whether the last valid one had some.
    """

    has_velocity = True

    def __init__(self, joints: Sequence[str], needs_velocity: bool = False) -> None:
        super().__init__(joints, "joint_states")
        self._needs_velocity = needs_velocity

    def from_ros(self, msg: Any) -> tuple[int, Array, Array]:
        """Return the stamp [ns], q (n,), and dq (n,), 0 if there is none; raises as ``read``."""
        dq, index = msg.velocity, self._index_of(msg)
        q = self.read(msg, "position")
        # joint_state_broadcaster fills what hardware lacks
        are_nan = len(dq) == len(msg.name) and all(math.isnan(dq[i]) for i in index)
        has_velocity = len(dq) > 0 and not are_nan
        if self._needs_velocity and not has_velocity:
            raise InvalidMessageError(
                f"joint_states has no velocities{', all are NaN' if len(dq) else ''}; "
                "efforts need the measured ones: let the driver of the robot publish them"
            )
        speeds = self.read(msg, "velocity") if has_velocity else np.zeros_like(q)
        self.has_velocity = has_velocity  # only now: what is refused says nothing
        return ns_from_ros(msg.header.stamp), q, speeds


def _parts(twist: Any) -> list[Array]:
    return [vector_from_ros(twist.linear), vector_from_ros(twist.angular)]


def motion_from_ros(
    msg: Any, base_frame: str, tip_frame: str, lasting: float
) -> tuple[Trajectory | SetPoint, int | None]:
    """Return the motion of a reference, and its start [ns] (None: at receipt).

    A point without velocities is passed through, at rest at the ends only; one with velocities
    that are 0 rests, one without accelerations has none.  Points without times (all are 0) take
    as long as the limits say.  One point alone rests; at time 0 it is a streamed set-point.

    Args:
        msg: a trajectory_msgs/MultiDOFJointTrajectory.
        base_frame, tip_frame: the frames that it must name.
        lasting: [s] for which a set-point keeps its twist.
    """
    frame_id, names = msg.header.frame_id, msg.joint_names
    found = f"the reference is in the frame '{shown(frame_id)}'"
    _expect(frame_id == base_frame, found, f"the base frame '{base_frame}'")
    found = ", ".join(f"'{shown(name)}'" for name in names[:_SHOWN_NAMES])
    found = f"the reference is for [{found}]"
    _expect(list(names) == [tip_frame], found, f"the tip frame ['{tip_frame}']")
    count = len(msg.points)
    _expect(count > 0, "the reference has no points", "at least one")
    _expect(count <= MAX_POINTS, f"the reference has {count} points", f"at most {MAX_POINTS}")
    times = [ns_from_ros(point.time_from_start) / 1e9 for point in msg.points]
    frames = [_frame_from_ros(point, i) for i, point in enumerate(msg.points)]
    _expect(times[0] >= 0, f"the reference begins at time_from_start {times[0]:g} s", "0 or more")
    start = ns_from_ros(msg.header.stamp) or None
    if count == 1 and times[0] <= 0:
        return SetPoint(frames[0], lasting), start
    for i, (before, t) in enumerate(pairwise(times), start=1):
        found = f"point {i} of the reference comes {t - before:g} s after the one before"
        _expect(not 0 < t - before < _CLOSEST, found, f"at least {_CLOSEST:g} s")
    known = [len(point.velocities) > 0 for point in msg.points]
    for i, point in enumerate(msg.points):
        found = f"point {i} of the reference has accelerations, and no velocities"
        expected = "both, or neither: then it is passed through"
        _expect(known[i] or not point.accelerations, found, expected)
    try:
        if count == 1 or (any(times) and all(known)):
            return Trajectory(times, frames), start
        return Poses(times, frames, known), start
    except ConfigurationError as error:
        raise InvalidMessageError(f"the reference is no motion: {error}") from error


def _frame_from_ros(point: Any, index: int) -> DesiredFrame:
    for name, least in (("transforms", 1), ("velocities", 0), ("accelerations", 0)):
        count = len(getattr(point, name))
        found = f"point {index} of the reference has {count} {name}"
        _expect(least <= count <= 1, found, f"{'1' if least else '0 or 1'}: that of the tip")
    transform = point.transforms[0]
    vectors = [vector_from_ros(transform.translation)]
    for twists in (point.velocities, point.accelerations):
        vectors += _parts(twists[0]) if twists else [np.zeros(3), np.zeros(3)]
    if fault := _fault(vectors):
        raise InvalidMessageError(f"point {index} of the reference has a {fault} value: {point}")
    p_d, dp_d, omega_d, ddp_d, domega_d = vectors
    R_d = quaternion_from_ros(transform.rotation).R
    return DesiredFrame(p_d, R_d, dp_d, omega_d, ddp_d, domega_d)


def pose_from_ros(msg: Any, carrier: Placement) -> DesiredFrame:
    """Return the frame at rest of a PoseStamped; ``carrier`` is its frame, seen from the base."""
    p = vector_from_ros(msg.pose.position)
    if fault := _fault(p):
        raise InvalidMessageError(f"the pose has a {fault} position {p.tolist()}")
    R = quaternion_from_ros(msg.pose.orientation).R
    return DesiredFrame(carrier.p + carrier.R @ p, carrier.R @ R)


def twist_from_ros(msg: Any, axes: Array) -> Array:
    """Return a TwistStamped (6,) [m/s, rad/s] in the base frame; ``axes`` (3, 3) are its own."""
    parts = np.array(_parts(msg.twist))
    if fault := _fault(parts):
        raise InvalidMessageError(f"the twist has a {fault} value: {parts.tolist()}")
    return np.ravel(parts @ axes.T)


def wrench_from_ros(msg: Any, frame_id: str) -> Array:
    """Return force and moment (6,) [N, Nm] of a WrenchStamped, which must be in ``frame_id``."""
    found = f"the wrench is in the frame '{shown(msg.header.frame_id)}'"
    _expect(msg.header.frame_id == frame_id, found, f"'{frame_id}'")
    force, torque = msg.wrench.force, msg.wrench.torque
    wrench = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    if fault := _fault(wrench):
        raise InvalidMessageError(f"the wrench has a {fault} value: {wrench.tolist()}")
    return wrench
