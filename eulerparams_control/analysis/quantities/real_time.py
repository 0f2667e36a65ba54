"""Runs in real time: what was answered, how soon, and what the processes of the nodes take.

The metrics are of the time after the warm-up: see ``analysis.real_time``.
"""

import csv
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.quantities.base import Samples, drawn, metric, quotient
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.bags.reader import Bag
from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.keys import CAUSE, MODE

USAGE = "usage.csv"
"""The file in a bag with what the nodes took; its columns are those of :class:`NodeSample`."""

PATIENCE = 6.0
"""[s] at the end that do not count: by then all reports of the time before have come."""

WARM_UP = 60.0
"""[s] of the beginning that do not count, at most: what is loaded, filled and discovered once.

Of a short run it is a fifth.
"""

BESIDE = ("reference", "bag_recorder")
"""The nodes of a run that no round trip waits for."""

OTHERS = ("pybullet_bridge", *BESIDE)
"""The nodes of a run besides its controller."""

NODES = ("controller", *OTHERS)

_COMMANDS = ("joint_effort", "joint_reference")
_STAMP, _STAMP_AT = struct.Struct("<iI"), 4  # behind the header of the encoding
_PAGE = 60.0  # [s] over which percentiles are taken, at most
QUARTERS = 4
"""Into which the time that counts is divided."""

_AT_ENDS = 10  # samples of memory at each end, whose median counts

# A report comes once a second; on a busy machine the state is read, and the report sent, later [s].
_SLACK = 5.0
_AROUND = 0.25  # [s] from a state to the waits for a processor that count for it
_QUEUE = 10  # states that wait for a controller, by its QoS

# The modes of a controller that commands nothing on purpose, and of one that goes on.
_SILENT = (Mode.RELEASING, Mode.DISTRUSTING)
_ACTIVE = (Mode.WAITING, Mode.HOLDING, Mode.FOLLOWING)


class Unanswered(StrEnum):
    """Why a state was not answered."""

    REFUSED = "refused"  # by the controller, as too late
    OVERRUN = "overrun"  # in the queue of the controller: nobody had a processor
    WITHHELD = "withheld"  # as the arm ran away when nobody had a processor
    UNKNOWN = ""


class NodeSample(NamedTuple):
    """Resources that the process of a node has used so far; NaN where not sampled.

    Attributes:
        t: [ns] when.
        node: its executable.
        pid: of the process.
        waited: [s] the longest for which a thread was ready, but had no processor, since the
            sample before; 0 of those beside.
        rss: [MiB] of memory that it has mapped and touched, shared or not.
        uss: [MiB] of that, what is its own.
        cpu: [s] of processor.
    """

    t: int
    node: str
    pid: int
    waited: float
    rss: float = np.nan
    uss: float = np.nan
    cpu: float = np.nan


class ModeReport(NamedTuple):
    """Report of a controller at t [s]: mode, cause and counters."""

    t: float
    mode: str
    cause: str
    refused: int
    missed: int


class MessageTimes(NamedTuple):
    """N messages: when [ns] they are stamped, were sent and were received."""

    stamp: NDArray[np.int64]
    sent: NDArray[np.int64]
    received: NDArray[np.int64]


def stamped(path: Path, topics: Sequence[str]) -> dict[str, MessageTimes]:
    """Return the times of topics with headers, in one pass of a bag, without decoding the rest."""
    found: dict[str, list[tuple[int, int, int]]] = {topic: [] for topic in topics}
    for message in Bag(path).read_raw(topics):
        second, nanosecond = _STAMP.unpack_from(message.data, _STAMP_AT)
        times = second * 10**9 + nanosecond, message.publish_time, message.log_time
        found[message.topic].append(times)
    return {
        topic: MessageTimes(*np.array(times, dtype=np.int64).reshape(-1, 3).T)
        for topic, times in found.items()
    }


