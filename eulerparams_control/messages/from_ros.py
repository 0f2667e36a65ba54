"""Messages, checked: from their fields to the types of the core.

The functions take the messages of rclpy as well as those of :mod:`messages.wire` and of a bag
reader, and need no ROS.  Their counterparts ``x_to_ros`` are in ``to_ros.py``.  Quaternions are
(eta, eps) inside and xyzw in messages.  What a message may not contain is refused here with
InvalidMessageError.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from eulerparams_control.errors import ConfigurationError, InvalidMessageError
from eulerparams_control.laws.rotations import Array, EulerParameters
from eulerparams_control.motion.frames import DesiredFrame, Placement
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.spline import Poses
from eulerparams_control.motion.trajectories import MAX_POINTS, Trajectory
from eulerparams_control.parameters.schemes import COMMANDS

# A unit quaternion of single precision, or printed with 4 digits, is this close to norm 1.
QUATERNION_NORM_TOLERANCE = 1e-3

LARGEST = 1e9
"""No machine measures or is asked for more, in SI units; what is more would overflow a law."""

_CLOSEST = 1e-6  # [s] between two points: what is closer is a leap

_SHOWN_NAMES = 20  # of a list of names in an error, each with
_SHOWN_LETTERS = 60


def shown(name: str) -> str:
    """Return a name from a message as it can be shown: in one line, and not too long."""
    text = repr(name)[1:-1]
    return text if len(text) <= _SHOWN_LETTERS else f"{text[:_SHOWN_LETTERS]}..."


def _listed(names: Sequence[str]) -> str:
    """Return the names of a message as they can be shown."""
    more = f" and {len(names) - _SHOWN_NAMES} more" if len(names) > _SHOWN_NAMES else ""
    return ", ".join(map(shown, names[:_SHOWN_NAMES])) + more


def _quoted(names: Sequence[str]) -> str:
    return ", ".join(f"'{shown(name)}'" for name in names[:_SHOWN_NAMES])


def _are_possible(values: Any, largest: float = LARGEST) -> bool:
    """Return whether all values are finite, and none is larger."""
    return bool((np.abs(values) <= largest).all())  # not so for NaN


def _fault(values: Any) -> str:
    """Return what is wrong with values that are not possible."""
    return "too large" if np.isfinite(values).all() else "non-finite"


def ns_from_ros(stamp: Any) -> int:
    """Return a stamp or duration in nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def vector_from_ros(v: Any) -> Array:
    """Return a message's x, y, z as (3,)."""
    return np.array([v.x, v.y, v.z])


def quaternion_from_ros(q: Any) -> EulerParameters:
    """Return xyzw as Euler parameters, normalised.

    Raises:
        InvalidMessageError: if the norm is not 1.
    """
    norm = math.hypot(q.w, q.x, q.y, q.z)
    if not abs(norm - 1) <= QUATERNION_NORM_TOLERANCE:
        raise InvalidMessageError(
            f"quaternion (x {q.x:g}, y {q.y:g}, z {q.z:g}, w {q.w:g}) has norm {norm:g}; expected 1"
        )
    return EulerParameters(q.w / norm, np.array([q.x, q.y, q.z]) / norm)


class _JointReader:
    """Reads joints from messages by name: any order, extra joints ignored.

    Args:
        joints: names of the joints, in the order of the arrays returned.
        topic: for the error messages.

    Attributes:
        names: of the last message that had all joints.
    """

    _largest: ClassVar[float] = LARGEST

    def __init__(self, joints: Sequence[str], topic: str) -> None:
        self._joints = tuple(joints)
        self._topic = topic
        self.names: list[str] | None = None
        self._index: tuple[int, ...] = ()

    def concerns(self, msg: Any) -> bool:
        """Whether a message is meant for us: it has one of the joints, or no names at all."""
        names = msg.name
        return names == self.names or not names or not set(self._joints).isdisjoint(names)

    def _index_of(self, msg: Any) -> tuple[int, ...]:
        """Return where the joints are among the names of a message."""
        if msg.name == self.names:
            return self._index
        names = list(msg.name)
        missing = [joint for joint in self._joints if joint not in names]
        if missing:
            raise InvalidMessageError(
                f"{self._topic} lacks {', '.join(missing)}; expected {', '.join(self._joints)}; "
                f"found {_listed(names) or 'no names'}"
            )
        if twice := [joint for joint in self._joints if names.count(joint) > 1]:
            raise InvalidMessageError(
                f"{self._topic} has {', '.join(twice)} twice; expected each joint once: are there "
                "two publishers in one?"
            )
        self.names, self._index = names, tuple(map(names.index, self._joints))
        return self._index

    def _pick(self, values: Sequence[float], msg: Any, what: str) -> Array:
        index = self._index_of(msg)
        if len(values) != len(msg.name):
            raise InvalidMessageError(
                f"{self._topic} has {len(msg.name)} names but {len(values)} values of {what}"
            )
        picked = [values[i] for i in index]
        if not sum(map(abs, picked)) <= LARGEST and not _are_possible(picked, self._largest):
            raise InvalidMessageError(
                f"{self._topic} has a {_fault(picked)} {what}: "
                f"{dict(zip(self._joints, picked, strict=True))}"
            )
        return np.array(picked)


