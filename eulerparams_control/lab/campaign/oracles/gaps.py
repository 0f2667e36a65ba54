"""Silence: no command without a state to answer, and a calm first one after it."""

from bisect import bisect_right

import numpy as np

from eulerparams_control.lab.campaign.oracles import Found, oracle
from eulerparams_control.lab.campaign.record import ERROR, OK, Command, SequenceRecord, State

# A position, or speed, of a first command that is the measured one, or zero [rad], [rad/s].
_SAME = 1e-6

# The damping [1/s] with which a first effort may brake the motion that it finds, and what it may
# be off [Nm] besides.
_DAMPING, _EFFORT = 150.0, 1.0

# Longest time without valid states [s] that a controller need not report.
_SAYS = 0.3


@oracle("silent", "no command later than state_timeout after the last valid joint_states")
def silent(record: SequenceRecord) -> Found:
    """Yield the first command without a state."""
    times = [state.t for state in record.states if state.is_valid]
    for command in record.commands:
        k = bisect_right(times, command.t)
        age = command.t - times[k - 1] if k else float("inf")
        if age > record.state_timeout:
            yield command.t, f"a command {age:.3f} s after the last valid state"
            return


@oracle(
    "calm start",
    "the first command after a start or a gap: the measured position and no speed; the effort "
    "that compensates gravity, and brakes the arm",
)
def calm_start(record: SequenceRecord) -> Found:
    """Yield the first commands after a start or a silence that are not calm."""
    before: Command | None = None
    for command in record.commands:
        gap = record.state_timeout + record.period
        is_first = before is None or before.life != command.life or command.t - before.t > gap
        if is_first and (text := _why_not_calm(record, command)):
            yield command.t, text
        before = command


def _why_not_calm(record: SequenceRecord, command: Command) -> str:
    # clocks that jump give a stamp to several states
    answered = [
        s for s in record.states if s.is_valid and s.stamp == command.stamp and s.t <= command.t
    ]
    if not answered:
        return f"it answers no state: its stamp is {command.stamp:.3f} s"
    if len(command.effort) == len(record.joints):
        return _why_effort_not_calm(record, command, answered[-1])
    if len(command.q) != len(record.joints):
        return ""  # another oracle says so
    off = record.limits.deviation(np.array(command.q), np.array(answered[-1].q))
    if off.max() > _SAME:
        return f"the position is {off.max():.4g} rad from the measured one"
    speed = np.abs(command.dq).max()
    return f"the speed is {speed:.4g} rad/s" if speed > _SAME else ""


def _why_effort_not_calm(record: SequenceRecord, command: Command, state: State) -> str:
    arm = record.model.dynamic_state(np.array(state.q), np.array(state.dq))
    braking = np.abs(arm.B) @ np.abs(_DAMPING * np.array(state.dq))
    contact = np.abs(arm.arm.J.T) @ np.repeat(record.contact, 3)
    off = np.abs(np.array(command.effort) - arm.g - arm.C_dq)
    excess = off - braking - contact - _EFFORT
    i = int(np.argmax(excess))
    if excess[i] <= 0:
        return ""
    return f"the effort of {record.joints[i]} is {off[i]:.4g} Nm from gravity compensation"


@oracle("says so", f"without valid joint_states for {_SAYS} s, /diagnostics says an error")
def says_silence(record: SequenceRecord) -> Found:
    """Yield the silences of which it says nothing."""
    for start, end in record.lives():
        times = [s.t for s in record.states if s.is_valid and start <= s.t <= end]
        for before, after in zip(times, [*times[1:], end], strict=False):
            t = before + _SAYS
            if after > t:
                level = next((said.level for said in reversed(record.said) if said.t <= t), OK)
                if level != ERROR:
                    yield t, f"{_SAYS} s without states, and it says no error"
