"""The topics of an arm as arrays: what is not valid, as controllers check messages, is left out."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.reports import namespace_of
from eulerparams_control.analysis.series import Frames
from eulerparams_control.analysis.stacks import over
from eulerparams_control.bags.columns import Group, columns
from eulerparams_control.bags.reader import Bag
from eulerparams_control.bags.scan import Messages, RawMessage
from eulerparams_control.errors import BagError, InvalidMessageError
from eulerparams_control.laws.rotations import Array, R_quaternion
from eulerparams_control.messages.from_ros import QUATERNION_NORM_TOLERANCE, motion_from_ros
from eulerparams_control.messages.keys import ACTING, IMPEDANCE, SPRINGS
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.robot import Robot

LATEST = int(np.iinfo(np.int64).max)
"""A time [ns] that none exceeds."""

NO_START = -1
"""Start of a motion that begins at receipt."""

_NOT_OF_ITS_TYPE = InvalidMessageError, LookupError  # a damaged schema has other fields
_BATCH = 8192  # messages that are decoded at once
_BACK = 100_000_000  # [ns] largest step back of a stamp that is no jump: messages overtake

type Stamps = NDArray[np.int64]
type Columns = list[NDArray[Any]]


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

    def __len__(self) -> int:
        return len(self.stamp)

    @classmethod
    def none(cls) -> "Rows":
        """Return no rows."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), ())

    def take(self, index: NDArray[Any]) -> "Rows":
        """Return some of them."""
        values = tuple(column[index] for column in self.values)
        return Rows(self.stamp[index], self.sent[index], values)


# --- messages of one layout as columns --------------------------------------------------------
def stamps_of(group: Group) -> Stamps:
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


def _motion(group: Group, robot: Robot) -> Columns:
    """Return q and dq (N, n); velocities may be missing."""
    return [*joint_rows(group, robot.joints, ("position", "velocity"))]


def _efforts(group: Group, robot: Robot) -> Columns:
    return [*joint_rows(group, robot.joints, ("effort",))]


def _wrenches(group: Group, _robot: Robot) -> Columns:
    """Return force and moment (N, 6), and the names of the frames that they are in."""
    paths = [f"wrench.{part}.{axis}" for part in ("force", "torque") for axis in "xyz"]
    w = np.column_stack([group.numbers[path] for path in paths])
    return [w, np.full(len(w), group.texts["header.frame_id"], dtype=object)]


def _impedances(group: Group, _robot: Robot) -> Columns:
    """Return M, D, K of the impedance, clips of springs (N, 38), by name; 0 what one has not."""
    names = SPRINGS if SPRINGS[-1] in group.texts["name"] else IMPEDANCE
    (values,) = joint_rows(group, names, ("position",))
    rows = np.zeros((len(values), len(ACTING)))
    rows[:, [ACTING.index(name) for name in names]] = values
    return [rows]


