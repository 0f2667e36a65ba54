"""Runs in real time: which states were answered, how soon, and the memory of the nodes.

The metrics leave out the warm-up, a fifth of the run and at most a minute, and the last second.
"""

import struct
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.quantities.base import Samples, drawn, metric
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.bags.reader import Bag
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.laws.rotations import Array

USAGE = "usage.csv"
"""The file in a bag whose lines are a time [ns] and the resident memory [B] of each node then."""

NODES = ("controller", "pybullet_bridge", "reference", "bag_recorder")

_WARM_UP, _LAST = 60.0, 1.0  # [s]
_COMMANDS = ("joint_effort", "joint_reference")
_STAMP, _STAMP_AT = struct.Struct("<iI"), 4  # behind the header of the encoding


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


class RealTimeRun(NamedTuple):
    """A run in real time.

    Attributes:
        t: (N,) [s] stamps of joint_states, from the first.
        latency: (N,) [s] from sending a state to receipt of its command; NaN without one.
        counts: (N,) whether a state was sent after the warm-up and before the end.
        sampled: (K,) [s] when memory was sampled, on the axis of ``t``.
        memory: (K, 4) [MB] of the nodes.
        commands: (M,) [s] when commands were received, on the axis of ``t``.
        begin, end: [s] of what is judged.
    """

    t: Array
    latency: Array
    counts: NDArray[np.bool_]
    sampled: Array
    memory: Array
    commands: Array
    begin: float
    end: float


def real_time(recording: Recording) -> RealTimeRun:
    """Return a run in real time; raises BagError if it is none."""
    file = recording.path / USAGE
    if not file.is_file():
        raise BagError(f"{recording.path} has no {USAGE}: it is no experiment with real_time: true")
    return _read(recording.path, recording.namespace, file.stat().st_mtime_ns)


@lru_cache(maxsize=4)
def _read(path: Path, namespace: str, _version: int) -> RealTimeRun:
    samples = np.loadtxt(path / USAGE, delimiter=",", ndmin=2)
    bag, states = Bag(path), f"{namespace}/joint_states"
    commands = [f"{namespace}/{name}" for name in _COMMANDS]
    command = [topic for topic in commands if topic in bag.topics and bag.topics[topic].count]
    if not command:
        raise BagError(f"{path}: no command was recorded")
    found = stamped(path, [states, command[0]])
    asked, answers = found[states], found[command[0]]
    stamps, first = np.unique(answers.stamp, return_index=True)
    place = np.minimum(np.searchsorted(stamps, asked.stamp), len(stamps) - 1)
    latency = (answers.received[first][place] - asked.sent) / 1e9
    sampled, sent = (samples[:, 0] - asked.sent[0]) / 1e9, (asked.sent - asked.sent[0]) / 1e9
    begin = sampled[0] + min(_WARM_UP, (sampled[-1] - sampled[0]) / 5)
    end = sampled[-1] - _LAST
    return RealTimeRun(
        (asked.stamp - asked.stamp[0]) / 1e9,
        np.where(stamps[place] == asked.stamp, latency, np.nan),
        (sent >= begin) & (sent < end),
        sampled,
        samples[:, 1:] / 1e6,
        np.sort(answers.received - asked.sent[0]) / 1e9,
        begin,
        end,
    )


@metric("%")
def states_answered(recording: Recording) -> float:
    """States with a command of their stamp."""
    run = real_time(recording)
    return 100 * float(np.isfinite(run.latency[run.counts]).mean()) if run.counts.any() else np.nan


@metric("ms")
def round_trip(recording: Recording, percent: float = 99.0) -> float:
    """Percentile of the round trip from joint_states to the command.

    NaN if nothing was answered.
    """
    run = real_time(recording)
    answered = run.latency[run.counts & np.isfinite(run.latency)]
    return 1e3 * float(np.percentile(answered, percent)) if len(answered) else np.nan


@metric("ms")
def longest_silence(recording: Recording) -> float:
    """Longest time without a command."""
    run = real_time(recording)
    inside = run.commands[(run.commands > run.begin) & (run.commands < run.end)]
    return 1e3 * float(np.diff(inside, prepend=run.begin, append=run.end).max())


@metric("MB/h")
def memory_growth(recording: Recording, node: str) -> float:
    """Growth of the memory of a node after the warm-up, of the line that fits best.

    ``node`` is ``controller``, ``pybullet_bridge``, ``reference`` or ``bag_recorder``.  NaN if
    there are fewer than two samples.
    """
    if node not in NODES:
        raise UnknownNameError("node", node, NODES)
    run = real_time(recording)
    size = run.memory[:, NODES.index(node)]
    some = (run.sampled >= run.begin) & np.isfinite(size)
    if some.sum() < 2:
        return np.nan
    return 3600 * float(np.polyfit(run.sampled[some], size[some], 1)[0])


def _inside(recording: Recording, t: Array, values: Array) -> Samples:
    """Return values over time within the time that is looked at."""
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
    run = real_time(recording)
    return _inside(recording, run.t, 1e3 * run.latency)


@drawn(
    25, "Memory of the nodes", "resident memory [MB]",
    "What each process has mapped and touched, its own and shared.",
    unit="MB", floor=1e-3, components=NODES, group="Processes",
)  # fmt: skip
def memory(recording: Recording) -> Samples:
    """Return the memory (K, 4) [MB] of the nodes."""
    run = real_time(recording)
    return _inside(recording, run.sampled, run.memory)
