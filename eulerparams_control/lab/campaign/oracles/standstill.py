"""Motion of the arm itself: at rest while held, no runaway, at its goal in the end."""

from itertools import groupby, pairwise

import numpy as np

from eulerparams_control.analysis.checks import speed_of_limit
from eulerparams_control.lab.campaign.oracles import Found, oracle
from eulerparams_control.lab.campaign.record import ERROR, SequenceRecord, Span

# [s] that the arm is given to come to rest: held, and braked without commands.
_SETTLING, _BRAKING = 0.5, 0.25

# Of a speed limit: a robot of its own stops at about this.
_RUNAWAY = 2.0

# Largest speed [rad/s] and drift [rad] of an arm at rest.
_SPEED, _DRIFT = 0.02, 0.01

# The tip is there within these [m], [deg].
_NEAR, _ALIGNED = 0.005, 1.0


@oracle(
    "held still",
    f"while it says that it holds still, or has no valid states, the joints are slower than "
    f"{_SPEED} rad/s and stay within {_DRIFT} rad, from {_SETTLING} s on, without states from "
    f"{_BRAKING} s on; not while a fault shakes the arm or its measured state",
)
def held_still(record: SequenceRecord) -> Found:
    """Yield the times at which the arm moves while it should be at rest."""
    for spans, disturbed, time in (
        (_holding(record), record.shaken, _SETTLING),
        (_without_states(record), record.disturbed, _BRAKING),
    ):
        for start, end in spans:
            for calm, until in without(start, end, disturbed):
                if text := _moves(record, calm + time, until):
                    yield calm + time, f"{text} while it is held still"


def _moves(record: SequenceRecord, start: float, end: float) -> str:
    """Return how a joint moves in a time [s]; "" if none does."""
    inside = [truth for truth in record.truth if start <= truth.t <= end]
    if not inside:
        return ""
    q, dq = np.array([t.q for t in inside]), np.abs([t.dq for t in inside])
    drift = np.abs(q - q[0])
    if dq.max() > _SPEED:
        return f"a joint moves at {dq.max():.3g} rad/s"
    return f"a joint drifts by {drift.max():.3g} rad" if drift.max() > _DRIFT else ""


@oracle("no runaway", f"no joint of the arm is ever faster than {_RUNAWAY:g} times its limit")
def no_runaway(record: SequenceRecord) -> Found:
    """Yield where the arm is fastest, if that is too fast."""
    parts = speed_of_limit(np.array([truth.dq for truth in record.truth]), record.limits)
    if len(parts) and not parts.max() <= _RUNAWAY:
        k, i = np.unravel_index(int(np.argmax(parts)), parts.shape)
        text = f"{record.joints[i]} is as fast as {parts[k, i]:.3g} times its limit"
        yield record.truth[k].t, text


def _holding(record: SequenceRecord) -> list[Span]:
    """Return from when to when it says that it holds still."""
    runs = groupby(record.said, key=lambda said: said.is_holding)
    starts = [(is_holding, next(said).t) for is_holding, said in runs]
    ends = [*(t for _, t in starts[1:]), record.end]
    pairs = zip(starts, ends, strict=True)
    return [(start, end) for (is_holding, start), end in pairs if is_holding]


def _without_states(record: SequenceRecord) -> list[Span]:
    """Return from when to when no valid state came."""
    times = [*(state.t for state in record.states if state.is_valid), record.end]
    timeout = record.state_timeout
    return [(a, b) for a, b in pairwise(times) if b - a > timeout]


def without(start: float, end: float, shaken: list[Span]) -> list[Span]:
    """Return the parts of a span in which nothing shakes the arm."""
    parts = [(start, end)]
    for a, b in shaken:
        parts = [
            piece
            for low, high in parts
            for piece in ((low, min(high, a)), (max(low, b), high))
            if piece[1] > piece[0]
        ]
    return parts


@oracle(
    "recovers",
    f"sent again after the last fault, the tip ends within {1e3 * _NEAR:g} mm and "
    f"{_ALIGNED:g} deg of where it was sent",
)
def recovers(record: SequenceRecord) -> Found:
    """Yield how far the tip is from its goal, or what the controller still reports."""
    if record.crash:
        return  # another oracle says so
    last = record.said[-1] if record.said else None
    words = f"; it says: {last.message}" if last else "; it says nothing"
    distance, angle = record.tip_error
    if not (distance <= _NEAR and angle <= _ALIGNED):
        yield record.end, f"the tip ends {1e3 * distance:.1f} mm, {angle:.1f} deg away{words}"
    elif last is None or last.level == ERROR:
        yield record.end, f"it is there, but not well{words}"