class JointStateReader(_JointReader):
    """Reads the measured state of the active joints from joint_states.

    Args:
        joints: the active joints.
        needs_velocity: whether a message without velocities is refused.

    Attributes:
        has_velocity: whether the last valid message had velocities; where all are NaN it has none.
    """

    has_velocity = True

    def __init__(self, joints: Sequence[str], needs_velocity: bool = False) -> None:
        super().__init__(joints, "joint_states")
        self._needs_velocity = needs_velocity

    def from_ros(self, msg: Any) -> tuple[int, Array, Array]:
        """Return the stamp [ns], q (n,) and dq (n,); dq is 0 where the message has none.

        Raises:
            InvalidMessageError: if a joint is missing, sizes differ, a value is not finite, or
                velocities are needed and not there.
        """
        dq, index = msg.velocity, self._index_of(msg)
        q = self._pick(msg.position, msg, "position")
        # joint_state_broadcaster fills what hardware lacks
        are_nan = len(dq) == len(msg.name) and math.isnan(dq[index[0]])
        has_velocity = len(dq) > 0 and not (are_nan and all(math.isnan(dq[i]) for i in index))
        if self._needs_velocity and not has_velocity:
            raise InvalidMessageError(
                f"joint_states has no velocities{', all are NaN' if len(dq) else ''}; "
                "efforts need the measured ones: let the driver of the robot publish them"
            )
        speeds = self._pick(dq, msg, "velocity") if has_velocity else np.zeros(len(q))
        self.has_velocity = has_velocity  # only now: what is refused says nothing
        return ns_from_ros(msg.header.stamp), q, speeds

    def effort_from_ros(self, msg: Any) -> Array | None:
        """Return the efforts (n,) of a message; None where it has none that can be used."""
        try:
            return self._pick(msg.effort, msg, "effort")
        except InvalidMessageError:
            return None


class CommandReader(_JointReader):
    """Reads the command of a robot from joint_reference or joint_effort.

    The robot keeps it within its limits; one that has none is to show where a law leads.
    """

    _largest: ClassVar[float] = 1e100

    def __init__(self, joints: Sequence[str], control: str) -> None:
        super().__init__(joints, COMMANDS[control])

    def position_from_ros(self, msg: Any) -> tuple[Array, Array]:
        """Return q (n,) and dq (n,), 0 where the message has none; raises InvalidMessageError."""
        q = self._pick(msg.position, msg, "position")
        return q, self._pick(msg.velocity, msg, "velocity") if len(msg.velocity) else 0.0 * q

    def effort_from_ros(self, msg: Any) -> Array:
        """Return tau (n,); raises InvalidMessageError."""
        return self._pick(msg.effort, msg, "effort")


def _twist_from_ros(twists: Sequence[Any]) -> tuple[Array, Array]:
    """Return linear and angular part (3,) of the only element; zeros if there is none."""
    if not twists:
        return np.zeros(3), np.zeros(3)
    return vector_from_ros(twists[0].linear), vector_from_ros(twists[0].angular)


def motion_from_ros(
    msg: Any, base_frame: str, tip_frame: str, lasting: float
) -> tuple[Trajectory | SetPoint, int | None]:
    """Return the motion of a reference, and its start [ns] (None: at receipt).

    A point without velocities is passed through, at rest at the ends only; one with velocities
    that are 0 rests, one without accelerations has none.  Points without times (all are 0) take
    as long as the limits say.  One point alone rests; at time 0 it is a streamed set-point.

    Args:
        msg: the message.
        base_frame, tip_frame: the frames that it must name.
        lasting: [s] for which a set-point keeps its twist.

    Raises:
        InvalidMessageError: if frames, sizes, times or numbers are wrong.
    """
    _check_frames(msg, base_frame, tip_frame)
    if not msg.points:
        raise InvalidMessageError("the reference has no points; expected at least one")
    if len(msg.points) > MAX_POINTS:
        raise InvalidMessageError(
            f"the reference has {len(msg.points)} points; expected at most {MAX_POINTS}"
        )
    times = [ns_from_ros(point.time_from_start) / 1e9 for point in msg.points]
    frames = [_frame_from_ros(point, i) for i, point in enumerate(msg.points)]
    if times[0] < 0:
        raise InvalidMessageError(
            f"the reference begins at time_from_start {times[0]:g} s; expected 0 or more"
        )
    start = ns_from_ros(msg.header.stamp) or None
    if len(frames) == 1 and times[0] <= 0:
        return SetPoint(frames[0], lasting), start
    for i, (before, t) in enumerate(pairwise(times), start=1):
        if 0 < t - before < _CLOSEST:
            raise InvalidMessageError(
                f"point {i} of the reference comes {t - before:g} s after the one before; expected "
                f"at least {_CLOSEST:g} s"
            )
    known = [len(point.velocities) > 0 for point in msg.points]
    for i, point in enumerate(msg.points):
        if not known[i] and point.accelerations:
            raise InvalidMessageError(
                f"point {i} of the reference has accelerations, and no velocities; expected both, "
                "or neither: then it is passed through"
            )
    try:
        if len(frames) == 1 or (any(times) and all(known)):
            return Trajectory(times, frames), start
        return Poses(times, frames, known), start
    except ConfigurationError as error:
        raise InvalidMessageError(f"the reference is no motion: {error}") from error