@dataclass(frozen=True)
class RealTimeRun:
    """A run in real time.

    Attributes:
        t: (N,) [s] stamps of joint_states, from the first.
        sent: (N,) [s] when they were sent, from the first sample of the nodes on.
        latency: (N,) [s] of the round trip; NaN where no command answers.
        commands: (M,) [s] when commands were received.
        said: reports of the controller.
        samples: resources that the nodes used.
    """

    t: Array
    sent: Array
    latency: Array
    commands: Array
    said: Sequence[ModeReport] = field(repr=False)
    samples: Sequence[NodeSample] = field(repr=False)

    @cached_property
    def end(self) -> float:
        """[s] of ``sent`` to which it counts."""
        return (self.samples[-1].t - self.samples[0].t) / 1e9 - PATIENCE

    @property
    def warm_up(self) -> float:
        """[s] of ``sent`` from which on it counts."""
        return min(WARM_UP, self.end / (QUARTERS + 1))

    def between(self, begin: float, end: float) -> NDArray[np.bool_]:
        """Return which states (N,) were sent in a time [s]."""
        return (self.sent >= begin) & (self.sent < end)

    def quarter(self, number: int) -> NDArray[np.bool_]:
        """Return which states (N,) are of a quarter of the time that counts, 1 to 4; 0: of all."""
        if number not in range(QUARTERS + 1):
            raise BagError(f"quarter {number}: expected 1 to {QUARTERS}, or 0 for all of them")
        edges = np.linspace(self.warm_up, self.end, QUARTERS + 1)
        first, last = (edges[number - 1], edges[number]) if number else edges[[0, -1]]
        return self.between(float(first), float(last))

    @cached_property
    def unanswered(self) -> list[Unanswered]:
        """Why each state that counts has no command."""
        missed = self.sent[self.quarter(0) & np.isnan(self.latency)]
        queue = _QUEUE * float(np.median(np.diff(self.t)))
        return list(reasons(missed, self.said, list(self._waits()), queue))

    def _waits(self) -> Iterator[tuple[float, float, float]]:
        """Yield begin and end of each interval, and the longest wait in it [s]."""
        before: dict[int, float] = {}
        for sample in self.samples:
            t = (sample.t - self.samples[0].t) / 1e9
            if sample.node not in BESIDE:
                yield before.get(sample.pid, t), t, sample.waited
            before[sample.pid] = t

    def used(self, node: str) -> tuple[Array, Array]:
        """Return when [s] (K,) a node was sampled, and its RSS, USS, CPU (K, 3).

        Of the longest of its processes.  ``node`` is one of ``NODES``.
        """
        if node not in NODES:
            raise UnknownNameError("node", node, NODES)
        mine = [s for s in self.samples if _role(s.node) == node and np.isfinite(s.rss)]
        pids = [sample.pid for sample in mine]
        mine = [s for s in mine if s.pid == max(pids, key=pids.count)]
        t = np.array([(s.t - self.samples[0].t) / 1e9 for s in mine])
        return t, np.array([(s.rss, s.uss, s.cpu) for s in mine]).reshape(-1, 3)

    def growth(self, node: str) -> float:
        """Return by which part the memory of a node grew, all or its own, whichever grew more.

        NaN if there are too few samples after the warm-up of its process.
        """
        t, used = self.used(node)
        memory = used[t >= max(self.warm_up, t[0] + self.warm_up), :2] if len(t) else used
        if len(memory) < 2 * _AT_ENDS:
            return np.nan
        begin, end = np.median(memory[:_AT_ENDS], axis=0), np.median(memory[-_AT_ENDS:], axis=0)
        return float((end / begin - 1).max())

    def trend(self, percent: float) -> tuple[Array, Array]:
        """Return times [s] of ``t`` (P,), and a percentile [s] of the round trip about each.

        It is of a minute each, at most, and the same in each quarter.
        """
        count = QUARTERS * int(np.ceil((self.end - self.warm_up) / (QUARTERS * _PAGE)))
        edges = np.linspace(self.warm_up, self.end, max(count, QUARTERS) + 1)
        answered = np.isfinite(self.latency)
        pages = [self.between(*pair) & answered for pair in pairwise(edges.tolist())]
        pages = [page for page in pages if page.any()]
        t = np.array([self.t[page].mean() for page in pages])
        return t, np.array([np.percentile(self.latency[page], percent) for page in pages])


def _role(node: str) -> str:
    return node if node in OTHERS else NODES[0]


