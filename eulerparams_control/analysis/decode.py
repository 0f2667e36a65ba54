"""From the columns of messages to rows of numbers, checked as the controllers check messages.

What is not valid is left out and counted.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.desired import NO_START, Stamps
from eulerparams_control.analysis.frames import Frames
from eulerparams_control.bags.columns import Group
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array, EulerParameters
from eulerparams_control.messages.from_ros import QUATERNION_NORM_TOLERANCE, motion_from_ros
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import Trajectory


@dataclass(frozen=True)
class Rows:
    """N messages as numbers.

    Attributes:
        stamp: (N,) [ns] of their headers.
        sent: (N,) [ns] when they were sent.
        values: arrays with N rows, what is in them depends on the topic.
    """

    stamp: Stamps
    sent: Stamps
    values: tuple[NDArray[Any], ...] = field(repr=False)

    def take(self, index: NDArray[Any]) -> "Rows":
        """Return some of them."""
        values = tuple(column[index] for column in self.values)
        return Rows(self.stamp[index], self.sent[index], values)

    def by_stamp(self) -> tuple["Rows", int]:
        """Return them by increasing stamp, the first of each; and how many others differ from it.

        A robot that waits in lock-step sends a state again: that is no loss.
        """
        stamps, first, which = np.unique(self.stamp, return_index=True, return_inverse=True)
        if len(stamps) == len(self.stamp):
            return self.take(first), 0
        pairs = ((column, column[first][which]) for column in self.values)
        differs = [_differ(column, kept) for column, kept in pairs]
        return self.take(first), int(np.any(differs, axis=0).sum())

    def in_order(self) -> "Rows":
        """Return them in the order in which they were sent."""
        return self.take(np.argsort(self.sent, kind="stable"))


def _differ(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.bool_]:
    """Return in which rows (N,) two arrays differ; NaN is equal to NaN."""
    n = len(one)
    if one.dtype == object:
        return np.asarray(one != other, dtype=bool).reshape(n)
    same = (one == other) | (np.isnan(one) & np.isnan(other))
    differ: NDArray[np.bool_] = ~same.reshape(n, -1).all(axis=1)
    return differ


def joined(parts: Sequence[Rows]) -> Rows:
    """Return rows one after the other; at least one part."""
    values = zip(*(part.values for part in parts), strict=True)
    return Rows(
        np.concatenate([part.stamp for part in parts]),
        np.concatenate([part.sent for part in parts]),
        tuple(map(np.concatenate, values)),
    )


def stamps(group: Group) -> Stamps:
    """Return the stamps (N,) [ns] of messages with a header."""
    seconds = group.numbers["header.stamp.sec"].astype(np.int64)
    found: Stamps = seconds * 1_000_000_000 + group.numbers["header.stamp.nanosec"]
    return found


def joint_rows(group: Group, joints: Sequence[str], fields: Sequence[str]) -> list[Array]:
    """Return values (N, n) of the joints by name, for each of the fields of JointState.

    A field after the first is NaN where it is empty.

    Raises:
        InvalidMessageError: if a joint is missing, or there are not as many values as names.
    """
    names = group.texts["name"]
    missing = [joint for joint in joints if joint not in names]
    if missing:
        raise InvalidMessageError(f"it lacks the joints {', '.join(missing)}")
    index = np.array([names.index(joint) for joint in joints])
    found = []
    for place, name in enumerate(fields):
        values = group.numbers[name].astype(float)
        if place and not values.shape[1]:
            values = np.full((len(values), len(names)), np.nan)
        if values.shape[1] != len(names):
            raise InvalidMessageError(f"it has {len(names)} names but {values.shape[1]} of {name}")
        found.append(values[:, index])
    return found


def wrench_rows(group: Group) -> list[NDArray[Any]]:
    """Return force and moment (N, 6), and the names of their frames (N,)."""
    paths = [f"wrench.{part}.{axis}" for part in ("force", "torque") for axis in "xyz"]
    w = np.column_stack([group.numbers[path] for path in paths])
    return [w, np.full(len(w), group.texts["header.frame_id"], dtype=object)]


def is_set_point(group: Group) -> bool:
    """Whether messages have one point with one transform and at most one twist of each kind."""
    texts = group.texts
    if texts.get("points") != 1 or texts["points[0].transforms"] != 1:
        return False
    return bool(max(texts["points[0].velocities"], texts["points[0].accelerations"]) <= 1)


def frame_rows(group: Group, base_frame: str, tip_frame: str) -> list[Array]:
    """Return the columns of :class:`Frames` of set-points; NaN where one is not valid.

    Raises:
        InvalidMessageError: if they are of other frames.
    """
    texts = group.texts
    if texts["header.frame_id"] != base_frame or texts["joint_names"] != [tip_frame]:
        raise InvalidMessageError(
            f"it is for {texts['joint_names']} in '{texts['header.frame_id']}'; expected "
            f"['{tip_frame}'] in '{base_frame}'"
        )

    def vector(path: str, axes: str = "xyz") -> Array:
        columns = [group.numbers.get(f"points[0].{path}.{axis}") for axis in axes]
        known = [np.zeros(len(group.index)) if column is None else column for column in columns]
        return np.column_stack(known)

    xyzw = vector("transforms[0].rotation", "xyzw")
    with np.errstate(over="ignore", invalid="ignore"):
        norm = np.linalg.norm(xyzw, axis=1)
    norm[~(np.abs(norm - 1) <= QUATERNION_NORM_TOLERANCE)] = np.nan
    xyzw = xyzw / norm[:, None]
    eta: Any = xyzw[:, 3]
    return [
        vector("transforms[0].translation"),
        EulerParameters(eta, xyzw[:, :3]).R,
        vector("velocities[0].linear"),
        vector("velocities[0].angular"),
        vector("accelerations[0].linear"),
        vector("accelerations[0].angular"),
    ]


def finite(values: Iterable[NDArray[Any]]) -> NDArray[np.bool_]:
    """Return whether all numbers of a row are finite (N,)."""
    numbers = [v.reshape(len(v), -1) for v in values if v.dtype != object]
    return np.all([np.isfinite(v).all(axis=1) for v in numbers], axis=0)


def motion(message: Any, base_frame: str, tip_frame: str) -> tuple[int, Frames, Trajectory | None]:
    """Return start, first frame and trajectory (None: a set-point) of a reference.

    Raises:
        InvalidMessageError: if it is none.
    """
    found, start = motion_from_ros(message, base_frame, tip_frame, 0.0)
    first = Frames.of([found.frames[0]])
    return start or NO_START, first, None if isinstance(found, SetPoint) else found
