"""The topics of an arm, each as a queue of messages that were read of a bag and not used yet.

A topic is a class here: its type, and the rows of numbers that its messages are.
"""

from collections.abc import Iterator
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis import decode
from eulerparams_control.analysis.decode import Rows, joined
from eulerparams_control.analysis.desired import NO_START, RecordedReferences
from eulerparams_control.analysis.frames import Frames
from eulerparams_control.analysis.reports import Reports
from eulerparams_control.bags.columns import Group, columns
from eulerparams_control.bags.reader import Bag, RawMessage
from eulerparams_control.errors import BagError, InvalidMessageError
from eulerparams_control.messages.keys import BEGAN
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.robot import Robot

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
        return decode.finite(values)

    def _groups(self, messages: list[RawMessage]) -> Iterator[Group]:
        schema = self._bag.schema(self._topic)
        return columns(schema, [message.data for message in messages])

    def parse(self, messages: list[RawMessage]) -> tuple[list[Rows], int]:
        """Return rows of messages, and how many of them are valid."""
        sent = np.array([message.publish_time or message.log_time for message in messages])
        found, valid = [], 0
        for group in self._groups(messages):
            try:
                values, stamps = self.rows_of(group), decode.stamps(group)
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
        return [*decode.joint_rows(group, self._robot.joints, self.fields)]

    def is_valid(self, values: list[NDArray[Any]]) -> NDArray[np.bool_]:
        """See Queue."""
        return decode.finite(values[:1])


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
        return decode.wrench_rows(group)


class ShapedFrames(Queue):
    """The columns of :class:`Frames`."""

    name = "desired"
    type = "trajectory_msgs/msg/MultiDOFJointTrajectory"

    def rows_of(self, group: Group) -> list[NDArray[Any]]:
        """See Queue."""
        return [*decode.frame_rows(group, self._robot.base_frame, self._robot.tip_frame)]


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
                is_simple = decode.is_set_point(group) and not _later(group).any()
                values = self.rows_of(group) if is_simple else []
                stamps = decode.stamps(group)
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
            start, frame, trajectory = decode.motion(decoded, robot.base_frame, robot.tip_frame)
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