def reasons(
    missed: Array,
    said: Sequence[ModeReport],
    waits: Sequence[tuple[float, float, float]],
    queue: float,
) -> Iterator[Unanswered]:
    """Yield why each state was not answered, as counters and the kernel tell of then.

    Each count explains one state only.  Of several the one that was reported first is used: states
    are asked for in their order, and so none is left without a reason that another one could have.

    Args:
        missed: (K,) when they were sent [s], in order.
        said: reports of the controller.
        waits: begin and end of intervals, and the longest wait for a processor in each [s].
        queue: [s] that the queue of the controller lasts.
    """
    begins, ends, longest = np.array(waits).reshape(-1, 3).T

    def starved(t: float) -> bool:  # for half of the time that the queue lasts
        around = (begins <= t + _AROUND) & (ends >= t - _AROUND)
        return float(longest[around].max(initial=0.0)) >= queue / 2

    t = np.array([one.t for one in said])
    left = {Unanswered.REFUSED: _increments([one.refused for one in said])}
    overrun = {Unanswered.OVERRUN: _increments([one.missed for one in said])}
    silences = list(_silences([one for one in said if one.cause != Cause.NO_STATES], starved))
    for sent in missed:
        found = []
        for why, counts in (left | overrun if starved(sent) else left).items():
            places = np.flatnonzero((counts > 0) & (t >= sent) & (t <= sent + _SLACK))
            found += [(places[0], why, counts)] if len(places) else []
        if found:
            place, why, counts = min(found, key=lambda one: one[:2])
            counts[place] -= 1
            yield why
        else:
            withheld = any(begin <= sent <= end for begin, end in silences)
            yield Unanswered.WITHHELD if withheld else Unanswered.UNKNOWN


def _increments(counts: Sequence[int]) -> NDArray[np.int64]:
    """Return by how much a counter (N,) has grown at each report; a new process begins at 0."""
    new = [now - before for before, now in pairwise([*counts[:1], *counts])]
    return np.maximum(np.array(new, dtype=np.int64), 0)


def _silences(said: Sequence[ModeReport], starved: Any) -> Iterator[tuple[float, float]]:
    """Yield begin and end [s] of the times in which nothing was commanded for want of time."""
    begin = None
    for one in said:
        if one.mode in _SILENT and begin is None and starved(one.t):
            begin = one.t - _AROUND
        elif one.mode in _ACTIVE and begin is not None:
            yield begin, one.t
            begin = None
    if begin is not None:
        yield begin, np.inf


def is_in_real_time(recording: Recording) -> bool:
    """Return whether a bag has samples of the nodes: it is of a run in real time."""
    return (recording.path / USAGE).is_file()


def real_time(recording: Recording) -> RealTimeRun:
    """Return a run in real time; raises BagError if it is none."""
    file = recording.path / USAGE
    if not file.is_file():
        raise BagError(f"{recording.path} has no {USAGE}: it is no experiment with real_time: true")
    return _read(recording.path, recording.namespace, file.stat().st_mtime_ns)


@lru_cache(maxsize=4)
def _read(path: Path, namespace: str, _version: int) -> RealTimeRun:
    with open(path / USAGE, encoding="utf-8", newline="") as file:
        samples = [
            NodeSample(int(t), node, int(pid), *map(float, numbers))
            for t, node, pid, *numbers in csv.reader(file)
        ]
    bag, states = Bag(path), f"{namespace}/joint_states"
    commands = [f"{namespace}/{name}" for name in _COMMANDS]
    command = [topic for topic in commands if topic in bag.topics and bag.topics[topic].count]
    if not samples or not command:
        raise BagError(f"{path}: {'no command was recorded' if samples else f'{USAGE} is empty'}")
    found = stamped(path, [states, command[0]])
    asked, answers = found[states], found[command[0]]
    stamps, first = np.unique(answers.stamp, return_index=True)
    place = np.minimum(np.searchsorted(stamps, asked.stamp), len(stamps) - 1)
    latency = (answers.received[first][place] - asked.sent) / 1e9
    origin = samples[0].t
    return RealTimeRun(
        (asked.stamp - asked.stamp[0]) / 1e9,
        (asked.sent - origin) / 1e9,
        np.where(stamps[place] == asked.stamp, latency, np.nan),
        (answers.received - origin) / 1e9,
        list(_said(bag, {sample.node for sample in samples} - {*OTHERS}, origin)),
        samples,
    )


def _said(bag: Bag, controllers: set[str], origin: int) -> Iterator[ModeReport]:
    """Yield the reports of the controller on /diagnostics, with times from ``origin`` [ns] on."""
    for message in bag.messages({"/diagnostics"} & bag.topics.keys()):
        for status in message.message.status:
            if status.name.rpartition("/")[2] in controllers:
                values = {pair.key: pair.value for pair in status.values}
                refused, missed = (
                    int(values.get(f"joint_states {what}", 0)) for what in ("rejected", "missed")
                )
                t = (message.publish_time - origin) / 1e9
                yield ModeReport(t, values.get(MODE, ""), values.get(CAUSE, ""), refused, missed)


_GROUP = "Round trips and processes"
_NOTHING = np.zeros(0), np.zeros(0)