def _frames(group: Group, robot: Robot) -> Columns:
    """Return the columns of :class:`Frames` of set-points; p is NaN where one is not valid.

    Raises:
        InvalidMessageError: if they are of other frames.
    """
    texts = group.texts
    if texts["header.frame_id"] != robot.base_frame or texts["joint_names"] != [robot.tip_frame]:
        raise InvalidMessageError(
            f"it is for {texts['joint_names']} in '{texts['header.frame_id']}'; expected "
            f"['{robot.tip_frame}'] in '{robot.base_frame}'"
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
    p = vector("transforms[0].translation")
    R = over(R_quaternion, xyzw[:, 3], xyzw[:, :3], shape=(3, 3))
    parts = [f"{kind}[0].{of}" for kind in ("velocities", "accelerations") for of in _TWIST]
    rates = list(map(vector, parts))
    p[~np.all([_finite(column) for column in (R, *rates)], axis=0)] = np.nan
    return [p, R, *rates]


_TWIST = "linear", "angular"


def _finite(column: NDArray[Any]) -> NDArray[np.bool_]:
    """Return in which rows (N,) all numbers are finite."""
    found: NDArray[np.bool_] = np.isfinite(column.reshape(len(column), -1)).all(axis=1)
    return found


def _differ(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.bool_]:
    """Return in which rows (N,) two arrays differ; NaN is equal to NaN."""
    same = (one == other) | ((one != one) & (other != other))
    differ: NDArray[np.bool_] = ~same.reshape(len(one), -1).all(axis=1)
    return differ


# --- topics --------------------------------------------------------------------------------------
class Kind(NamedTuple):
    """A topic whose messages are looked at by their stamps.

    Attributes:
        type: of its messages.
        columns: makes columns of messages of one layout; a row counts if the first is finite.
        is_steady: whether it goes on for as long as joint_states do.
    """

    type: str
    columns: Callable[[Group, Robot], Columns]
    is_steady: bool = True


_JOINT_STATE = "sensor_msgs/msg/JointState"
_WRENCH = "geometry_msgs/msg/WrenchStamped"
_TRAJECTORY = "trajectory_msgs/msg/MultiDOFJointTrajectory"

TIMED: Mapping[str, Kind] = {
    "joint_states": Kind(_JOINT_STATE, _motion),
    "joint_reference": Kind(_JOINT_STATE, _motion),
    "joint_effort": Kind(_JOINT_STATE, _efforts),
    "wrench": Kind(_WRENCH, _wrenches),
    "target_wrench": Kind(_WRENCH, _wrenches, is_steady=False),  # who sends it may end it
    "impedance": Kind(_JOINT_STATE, _impedances, is_steady=False),  # once a second
    "desired": Kind(_TRAJECTORY, _frames, is_steady=False),  # none while a fault lasts
    "compliant_frame": Kind(_TRAJECTORY, _frames),
}
"""By the names of the topics, without a namespace."""

TYPES: Mapping[str, str] = {
    **{name: kind.type for name, kind in TIMED.items()},
    "reference": _TRAJECTORY,
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "robot_description": "std_msgs/msg/String",
}
"""Of all topics that are read of a bag."""


class RecordedTopic:
    """Messages of a topic, decoded in batches while the bag is read.

    Args:
        bag: the bag.
        topic: its name in the bag.
        robot: of the arm.
        columns: see :class:`Kind`.

    Attributes:
        invalid: how many messages were not valid.
        repeated: how many had the stamp of another one, but not its values.
        first, latest: the first and the largest stamp [ns] so far; ``LATEST`` and -1 without one.
        rows: those that are valid; None if there are none.
    """

    def __init__(
        self, bag: Bag, topic: str, robot: Robot, columns: Callable[[Group, Robot], Columns]
    ) -> None:
        self._bag, self._topic, self._robot, self._columns = bag, topic, robot, columns
        self._sent: list[int] = []
        self._data: list[bytes] = []
        self._parts: list[Columns] = []  # stamp, sent, and the values
        self.invalid = self.repeated = 0
        self.first, self.latest = LATEST, -1
        self.rows: Rows | None = None

    def add(self, messages: Messages) -> None:
        """Take messages."""
        times = zip(messages.publish_times, messages.log_times, strict=True)
        self._sent += [published or logged for published, logged in times]
        self._data += messages.data
        if len(self._data) >= _BATCH:
            self._decode()

    def _decode(self) -> None:
        sent, data = np.array(self._sent, dtype=np.int64), self._data
        self._sent, self._data = [], []
        found = list(self._parse(sent, data))
        self.invalid += len(data) - sum(len(stamp) for stamp, *_ in found)
        for stamp, *_ in found:
            if self.first == LATEST and len(stamp):
                self.first = int(stamp[0])
            self.latest = max(self.latest, int(stamp.max(initial=-1)))
        self._parts += found

    def _parse(self, sent: Stamps, messages: Sequence[bytes]) -> Iterator[Columns]:
        """Yield stamp, sent and values of the messages that are valid."""
        for group in columns(self._bag.schema(self._topic), messages):
            try:
                values, stamp = self._columns(group, self._robot), stamps_of(group)
            except _NOT_OF_ITS_TYPE:
                continue
            good = _finite(values[0])
            yield [column[good] for column in (stamp, sent[group.index], *values)]

    def _message(self, sent: int, data: bytes) -> Any:
        """Return the fields of a message; raises BagError."""
        return self._bag.decode(RawMessage(self._topic, sent, sent, data))

    def finish(self) -> None:
        """Decode the rest, and join all in the order of sending."""
        if self._data:
            self._decode()
        if self._parts:
            stamp, sent, *values = map(np.concatenate, zip(*self._parts, strict=True))
            self._parts = []
            rows = Rows(stamp, sent, tuple(values)).take(np.argsort(sent, kind="stable"))
            self.rows = rows if len(rows) else None

    def jump(self) -> int:
        """Return when the message was sent [ns] at which the clock jumped back; else LATEST."""
        if self.rows is None:
            return LATEST
        latest = np.maximum.accumulate(np.append(-1, self.rows.stamp))[:-1]
        back = np.flatnonzero(self.rows.stamp < latest - _BACK)
        return int(self.rows.sent[back[0]]) if len(back) else LATEST

    def settle(self, until: int) -> None:
        """Put the rows in order, without those sent at a time [ns] or later.

        A robot that waits in lock-step sends a state again: that is no loss.
        """
        if self.rows is None:
            return
        stamp, before = self.rows.stamp, np.ones(len(self.rows), dtype=bool)
        if until < LATEST:  # after a restart others may speak before the states do
            before = self.rows.sent < until
            before &= stamp >= np.maximum.accumulate(stamp) - _BACK
        kept = self.rows.take(before)
        _, first, which = np.unique(kept.stamp, return_index=True, return_inverse=True)
        self.rows = kept.take(first) if len(first) else None
        pairs = ((column, column[first[which]]) for column in kept.values)
        self.repeated = int(np.any([_differ(*pair) for pair in pairs], axis=0).sum())


@dataclass(frozen=True)
class RecordedReferences:
    """K references in the order in which they were sent.

    Attributes:
        sent: (K,) [ns].
        start: (K,) [ns] when they begin; ``NO_START`` is at the first tick after they were sent.
        frames: the first frame of each; a set-point has no other.
        trajectories: those that are no set-points, by place.
    """

    sent: Stamps
    start: Stamps
    frames: Frames = field(repr=False)
    trajectories: Mapping[int, Trajectory] = field(repr=False)


class SentReferences(RecordedTopic):
    """Start and first frame of references, in the order of sending.

    Attributes:
        trajectories: of those that are no set-points, by the time of sending [ns].
    """

    def __init__(self, bag: Bag, topic: str, robot: Robot) -> None:
        super().__init__(bag, topic, robot, _frames)
        self.trajectories: dict[int, Trajectory] = {}

    def _parse(self, sent: Stamps, messages: Sequence[bytes]) -> Iterator[Columns]:
        """Yield start, time of sending and first frame of references."""
        for group in columns(self._bag.schema(self._topic), messages):
            try:
                is_simple = _is_set_point(group) and not _later(group).any()
                values = self._columns(group, self._robot) if is_simple else []
                stamp = stamps_of(group)
            except _NOT_OF_ITS_TYPE:
                continue
            if is_simple:
                good, starts = _finite(values[0]), np.where(stamp > 0, stamp, NO_START)
                yield [column[good] for column in (starts, sent[group.index], *values)]
                continue
            for index in group.index.tolist():
                yield from self._one(int(sent[index]), messages[index])

    def _one(self, sent: int, data: bytes) -> Iterator[Columns]:
        frames = self._robot.base_frame, self._robot.tip_frame
        try:
            motion, start = motion_from_ros(self._message(sent, data), *frames, 0.0)
        except (InvalidMessageError, BagError):
            return  # the controller refused it too
        if not isinstance(motion, SetPoint):
            self.trajectories[sent] = motion
        times = np.array([start or NO_START]), np.array([sent])
        yield [*times, *Frames.of([motion.frames[0]]).columns]

    def settle(self, until: int) -> None:
        """Drop those sent at a time [ns] or later."""
        if self.rows is not None:
            self.rows = self.rows.take(self.rows.sent < until)

    def references(self, starts: Mapping[int, int]) -> RecordedReferences:
        """Return all of them.

        Args:
            starts: see ``reference_starts``.
        """
        if self.rows is None:
            none = Rows.none()
            return RecordedReferences(none.sent, none.stamp, Frames.nowhere(0), {})
        sent, start = self.rows.sent, self.rows.stamp.copy()
        for stamp, reported in starts.items():
            before = int(np.searchsorted(sent, reported, side="right"))
            if before:
                start[before - 1] = stamp
        found = {
            k: motion
            for at, motion in self.trajectories.items()
            for k in np.flatnonzero(sent == at).tolist()
        }
        return RecordedReferences(sent, start, Frames(*self.rows.values), found)


def _is_set_point(group: Group) -> bool:
    """Whether messages have one point with one transform and at most one twist of each kind."""
    texts = group.texts
    if texts.get("points") != 1 or texts["points[0].transforms"] != 1:
        return False
    return bool(max(texts["points[0].velocities"], texts["points[0].accelerations"]) <= 1)


def _later(group: Group) -> NDArray[np.bool_]:
    """Return which set-points are to be reached later (N,)."""
    seconds = group.numbers["points[0].time_from_start.sec"]
    return (seconds > 0) | (group.numbers["points[0].time_from_start.nanosec"] > 0)


class Diagnostics:
    """The statuses of the nodes of an arm.

    Args:
        bag, topic: as of :class:`RecordedTopic`.
        others: namespaces of other arms in the bag.

    Attributes:
        statuses: when [ns] each DiagnosticStatus was sent, and the status.
        invalid, repeated: as of :class:`RecordedTopic`.
    """

    def __init__(self, bag: Bag, topic: str, others: set[str]) -> None:
        self._bag, self._topic, self._others = bag, topic, others
        self.statuses: list[tuple[int, Any]] = []
        self.invalid = self.repeated = 0

    def add(self, messages: Messages) -> None:
        """Take messages."""
        for _, logged, published, data in zip(*messages, strict=True):
            sent = published or logged
            try:
                decoded = self._bag.decode(RawMessage(self._topic, logged, sent, data))
            except BagError:
                self.invalid += 1
                continue
            for status in decoded.status:
                of = namespace_of(status)
                if not any(_is_of(other, of) for other in self._others):
                    self.statuses.append((sent, status))


def _is_of(arm: str, namespace: str) -> bool:
    """Return whether what is in a namespace is of an arm; one without has only what is in none."""
    return namespace == arm or (arm != "" and namespace.startswith(f"{arm}/"))
