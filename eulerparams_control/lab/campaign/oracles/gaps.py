"""Silence: no command without a state to answer, and a calm first one after it."""

from bisect import bisect_right
from typing import ClassVar

import numpy as np

from eulerparams_control.lab.campaign.oracles.base import Oracle, Violation
from eulerparams_control.lab.campaign.record import ERROR, OK, Command, SequenceRecord, State

# A position, or speed, of a first command that is the measured one, or zero [rad], [rad/s].
_SAME = 1e-6

# The damping [1/s] with which a first effort may brake the motion that it finds, and what it may
# be off [Nm] besides.
_DAMPING, _EFFORT = 150.0, 1.0

# Longest time without valid states [s] that a controller need not report.
_SAYS = 0.3


class Silent(Oracle):
    """What is not measured is not commanded."""

    name: ClassVar[str] = "silent"
    claim: ClassVar[str] = "no command later than state_timeout after the last valid joint_states"

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return the first command without a state."""
        times = [state.t for state in record.states if state.is_valid]
        for command in record.commands:
            k = bisect_right(times, command.t + record.jitter)
            age = command.t - times[k - 1] if k else float("inf")
            if age > record.state_timeout + record.jitter:
                return [
                    self.violation(command.t, f"a command {age:.3f} s after the last valid state")
                ]
        return []


class CalmStart(Oracle):
    """The first command after a start, or a silence, is to be where the arm is."""

    name: ClassVar[str] = "calm start"
    claim: ClassVar[str] = (
        "the first command after a start or a gap: the measured position and no speed; the effort "
        "that bears the arm, and brakes it"
    )

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return the first commands that are not calm."""
        by_stamp = _by_stamp(record)
        found = []
        before: Command | None = None
        for command in record.commands:
            gap = record.state_timeout + record.period + record.jitter
            is_first = before is None or before.life != command.life
            if is_first or (before is not None and command.t - before.t > gap):
                text = self._fault(record, command, _answered(by_stamp, command, record.jitter))
                found += [self.violation(command.t, text)] if text else []
            before = command
        return found

    def _fault(self, record: SequenceRecord, command: Command, state: State | None) -> str:
        if state is None:
            return f"it answers no state: its stamp is {command.stamp:.3f} s"
        if len(command.effort) == len(record.joints):
            return self._effort_fault(record, command, state)
        if len(command.q) != len(record.joints):
            return ""  # another oracle says so
        off = record.limits.deviation(np.array(command.q), np.array(state.q))
        if off.max() > _SAME:
            return f"the position is {off.max():.4g} rad from the measured one"
        speed = np.abs(command.dq).max()
        return f"the speed is {speed:.4g} rad/s" if speed > _SAME else ""

    def _effort_fault(self, record: SequenceRecord, command: Command, state: State) -> str:
        arm = record.model.dynamic_state(np.array(state.q), np.array(state.dq))
        braking = np.abs(arm.B) @ np.abs(_DAMPING * np.array(state.dq))
        contact = np.abs(arm.arm.J.T) @ np.repeat(record.contact, 3)
        off = np.abs(np.array(command.effort) - arm.g - arm.C_dq)
        excess = off - braking - contact - _EFFORT
        i = int(np.argmax(excess))
        if excess[i] <= 0:
            return ""
        return f"the effort of {record.joints[i]} is {off[i]:.4g} Nm from what bears it"


def _by_stamp(record: SequenceRecord) -> dict[float, list[State]]:
    """Return the valid states of each stamp, in the order in which they came."""
    found: dict[float, list[State]] = {}
    for state in record.states:
        if state.is_valid:
            found.setdefault(state.stamp, []).append(state)
    return found


def _answered(by_stamp: dict[float, list[State]], command: Command, jitter: float) -> State | None:
    """Return the state that a command answers: clocks that jump give a stamp to several."""
    found = [s for s in by_stamp.get(command.stamp, []) if s.t <= command.t + jitter]
    return found[-1] if found else None


class SaysSilence(Oracle):
    """Who hears no valid states says so."""

    name: ClassVar[str] = "says so"
    claim: ClassVar[str] = f"without valid joint_states for {_SAYS} s, /diagnostics says an error"

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return the silences of which it says nothing."""
        found = []
        for start, end in record.lives():
            times = [s.t for s in record.states if s.is_valid and start <= s.t <= end]
            for before, after in zip(times, [*times[1:], end], strict=False):
                t = before + _SAYS + record.jitter
                if after > t and self._level(record, t) != ERROR:
                    words = f"{_SAYS} s without states, and it says no error"
                    found.append(self.violation(t, words))
        return found

    def _level(self, record: SequenceRecord, t: float) -> int:
        return next((said.level for said in reversed(record.said) if said.t <= t), OK)