@metric("", raw=True)
def unanswered_states(recording: Recording) -> float:
    """States without a command of their stamp."""
    return float(len(real_time(recording).unanswered))


@metric("", raw=True)
def unexplained_states(recording: Recording) -> float:
    """States without a command that nothing explains.

    A state is explained if the controller has counted that it refused it, if its queue ran over
    while it had no processor, or if it released the arm then.  NaN if there was no state.
    """
    run = real_time(recording)
    return float(run.unanswered.count(Unanswered.UNKNOWN)) if run.quarter(0).any() else np.nan


@metric("ms", raw=True)
def round_trip(recording: Recording, percent: float = 99.0, quarter: int = 0) -> float:
    """Percentile of the round trip from joint_states to the command.

    Of a ``quarter`` of the time, 1 to 4, or 0 of all.  NaN if nothing was answered then.
    """
    run = real_time(recording)
    some = run.latency[run.quarter(quarter)]
    some = some[np.isfinite(some)]
    return 1e3 * float(np.percentile(some, percent)) if len(some) else np.nan


@metric("", raw=True)
def round_trip_growth(recording: Recording, percent: float = 99.0) -> float:
    """Percentile of the round trip, last quarter by first."""
    return quotient(round_trip(recording, percent, 4), round_trip(recording, percent, 1))


@metric("ms", raw=True)
def longest_gap(recording: Recording) -> float:
    """Longest time between two commands."""
    run = real_time(recording)
    counts = (run.commands >= run.warm_up) & (run.commands < run.end)
    return 1e3 * float(np.diff(run.commands[counts]).max(initial=0.0))


@metric("%", raw=True)
def memory_growth(recording: Recording, node: str) -> float:
    """Growth of the memory of a node after the warm-up.

    ``node`` is ``controller``, ``pybullet_bridge``, ``reference`` or ``bag_recorder``.
    """
    return 100 * real_time(recording).growth(node)


def _inside(recording: Recording, t: Array, values: Array) -> tuple[Array, Array]:
    """Return values over time within a part of a run."""
    part = recording.measured.t
    some = (t >= part[0]) & (t < part[-1])
    return t[some], values[some]


@drawn(
    15, "Round trip", "joint_states to command [ms]",
    "Time from the publication of joint_states to the receipt of the command of the same stamp, "
    "of each state.",
    unit="ms", floor=1e-3, name="round_trip", logarithmic=True,
)  # fmt: skip
def _round_trips(recording: Recording) -> Samples:
    if not is_in_real_time(recording):
        return _NOTHING
    run = real_time(recording)
    return _inside(recording, run.t, 1e3 * run.latency)


def _percentile(percent: float, recording: Recording) -> Samples:
    if not is_in_real_time(recording):
        return _NOTHING
    t, latency = real_time(recording).trend(percent)
    return _inside(recording, t, 1e3 * latency)


for _percent in (50, 99):
    drawn(
        16 + _percent / 1000, f"Round trip, p{_percent}", "joint_states to command [ms]",
        f"{_percent} % of the round trips are shorter; of each minute, at most, after the warm-up.",
        unit="ms", floor=1e-3, name=f"round_trip_p{_percent}", group=_GROUP,
    )(partial(_percentile, _percent))  # fmt: skip


@drawn(
    25, "Memory of the nodes", "resident memory [MiB]",
    "What each process has mapped and touched, its own and shared.",
    unit="MiB", floor=1e-3, components=NODES, group=_GROUP,
)  # fmt: skip
def memory(recording: Recording) -> Samples:
    """Return the memory (N, 4) [MiB] of the nodes."""
    return _used(recording, 0)


@drawn(
    25.5, "Processor of the nodes", "of one core [%]",
    "What each process takes of the time of one core.",
    unit="%", floor=1e-3, components=NODES, group=_GROUP,
)  # fmt: skip
def processor(recording: Recording) -> Samples:
    """Return the part (N, 4) [%] of a core that each node takes."""
    return _used(recording, 2)


def _used(recording: Recording, column: int) -> Samples:
    """Return memory [MiB], or part of a core [%], of each node at the times of the controller."""
    if not is_in_real_time(recording):
        return _NOTHING
    run = real_time(recording)
    at, _ = run.used(NODES[0])
    found = []
    for node in NODES:
        t, used = run.used(node)
        values = used[:, column]
        if column == 2 and len(t) > 1:
            values = 100 * np.gradient(values, t)
        found.append(np.interp(at, t, values, np.nan, np.nan) if len(t) else at * np.nan)
    return _inside(recording, np.interp(at, run.sent, run.t), np.column_stack(found))
