"""Quantities of runs in real time: round trips, and what the processes of the nodes take."""

from functools import partial

import numpy as np

from eulerparams_control.analysis.quantity import Quantity, VectorQuantity
from eulerparams_control.analysis.real_time import NODES, is_in_real_time, real_time
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.laws.rotations import Array

_GROUP = "Round trips and processes"
_NOTHING = np.zeros(0), np.zeros(0)


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

VECTORS = (
    VectorQuantity(
        "memory",
        "Memory of the nodes",
        "resident memory [MiB]",
        "What each process has mapped and touched, its own and shared.",
        "MiB",
        1e-3,
        _memory,
        NODES,
        group=_GROUP,
    ),
    VectorQuantity(
        "processor",
        "Processor of the nodes",
        "of one core [%]",
        "What each process takes of the time of one core.",
        "%",
        1e-3,
        _processor,
        NODES,
        group=_GROUP,
    ),
)
"""In the order of the page."""
