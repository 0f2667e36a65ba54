"""Metrics of runs in real time: what was answered, how soon, and what the nodes took.

They are of the time after the warm-up: see ``analysis.real_time``.
"""

import numpy as np

from eulerparams_control.analysis.metrics.base import metric, quotient
from eulerparams_control.analysis.real_time import Unanswered, real_time
from eulerparams_control.analysis.recording import Recording


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
