"""The arm itself: at rest while it is held, never running away, at its goal in the end."""

from itertools import pairwise
from typing import ClassVar

import numpy as np

from eulerparams_control.lab.campaign.oracles.base import Oracle, Violation
from eulerparams_control.lab.campaign.record import ERROR, SequenceRecord

# [s] that the arm is given to come to rest: held, and braked without commands.
_SETTLING, _BRAKING = 0.5, 0.25

# Of a speed limit: a robot of its own stops at about this.
_RUNAWAY = 2.0

# Largest speed [rad/s] and drift [rad] of an arm at rest.
_SPEED, _DRIFT = 0.02, 0.01

# The tip is there within these [m], [deg].
_NEAR, _ALIGNED = 0.005, 1.0


class HeldStill(Oracle):
    """While the controller holds still, or has no valid states, the arm is at rest."""

    name: ClassVar[str] = "held still"
    claim: ClassVar[str] = (
        f"while it says that it holds still, or has no valid states, the joints are slower than "
        f"{_SPEED} rad/s and stay within {_DRIFT} rad, from {_SETTLING} s on, without states from "
        f"{_BRAKING} s on; not while a fault shakes the arm or its measured state"
    )

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return the times at which it moves."""
        found = []
        for start, end in _holding(record):
            for calm, until in without(start, end, record.shaken):
                found += self._moves(record, calm + _SETTLING, until)
        for start, end in _without_states(record):
            for calm, until in without(start, end, record.disturbed):
                found += self._moves(record, calm + _BRAKING + record.jitter, until)
        return found

    def _moves(self, record: SequenceRecord, start: float, end: float) -> list[Violation]:
        inside = [truth for truth in record.truth if start <= truth.t <= end]
        if not inside:
            return []
        q, dq = np.array([t.q for t in inside]), np.abs([t.dq for t in inside])
        drift = np.abs(q - q[0])
        text = ""
        if dq.max() > _SPEED:
            text = f"a joint moves at {dq.max():.3g} rad/s"
        elif drift.max() > _DRIFT:
            text = f"a joint goes away by {drift.max():.3g} rad"
        return [self.violation(start, f"{text} while it is held still")] if text else []


class NoRunaway(Oracle):
    """Whatever goes wrong, the arm does not run away."""

    name: ClassVar[str] = "no runaway"
    holds_if_starved: ClassVar[bool] = True
    claim: ClassVar[str] = f"no joint of the arm is ever faster than {_RUNAWAY:g} times its limit"

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return where the arm is fastest, if that is too fast."""
        parts = np.array([np.abs(truth.dq) for truth in record.truth]) / record.limits.velocity
        if not len(parts) or parts.max() <= _RUNAWAY:
            return []
        k, i = np.unravel_index(int(np.argmax(parts)), parts.shape)
        text = f"{record.joints[i]} is as fast as {parts[k, i]:.3g} times its limit"
        return [self.violation(record.truth[k].t, text)]


Span = tuple[float, float]


def _holding(record: SequenceRecord) -> list[Span]:
    """Return from when to when it says that it holds still."""
    spans, since = [], None
    for said in record.said:
        if said.is_holding and since is None:
            since = said.t
        elif not said.is_holding and since is not None:
            spans.append((since, said.t))
            since = None
    return [*spans, (since, record.end)] if since is not None else spans


def _without_states(record: SequenceRecord) -> list[Span]:
    """Return from when to when no valid state came."""
    times = [*(state.t for state in record.states if state.is_valid), record.end]
    timeout = record.state_timeout + record.jitter
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


class Recovers(Oracle):
    """When all faults are over, and the reference is sent again, the arm goes there."""

    name: ClassVar[str] = "recovers"
    claim: ClassVar[str] = (
        f"sent again after the last fault, the tip ends within {1e3 * _NEAR:g} mm and "
        f"{_ALIGNED:g} deg of where it was sent"
    )

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return how it is not there, or why it is no better."""
        if record.crash:
            return []  # another oracle says so
        last = record.said[-1] if record.said else None
        words = f"; it says: {last.message}" if last else "; it says nothing"
        distance, angle = record.tip_error
        if not (distance <= _NEAR and angle <= _ALIGNED):
            text = f"the tip ends {1e3 * distance:.1f} mm, {angle:.1f} deg away{words}"
            return [self.violation(record.end, text)]
        if last is None or last.level == ERROR:
            return [self.violation(record.end, f"it is there, but not well{words}")]
        return []
