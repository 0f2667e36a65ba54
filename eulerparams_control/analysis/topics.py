"""The topics of an arm, decoded once into columns on the disk.

A topic is a class here: its type, the rows of numbers that its messages are, and what a recording
has of them.  What is not valid, as the controllers check messages, is left out and counted.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from tempfile import SpooledTemporaryFile
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.compliant import ActingImpedance, CompliantMotion, SensorSeries
from eulerparams_control.analysis.reports import Reports
from eulerparams_control.analysis.series import Efforts, Frames, Series, ShapedMotion
from eulerparams_control.bags.columns import Group, columns
from eulerparams_control.bags.reader import Bag
from eulerparams_control.bags.scan import Messages, RawMessage
from eulerparams_control.errors import BagError, InvalidMessageError
from eulerparams_control.laws.rotations import Array, EulerParameters
from eulerparams_control.messages.from_ros import QUATERNION_NORM_TOLERANCE, motion_from_ros
from eulerparams_control.messages.keys import ACTING, BEGAN, IMPEDANCE, SPRINGS
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.robot import Robot

LATEST = int(np.iinfo(np.int64).max)
"""A time [ns] that none exceeds."""

NO_START = -1
"""Start of a motion that begins at receipt."""

_NOT_OF_ITS_TYPE = InvalidMessageError, LookupError  # a damaged schema has other fields

_BATCH = 8192  # most messages that are decoded at once
_BYTES = 64_000_000  # most bytes that are decoded at once
_IN_MEMORY = 500_000  # [bytes] of a column; a longer one is on the disk
_STRIDE = 4096  # rows between the stamps that are kept in memory to find others
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

    def take(self, index: NDArray[Any]) -> "Rows":
        """Return some of them."""
        values = tuple(column[index] for column in self.values)
        return Rows(self.stamp[index], self.sent[index], values)


class Column:
    """An array that grows by rows, on the disk once it is long."""

    def __init__(self, like: NDArray[Any]) -> None:
        self._file = SpooledTemporaryFile(_IN_MEMORY)  # noqa: SIM115 (it ends with the column)
        self._dtype, self._shape = like.dtype, like.shape[1:]
        self._size = like.dtype.itemsize * math.prod(self._shape)
        self._count = 0

    def __del__(self) -> None:
        """Give the file back; it has no name."""
        self._file.close()

    def __len__(self) -> int:
        return self._count

    def append(self, rows: NDArray[Any]) -> None:
        """Add rows at the end."""
        self._file.seek(self._count * self._size)
        self._file.write(np.ascontiguousarray(rows).tobytes())
        self._count += len(rows)

    def rows(self, begin: int, end: int) -> NDArray[Any]:
        """Return the rows from one to before another."""
        self._file.seek(begin * self._size)
        data = bytearray(self._file.read((end - begin) * self._size))
        return np.frombuffer(data, self._dtype).reshape(end - begin, *self._shape)

    def take(self, index: NDArray[np.intp]) -> NDArray[Any]:
        """Return the rows (K,) of an index."""
        first = int(index.min(initial=len(self)))
        return self.rows(first, int(index.max(initial=first - 1)) + 1)[index - first]


def _differ(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.bool_]:
    """Return in which rows (N,) two arrays differ; NaN is equal to NaN."""
    same = (one == other) | (np.isnan(one) & np.isnan(other))
    differ: NDArray[np.bool_] = ~same.reshape(len(one), -1).all(axis=1)
    return differ


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
    rows = (column.reshape(len(column), -1) for column in values)
    return np.all([np.isfinite(row).all(axis=1) for row in rows], axis=0)


class RecordedArm(Protocol):
    """What a topic needs of its arm."""

    robot: Robot
    namespace: str
    others: set[str]
    topics: dict[str, str]


class RecordedTopic:
    """Messages of a topic, decoded in batches.

    Args:
        bag: the bag.
        arm: of which the topic is.

    Attributes:
        name: of the topic, without a namespace.
        type: of its messages.
        is_timed: whether each part of a run has the rows of its time.
        is_steady: whether it goes on for as long as joint_states do.
        is_lasting: whether a message counts until the next one.
        field: of the recording that has them; "": they are among its ``others``, by name.
        invalid: how many messages were not valid.
        repeated: how many had the stamp of another one, but not its values.
        jumped: when the message was sent [ns] at which the stamps jump back; None if they do not.
        latest: largest stamp [ns] so far; -1 if there is none.
    """

    registry: ClassVar[dict[str, type["RecordedTopic"]]] = {}
    name: ClassVar[str] = ""
    type: ClassVar[str] = ""
    is_timed: ClassVar[bool] = True
    is_steady: ClassVar[bool] = True
    is_lasting: ClassVar[bool] = False
    field: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        """Register a topic by its name."""
        if cls.name:
            RecordedTopic.registry[cls.name] = cls

    def __init__(self, bag: Bag, arm: RecordedArm) -> None:
        self._bag, self._robot = bag, arm.robot
        self._topic = arm.topics[self.name]
        self._raw: tuple[list[int], list[bytes]] = [], []  # when they were sent, and what
        self._bytes = 0
        self._columns: list[Column] = []  # stamp, sent, and the values
        self._is_ordered = True
        self._landmarks = np.zeros(0, np.int64)
        self.invalid = self.repeated = 0
        self.latest = -1
        self.jumped: int | None = None

    def rows_of(self, group: Group) -> Columns:
        """Return the columns of messages of one layout; raises InvalidMessageError."""
        raise NotImplementedError

    def is_valid(self, values: Columns) -> NDArray[np.bool_]:
        """Return which rows (N,) are of numbers that can be used."""
        return finite(values)

    def series(self, rows: Rows, t: Array, desired: Frames) -> Any:
        """Return what a recording has of rows (N,), given their times [s] and desired frames."""
        return t, *rows.values

    def groups(self, sent: Stamps, messages: Sequence[bytes]) -> Iterator[tuple[Group, Stamps]]:
        """Yield messages of one layout each, and when [ns] they were sent."""
        for group in columns(self._bag.schema(self._topic), messages):
            yield group, sent[group.index]

    def parse(self, sent: Stamps, messages: Sequence[bytes]) -> tuple[list[Columns], int]:
        """Return stamp, sent and values of messages, and how many of them are valid."""
        found = []
        for group, times in self.groups(sent, messages):
            try:
                values, stamp = self.rows_of(group), stamps_of(group)
            except _NOT_OF_ITS_TYPE:
                continue
            good = self.is_valid(values)
            found.append([column[good] for column in (stamp, times, *values)])
        return found, sum(len(stamp) for stamp, *_ in found)

    def message(self, sent: int, data: bytes) -> Any:
        """Return the fields of a message; raises BagError."""
        return self._bag.decode(RawMessage(self._topic, sent, sent, data))

    def add(self, messages: Messages) -> None:
        """Take messages."""
        sent, data = self._raw
        sent += [published or logged for _, logged, published, _ in zip(*messages, strict=True)]
        data += messages.data
        self._bytes += sum(map(len, messages.data))
        if len(data) >= _BATCH or self._bytes >= _BYTES:
            self.decode()

    def decode(self) -> None:
        """Decode what was read."""
        (sent, data), self._raw, self._bytes = self._raw, ([], []), 0
        found, valid = self.parse(np.array(sent), data) if data else ([], 0)
        self.invalid += len(data) - valid
        if not found:
            return
        new = [np.concatenate(parts) for parts in zip(*found, strict=True)]
        order = np.argsort(new[1], kind="stable")
        self._append([column[order] for column in new])

    def _append(self, new: Columns) -> None:
        """Take rows in the order of sending; note where the clock, or the simulator, restarted."""
        stamp, sent = new[:2]
        self._columns = self._columns or list(map(Column, new))
        for column, rows in zip(self._columns, new, strict=True):
            column.append(rows)
        before = np.maximum.accumulate(np.concatenate(([self.latest], stamp)))
        back = np.flatnonzero(stamp < before[:-1] - _BACK)
        if self.jumped is None and len(back):
            self.jumped = int(sent[back[0]])
        self._is_ordered &= bool((stamp > before[:-1]).all())
        self.latest = int(before[-1])

    def settle(self, until: int = LATEST) -> None:
        """Put the rows in order, without those sent at a time [ns] or later."""
        if not self._columns:
            return
        if not self._is_ordered or until < LATEST:
            self._rewrite(self._order(until))
        count = len(self._columns[0])
        marks = (self._columns[0].rows(k, k + 1) for k in range(0, count, _STRIDE))
        self._landmarks = np.concatenate([np.zeros(0, np.int64), *marks])

    def _order(self, until: int) -> NDArray[np.intp]:
        """Return the places of the rows in order: by stamp, the first of each; counts the others.

        A robot that waits in lock-step sends a state again: that is no loss.
        """
        stamp, sent = (column.rows(0, len(column)) for column in self._columns[:2])
        before = sent < until
        if until < LATEST:  # after a restart others may speak before the states do
            before &= stamp >= np.maximum.accumulate(stamp) - _BACK
        kept = np.flatnonzero(before)
        _, first, which = np.unique(stamp[kept], return_index=True, return_inverse=True)
        others = np.setdiff1d(np.arange(len(kept)), first)
        for k in range(0, len(others), _STRIDE):
            some = others[k : k + _STRIDE]
            pairs = kept[some], kept[first[which[some]]]
            differ = [_differ(*map(column.take, pairs)) for column in self._columns[2:]]
            self.repeated += int(np.any(differ, axis=0).sum())
        return kept[first]

    def _rewrite(self, order: NDArray[np.intp]) -> None:
        for place, old in enumerate(self._columns):
            self._columns[place] = new = Column(old.rows(0, 0))
            for k in range(0, len(order), _STRIDE):
                new.append(old.take(order[k : k + _STRIDE]))

    def __len__(self) -> int:
        return len(self._columns[0]) if self._columns else 0

    def rows(self, begin: int = 0, end: int | None = None) -> Rows:
        """Return the rows from one to before another; once they are settled."""
        end = len(self) if end is None else end
        stamp, sent, *values = (column.rows(begin, end) for column in self._columns)
        return Rows(stamp, sent, tuple(values))

    def times(self) -> tuple[Stamps, Stamps]:
        """Return stamp and time of sending (N,) [ns] of all rows."""
        if not self._columns:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        stamp, sent = (column.rows(0, len(self)) for column in self._columns[:2])
        return stamp, sent

    def stamp(self, place: int) -> int:
        """Return the stamp [ns] of a row."""
        return int(self._columns[0].rows(place, place + 1)[0])

    def after(self, stamp: int) -> int:
        """Return the place behind the last row up to a stamp [ns]."""
        near = int(np.searchsorted(self._landmarks, stamp, side="right"))
        if not near:
            return 0
        begin = (near - 1) * _STRIDE
        stamps = self._columns[0].rows(begin, min(begin + _STRIDE, len(self)))
        return begin + int(np.searchsorted(stamps, stamp, side="right"))


class JointStates(RecordedTopic):
    """q and dq of the arm (N, n); velocities may be missing."""

    name = "joint_states"
    type = "sensor_msgs/msg/JointState"
    field = "measured"
    fields: ClassVar[tuple[str, ...]] = ("position", "velocity")

    def rows_of(self, group: Group) -> Columns:
        """See RecordedTopic."""
        return [*joint_rows(group, self._robot.joints, self.fields)]

    def is_valid(self, values: Columns) -> NDArray[np.bool_]:
        """See RecordedTopic."""
        return finite(values[:1])

    def series(self, rows: Rows, t: Array, desired: Frames) -> Any:
        """See RecordedTopic."""
        q, dq = rows.values
        return Series(self._robot, t, q, dq, desired)


class JointReferences(JointStates):
    """Commanded positions and velocities."""

    name = "joint_reference"
    field = "command"


class JointEfforts(JointStates):
    """Commanded efforts (N, n)."""

    name = "joint_effort"
    field = "effort"
    fields = ("effort",)

    def series(self, rows: Rows, t: Array, desired: Frames) -> Any:
        """See RecordedTopic."""
        return Efforts(t, *rows.values)


class SensedWrenches(RecordedTopic):
    """Force and moment (N, 6), and numbers of the frames that they are in."""

    name = "wrench"
    type = "geometry_msgs/msg/WrenchStamped"
    field = "sensed"

    def __init__(self, bag: Bag, arm: RecordedArm) -> None:
        super().__init__(bag, arm)
        self._frames: dict[str, int] = {}

    def rows_of(self, group: Group) -> Columns:
        """See RecordedTopic."""
        paths = [f"wrench.{part}.{axis}" for part in ("force", "torque") for axis in "xyz"]
        w = np.column_stack([group.numbers[path] for path in paths])
        frame = self._frames.setdefault(group.texts["header.frame_id"], len(self._frames))
        return [w, np.full(len(w), frame)]

    def series(self, rows: Rows, t: Array, desired: Frames) -> Any:
        """See RecordedTopic."""
        w, frame = rows.values
        return SensorSeries(t, w, np.array([*self._frames], dtype=object)[frame])


class TargetWrenches(SensedWrenches):
    """What the tool is to exert: force and moment (N, 6), and the frames that they are in."""

    name = "target_wrench"
    is_steady = False  # who sends it may end it
    field = "targets"


class PublishedImpedance(RecordedTopic):
    """M, D, K of the impedance, clips of springs (N, 38), by name; 0 what one has not."""

    name = "impedance"
    is_steady = False  # once a second while it stays the same
    is_lasting = True
    type = "sensor_msgs/msg/JointState"
    field = "acting"

    def rows_of(self, group: Group) -> Columns:
        """See RecordedTopic."""
        names = SPRINGS if SPRINGS[-1] in group.texts["name"] else IMPEDANCE
        (values,) = joint_rows(group, names, ("position",))
        rows = np.zeros((len(values), len(ACTING)))
        rows[:, [ACTING.index(name) for name in names]] = values
        return [rows]

    def series(self, rows: Rows, t: Array, desired: Frames) -> Any:
        """See RecordedTopic."""
        return ActingImpedance(t, *rows.values)


class ShapedFrames(RecordedTopic):
    """The columns of :class:`Frames`."""

    name = "desired"
    is_steady = False  # none while a fault lasts
    type = "trajectory_msgs/msg/MultiDOFJointTrajectory"
    field = "shaped"

    def rows_of(self, group: Group) -> Columns:
        """See RecordedTopic."""
        return [*frame_rows(group, self._robot.base_frame, self._robot.tip_frame)]

    def series(self, rows: Rows, t: Array, desired: Frames) -> Any:
        """See RecordedTopic."""
        return ShapedMotion(t, desired, Frames(*rows.values))


class CompliantFrames(ShapedFrames):
    """The compliant frame."""

    name = "compliant_frame"
    is_steady = True
    field = "compliant"

    def series(self, rows: Rows, t: Array, desired: Frames) -> Any:
        """See RecordedTopic."""
        return CompliantMotion(t, Frames(*rows.values), desired)


class SentReferences(ShapedFrames):
    """Start and first frame of references, in the order of sending.

    Attributes:
        trajectories: of those that are no set-points, by the time of sending [ns].
    """

    name = "reference"
    is_timed = False

    def __init__(self, bag: Bag, arm: RecordedArm) -> None:
        super().__init__(bag, arm)
        self.trajectories: dict[int, Trajectory] = {}

    def parse(self, sent: Stamps, messages: Sequence[bytes]) -> tuple[list[Columns], int]:
        """Return start, time of sending and first frame of references."""
        found: list[Columns] = []
        for group, times in self.groups(sent, messages):
            try:
                is_simple = is_set_point(group) and not _later(group).any()
                values = self.rows_of(group) if is_simple else []
                stamp = stamps_of(group)
            except _NOT_OF_ITS_TYPE:
                continue
            if is_simple:
                good, starts = self.is_valid(values), np.where(stamp > 0, stamp, NO_START)
                found.append([column[good] for column in (starts, times, *values)])
                continue
            for index, at in zip(group.index.tolist(), times.tolist(), strict=True):
                found += self._one(at, messages[index])
        return found, sum(len(starts) for starts, *_ in found)

    def _one(self, sent: int, data: bytes) -> list[Columns]:
        frames = self._robot.base_frame, self._robot.tip_frame
        try:
            motion, start = motion_from_ros(self.message(sent, data), *frames, 0.0)
        except (InvalidMessageError, BagError):
            return []  # the controller refused it too
        if not isinstance(motion, SetPoint):
            self.trajectories[sent] = motion
        times = np.array([start or NO_START]), np.array([sent])
        return [[*times, *Frames.of([motion.frames[0]]).columns]]

    def settle(self, until: int = LATEST) -> None:
        """See RecordedTopic."""
        self._is_ordered = False
        super().settle(until)

    def _order(self, until: int) -> NDArray[np.intp]:
        """Return the places of the rows in the order of sending."""
        _, sent = self.times()
        order = np.argsort(sent, kind="stable")
        return order[sent[order] < until]

    def frames(self, index: NDArray[np.intp]) -> Frames:
        """Return the first frames of some of them."""
        return Frames(*(column.take(index) for column in self._columns[2:]))


class Diagnostics(RecordedTopic):
    """Reports of the nodes, and when references began.

    Attributes:
        reports: of the nodes.
        began: stamps [ns] at which references began, by the time of sending of the news.
    """

    name = "diagnostics"
    type = "diagnostic_msgs/msg/DiagnosticArray"
    is_timed = False

    def __init__(self, bag: Bag, arm: RecordedArm) -> None:
        super().__init__(bag, arm)
        self._namespace, self._others = arm.namespace, arm.others
        self.reports = Reports(arm.topics.get(ShapedFrames.name, "").rpartition("/")[0])
        self.began: dict[int, int] = {}
        self._begins: set[str] = set()

    def parse(self, sent: Stamps, messages: Sequence[bytes]) -> tuple[list[Columns], int]:
        """Keep the reports; there are no rows."""
        valid = 0
        for at, data in zip(sent.tolist(), messages, strict=True):
            try:
                decoded = self.message(at, data)
            except BagError:
                continue
            valid += 1
            for status in decoded.status:
                of = f"/{status.name.lstrip('/')}".rpartition("/")[0]
                if of == self._namespace:
                    self._note(status, at)
                if not any(_is_of(other, of) for other in self._others):
                    self.reports.add(status, at)
        return [], valid

    def _note(self, status: Any, sent: int) -> None:
        for value in status.values:
            if value.key == BEGAN and value.value not in self._begins and _is_stamp(value.value):
                self._begins.add(value.value)
                self.began[sent] = int(value.value)

    def settle(self, until: int = LATEST) -> None:
        """Forget what was sent at a time [ns] or later."""
        self.reports.drop_after(until)
        self.began = {sent: stamp for sent, stamp in self.began.items() if sent < until}


def _is_of(arm: str, namespace: str) -> bool:
    """Return whether what is in a namespace is of an arm; one without has only what is in none."""
    return namespace == arm or (arm != "" and namespace.startswith(f"{arm}/"))


def _is_stamp(text: str) -> bool:
    """Return whether a text is a time [ns] as stamps have it."""
    return text.isascii() and text.isdecimal() and len(text) <= 19 and int(text) < LATEST


def _later(group: Group) -> NDArray[np.bool_]:
    """Return which set-points are to be reached later (N,)."""
    seconds = group.numbers["points[0].time_from_start.sec"]
    return (seconds > 0) | (group.numbers["points[0].time_from_start.nanosec"] > 0)
