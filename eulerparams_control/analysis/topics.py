"""From the columns of messages to rows of numbers, checked as the controllers check messages.

What is not valid is left out and counted.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.desired import NO_START, RecordedReferences, Stamps
from eulerparams_control.analysis.frames import Frames
from eulerparams_control.analysis.reports import Reports
from eulerparams_control.bags.columns import Group, columns
from eulerparams_control.bags.reader import Bag, RawMessage
from eulerparams_control.errors import BagError, InvalidMessageError
from eulerparams_control.laws.rotations import Array, EulerParameters
from eulerparams_control.messages.from_ros import QUATERNION_NORM_TOLERANCE, motion_from_ros
from eulerparams_control.messages.keys import BEGAN
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.robot import Robot


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


LATEST = int(np.iinfo(np.int64).max)
"""A stamp [ns] that none exceeds."""

_NOT_OF_ITS_TYPE = InvalidMessageError, LookupError  # a damaged schema has other fields

_BATCH = 8192  # most messages that are decoded at once
_BYTES = 64_000_000  # most bytes that are decoded at once
_BACK = 100_000_000  # [ns] largest step back of a stamp that is no jump: messages overtake


class RecordedArm(Protocol):
    """What a queue has to know of its arm."""

    robot: Robot
    namespace: str
    others: set[str]
    topics: dict[str, str]


class Queue:
    """Messages of a topic that were read, decoded in batches, and not used yet.

    Args:
        bag: the bag.
        arm: of which the topic is.

    Attributes:
        name: of the topic, without a namespace.
        type: of its messages.
        is_timed: whether each part of a run has the rows of its time.
        invalid: how many messages were not valid.
        repeated: how many had the stamp of another one, but not its values.
        jumped: when the message was sent [ns] at which the stamps jump back; None if they do not.
    """

    registry: ClassVar[dict[str, type["Queue"]]] = {}
    name: ClassVar[str] = ""
    type: ClassVar[str] = ""
    is_timed: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        """Register a topic by its name."""
        if cls.name:
            Queue.registry[cls.name] = cls

    def __init__(self, bag: Bag, arm: RecordedArm) -> None:
        self._bag, self._robot = bag, arm.robot
        self._topic = arm.topics[self.name]
        self._raw: list[RawMessage] = []
        self._bytes = 0
        self._rows: list[Rows] = []
        self._latest = -1
        self.invalid = self.repeated = 0
        self.jumped: int | None = None

    def rows_of(self, group: Group) -> list[NDArray[Any]]:
        """Return the columns of messages of one layout; raises InvalidMessageError."""
        raise NotImplementedError

    def is_valid(self, values: list[NDArray[Any]]) -> NDArray[np.bool_]:
        """Return which rows (N,) are of numbers that can be used."""
        return finite(values)

    def _groups(self, messages: list[RawMessage]) -> Iterator[Group]:
        schema = self._bag.schema(self._topic)
        return columns(schema, [message.data for message in messages])

    def parse(self, messages: list[RawMessage]) -> tuple[list[Rows], int]:
        """Return rows of messages, and how many of them are valid."""
        sent = np.array([message.publish_time or message.log_time for message in messages])
        found, valid = [], 0
        for group in self._groups(messages):
            try:
                values, stamps = self.rows_of(group), stamps_of(group)
            except _NOT_OF_ITS_TYPE:
                continue
            good = self.is_valid(values)
            rows = Rows(stamps, sent[group.index], tuple(values))
            found.append(rows if good.all() else rows.take(good))
            valid += int(good.sum())
        return found, valid

    def add(self, message: RawMessage) -> None:
        """Take a message."""
        self._raw.append(message)
        self._bytes += len(message.data)
        if len(self._raw) >= _BATCH or self._bytes >= _BYTES:
            self.settle()

    def settle(self) -> None:
        """Decode what was read."""
        if not self._raw:
            return
        found, valid = self.parse(self._raw)
        self.invalid += len(self._raw) - valid
        self._raw, self._bytes = [], 0
        if found:
            new = joined(found).in_order()
            self._rows.append(new)
            self._watch(new)

    def _watch(self, new: Rows) -> None:
        """Note where the stamps jump back: the clock, or the simulator, restarted."""
        before = np.maximum.accumulate(np.concatenate(([self._latest], new.stamp)))
        back = np.flatnonzero(new.stamp < before[:-1] - _BACK)
        if self.jumped is None and len(back):
            self.jumped = int(new.sent[back[0]])
        self._latest = int(before[-1])

    def drop_after(self, sent: int) -> None:
        """Forget what was sent at that time [ns] or later."""
        self.settle()
        self._rows = [part.take(part.sent < sent) for part in self._rows]

    def until(self, stamp: int) -> Rows | None:
        """Return the rows up to a stamp; the last of them is kept for the next part."""
        self.settle()
        if not self._rows:
            return None
        everything, repeated = joined(self._rows).by_stamp()
        self.repeated += repeated
        n = int(np.searchsorted(everything.stamp, stamp, side="right"))
        self._rows = [everything.take(np.arange(max(n - 1, 0), len(everything.stamp)))]
        return everything.take(np.arange(n)) if n else None

    @property
    def has_any(self) -> bool:
        """Whether anything valid was read of the topic."""
        return self._latest >= 0

    def nth(self, count: int) -> int:
        """Return the stamp of the row with that number, from 1, or of the last."""
        self.settle()
        stamps = np.unique(np.concatenate([np.zeros(0, np.int64), *(p.stamp for p in self._rows)]))
        return int(stamps[min(count, len(stamps)) - 1]) if len(stamps) else LATEST


class JointStates(Queue):
    """q and dq of the arm (N, n); velocities may be missing."""

    name = "joint_states"
    type = "sensor_msgs/msg/JointState"
    fields: ClassVar[tuple[str, ...]] = ("position", "velocity")

    def rows_of(self, group: Group) -> list[NDArray[Any]]:
        """See Queue."""
        return [*joint_rows(group, self._robot.joints, self.fields)]

    def is_valid(self, values: list[NDArray[Any]]) -> NDArray[np.bool_]:
        """See Queue."""
        return finite(values[:1])


class JointReferences(JointStates):
    """Commanded positions and velocities."""

    name = "joint_reference"


class JointEfforts(JointStates):
    """Commanded efforts (N, n)."""

    name = "joint_effort"
    fields = ("effort",)


class WrenchQueue(Queue):
    """Force and moment (N, 6), and the frames that they are in."""

    name = "wrench"
    type = "geometry_msgs/msg/WrenchStamped"

    def rows_of(self, group: Group) -> list[NDArray[Any]]:
        """See Queue."""
        return wrench_rows(group)


class ShapedFrames(Queue):
    """The columns of :class:`Frames`."""

    name = "desired"
    type = "trajectory_msgs/msg/MultiDOFJointTrajectory"

    def rows_of(self, group: Group) -> list[NDArray[Any]]:
        """See Queue."""
        return [*frame_rows(group, self._robot.base_frame, self._robot.tip_frame)]


class CompliantFrames(ShapedFrames):
    """The compliant frame."""

    name = "compliant_frame"


class SentReferences(ShapedFrames):
    """Start and first frame of references, which are kept until they begin."""

    name = "reference"
    is_timed = False

    def __init__(self, bag: Bag, arm: RecordedArm) -> None:
        super().__init__(bag, arm)
        self._trajectories: dict[int, Trajectory] = {}  # by time of sending [ns]
        self._pending: Rows | None = None

    def parse(self, messages: list[RawMessage]) -> tuple[list[Rows], int]:
        """Return start and first frame of references; their trajectories are kept aside."""
        found, valid = [], 0
        sent = np.array([message.publish_time or message.log_time for message in messages])
        for group in self._groups(messages):
            try:
                is_simple = is_set_point(group) and not _later(group).any()
                values = self.rows_of(group) if is_simple else []
                stamps = stamps_of(group)
            except _NOT_OF_ITS_TYPE:
                continue
            if is_simple:
                good, starts = self.is_valid(values), np.where(stamps > 0, stamps, NO_START)
                found.append(Rows(starts, sent[group.index], tuple(values)).take(good))
                valid += int(good.sum())
                continue
            for index in group.index.tolist():
                one = self._one(messages[index], int(sent[index]))
                found += one
                valid += len(one)
        return found, valid

    def _one(self, message: RawMessage, sent: int) -> list[Rows]:
        robot = self._robot
        try:
            decoded = self._bag.decode(message)
            start, frame, trajectory = motion(decoded, robot.base_frame, robot.tip_frame)
        except (InvalidMessageError, BagError):
            return []  # the controller refused it too
        if trajectory is not None:
            self._trajectories[sent] = trajectory
        return [Rows(np.array([start]), np.array([sent]), frame.columns)]

    def all(self, began: dict[int, int]) -> RecordedReferences:
        """Return those that are not forgotten, in the order in which they were sent.

        Args:
            began: stamps [ns] at which the controller said that one began, by the time of sending
                of the news; they are taken out.
        """
        self.settle()
        parts = [*([] if self._pending is None else [self._pending]), *self._rows]
        self._rows = []
        if not parts:
            return no_references()
        self._pending = found = joined(parts).in_order()
        for news, start in began.items():
            before = int(np.searchsorted(found.sent, news, side="right"))
            if before:
                found.stamp[before - 1] = start
        began.clear()
        sent = enumerate(found.sent.tolist())
        trajectories = {k: self._trajectories[at] for k, at in sent if at in self._trajectories}
        return RecordedReferences(found.sent, found.stamp, Frames(*found.values), trajectories)

    def forget(self, done: int) -> None:
        """Leave out the first of them."""
        if self._pending is None:
            return
        for sent in self._pending.sent[:done].tolist():
            self._trajectories.pop(sent, None)
        left = self._pending.take(np.arange(done, len(self._pending.sent)))
        self._pending = left if len(left.sent) else None


def no_references() -> RecordedReferences:
    """Return those of a run without any."""
    return RecordedReferences(np.zeros(0, np.int64), np.zeros(0, np.int64), Frames.nowhere(0), {})


class Diagnostics(Queue):
    """What the nodes say, which is given on, and when a controller said that a reference began.

    Args:
        bag, arm: see Queue.
        reports: take what the nodes say.

    Attributes:
        began: stamps [ns] at which references began, by the time of sending of the news.
    """

    name = "diagnostics"
    type = "diagnostic_msgs/msg/DiagnosticArray"
    is_timed = False

    def __init__(self, bag: Bag, arm: RecordedArm, reports: Reports) -> None:
        super().__init__(bag, arm)
        self._namespace, self._others, self._reports = arm.namespace, arm.others, reports
        self.began: dict[int, int] = {}
        self._begins: set[str] = set()

    def parse(self, messages: list[RawMessage]) -> tuple[list[Rows], int]:
        """Keep what the nodes say; there are no rows."""
        valid = 0
        for message in messages:
            try:
                decoded = self._bag.decode(message)
            except BagError:
                continue
            valid += 1
            sent = message.publish_time or message.log_time
            for status in decoded.status:
                of = f"/{status.name.lstrip('/')}".rpartition("/")[0]
                if of == self._namespace:
                    self._note(status, sent)
                if not any(_is_of(other, of) for other in self._others):
                    self._reports.add(status, sent)
        return [], valid

    def _note(self, status: Any, sent: int) -> None:
        for value in status.values:
            if value.key == BEGAN and value.value not in self._begins and _is_stamp(value.value):
                self._begins.add(value.value)
                self.began[sent] = int(value.value)


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
