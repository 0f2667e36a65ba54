"""Runs in real time: what was answered, how soon, and what the processes of the nodes take.

The metrics are of the time after the warm-up: see ``analysis.real_time``.
"""

from functools import partial

import numpy as np

from eulerparams_control.analysis.quantities.base import metric, quotient
from eulerparams_control.analysis.quantity import Quantity, vectors
from eulerparams_control.analysis.real_time import NODES, Unanswered, is_in_real_time, real_time
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.laws.rotations import Array

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


def _round_trip(recording: Recording) -> tuple[Array, Array]:
    if not is_in_real_time(recording):
        return _NOTHING
    run = real_time(recording)
    return _inside(recording, run.t, 1e3 * run.latency)


def _percentile(percent: float, recording: Recording) -> tuple[Array, Array]:
    if not is_in_real_time(recording):
        return _NOTHING
    t, latency = real_time(recording).trend(percent)
    return _inside(recording, t, 1e3 * latency)


def _memory(recording: Recording) -> tuple[Array, Array]:
    return _used(recording, 0)


def _processor(recording: Recording) -> tuple[Array, Array]:
    return _used(recording, 2)


def _used(recording: Recording, column: int) -> tuple[Array, Array]:
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


ROUND_TRIP = Quantity(
    "round_trip",
    "Round trip",
    "joint_states to command [ms]",
    "Time from the publication of joint_states to the receipt of the command of the same stamp, "
    "of each state.",
    "ms",
    1e-3,
    _round_trip,
    logarithmic=True,
)
PERCENTILES = tuple(
    Quantity(
        f"round_trip_p{percent}",
        f"Round trip, p{percent}",
        "joint_states to command [ms]",
        f"{percent} % of the round trips are shorter; of each minute, at most, after the warm-up.",
        "ms",
        1e-3,
        partial(_percentile, percent),
        group=_GROUP,
    )
    for percent in (50, 99)
)

VECTORS = vectors(
    _GROUP,
    ("memory", "Memory of the nodes", "resident memory [MiB]",
     "What each process has mapped and touched, its own and shared.", "MiB", 1e-3, _memory),
    ("processor", "Processor of the nodes", "of one core [%]",
     "What each process takes of the time of one core.", "%", 1e-3, _processor),
    components=NODES,
)  # fmt: skip

PLACES = {15: ROUND_TRIP, 16: PERCENTILES, 25: VECTORS}