def _check_frames(msg: Any, base_frame: str, tip_frame: str) -> None:
    if msg.header.frame_id != base_frame:
        raise InvalidMessageError(
            f"the reference is in the frame '{shown(msg.header.frame_id)}'; expected the base "
            f"frame '{base_frame}'"
        )
    if list(msg.joint_names) != [tip_frame]:
        raise InvalidMessageError(
            f"the reference is for [{_quoted(msg.joint_names)}]; expected the tip frame "
            f"['{tip_frame}']"
        )


def _frame_from_ros(point: Any, index: int) -> DesiredFrame:
    for name, count, least in (
        ("transforms", len(point.transforms), 1),
        ("velocities", len(point.velocities), 0),
        ("accelerations", len(point.accelerations), 0),
    ):
        if not least <= count <= 1:
            raise InvalidMessageError(
                f"point {index} of the reference has {count} {name}; expected "
                f"{'1' if least else '0 or 1'}: that of the tip"
            )
    transform = point.transforms[0]
    vectors = [
        vector_from_ros(transform.translation),
        *_twist_from_ros(point.velocities),
        *_twist_from_ros(point.accelerations),
    ]
    if not _are_possible(vectors):
        raise InvalidMessageError(
            f"point {index} of the reference has a {_fault(vectors)} value: {point}"
        )
    p_d, dp_d, omega_d, ddp_d, domega_d = vectors
    R_d = quaternion_from_ros(transform.rotation).R
    return DesiredFrame(p_d, R_d, dp_d, omega_d, ddp_d, domega_d)


def pose_from_ros(msg: Any, carrier: Placement) -> DesiredFrame:
    """Return the frame at rest of a pose that is stated in a frame, seen from the base.

    Args:
        msg: geometry_msgs/PoseStamped.
        carrier: where the frame of the message is, seen from the base.

    Raises:
        InvalidMessageError: if a value is impossible.
    """
    p = vector_from_ros(msg.pose.position)
    if not _are_possible(p):
        raise InvalidMessageError(f"the pose has a {_fault(p)} position {p.tolist()}")
    R = quaternion_from_ros(msg.pose.orientation).R
    return DesiredFrame(carrier.p + carrier.R @ p, carrier.R @ R)


def twist_from_ros(msg: Any, axes: Array) -> Array:
    """Return a twist (6,) [m/s, rad/s] in the base frame, linear part first.

    Args:
        msg: geometry_msgs/TwistStamped: of the tip, in the axes of a frame.
        axes: (3, 3) of that frame, seen from the base.

    Raises:
        InvalidMessageError: if a value is impossible.
    """
    parts = np.array([vector_from_ros(msg.twist.linear), vector_from_ros(msg.twist.angular)])
    if not _are_possible(parts):
        raise InvalidMessageError(f"the twist has a {_fault(parts)} value: {parts.tolist()}")
    return np.ravel(parts @ axes.T)


def wrench_from_ros(msg: Any, frame_id: str) -> Array:
    """Return force and moment (6,) [N, Nm] of a message in the frame ``frame_id``.

    Raises:
        InvalidMessageError: if the frame is another, or a value is not finite.
    """
    if msg.header.frame_id != frame_id:
        raise InvalidMessageError(
            f"the wrench is in the frame '{shown(msg.header.frame_id)}'; expected '{frame_id}'"
        )
    force, torque = msg.wrench.force, msg.wrench.torque
    wrench = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    if not sum(map(abs, wrench)) <= LARGEST and not _are_possible(wrench):
        raise InvalidMessageError(f"the wrench has a {_fault(wrench)} value: {[*wrench]}")
    return np.array(wrench)
