"""Commands: each is whole and within the limits, and so is each step between two.

The time of a step is that between two publications, at least a period of joint_states: answers to
states that come in a burst are a period apart each.  A command that is repeated under its stamp,
since its state was, counts from its first publication.  After a silence in which the robot has
braked, and after a restart, a command has no predecessor.
"""

from collections.abc import Callable, Iterator

import numpy as np

from eulerparams_control.analysis.checks import beyond_limits
from eulerparams_control.control.mode import Cause
from eulerparams_control.lab.campaign.oracles import Found, oracle, worst_of
from eulerparams_control.lab.campaign.plan import COMMAND_TIMEOUT
from eulerparams_control.lab.campaign.record import Command, SequenceRecord

_STEP_ROUNDING = 1e-6  # of a step


@oracle("survives", "no message ends the controller, or leads to an internal error")
def survives(record: SequenceRecord) -> Found:
    """Yield how the controller ended, or what it did not expect."""
    if record.crash:
        yield record.end, record.crash
    errors = [said for said in record.said if said.cause == Cause.DEFECT]
    yield from ((said.t, said.message) for said in errors[:1])


@oracle("finite", "every command has a finite number for each joint, and their names")
def finite(record: SequenceRecord) -> Found:
    """Return the first command that is not whole, or not of finite numbers."""
    return _first_of(record, _why_not_finite)


def _why_not_finite(command: Command, record: SequenceRecord) -> str:
    n = len(record.joints)
    if command.names != record.joints:
        return f"the joints are {', '.join(command.names)}"
    sizes = len(command.q), len(command.dq), len(command.effort)
    if sizes not in ((n, n, 0), (0, 0, n)):
        return f"there are {sizes} positions, velocities, efforts for {n} joints"
    values = (*command.q, *command.dq, *command.effort)
    return "" if np.isfinite(values).all() else f"the values are {values}"


@oracle("limits", "no position, speed or effort beyond the limits of the URDF")
def within_limits(record: SequenceRecord) -> Found:
    """Return the first command beyond a limit."""
    return _first_of(record, _why_beyond)


def _why_beyond(command: Command, record: SequenceRecord) -> str:
    fields = {"position": command.q, "velocity": command.dq, "effort": command.effort}
    for what, values in fields.items():
        if len(values) != len(record.joints):
            continue  # another oracle says so where there are some
        out, low, high = beyond_limits(what, np.array(values), record.limits)
        if (out & np.isfinite(values)).any():
            i = int(np.argmax(out & np.isfinite(values)))
            name = "speed" if what == "velocity" else what
            bounds = f"limits {low[i]:g} ... {high[i]:g}"
            return f"{name} {values[i]:.6g} of {record.joints[i]}, {bounds}"
    return ""


def _first_of(
    record: SequenceRecord, fault: Callable[[Command, SequenceRecord], str]
) -> Iterator[tuple[float, str]]:
    """Yield the first command with a fault, and how many have one."""
    found = [(command.t, text) for command in record.commands if (text := fault(command, record))]
    yield from ((t, f"{text}; {len(found)} commands in all") for t, text in found[:1])


@oracle(
    "no jump",
    "efforts change by at most max_effort_rate, positions by at most the velocity limit, times "
    "the time between two commands",
)
def no_jump(record: SequenceRecord) -> Found:
    """Return the largest jump of each kind."""
    return worst_of(step for pair in _pairs(record) for step in _steps(record, *pair))


def _pairs(record: SequenceRecord) -> Iterator[tuple[Command, Command]]:
    """Yield the first of commands that are the same, and the one that follows them."""
    first = previous = None
    for command in record.commands:
        if first is None or previous is None or not follows(previous, command):
            first = command
        elif command[2:] != previous[2:]:
            yield first, command
            first = command
        previous = command


def _steps(
    record: SequenceRecord, before: Command, after: Command
) -> Iterator[tuple[str, float, float, str]]:
    """Yield the largest change of efforts and of positions, over what is allowed."""
    time, n = after.t - before.t, len(record.joints)
    deviation = record.limits.deviation
    for what, old, new, rate in (
        ("effort", before.effort, after.effort, np.full(n, record.max_effort_rate)),
        ("position", before.q, after.q, record.limits.velocity),
    ):
        if len(old) != n or len(new) != n or not np.isfinite((*old, *new)).all():
            continue  # others say so
        old_values, new_values = np.array(old), np.array(new)
        turns = what == "position"
        step = deviation(new_values, old_values) if turns else np.abs(new_values - old_values)
        allowed = rate * max(time, record.period)
        i = int(np.argmax(step / allowed))
        text = (
            f"{what} of {record.joints[i]} changes by {step[i]:.4g} within {1e3 * time:.3g} ms; "
            f"allowed is {allowed[i]:.4g}"
        )
        yield what, float(step[i] / allowed[i]) / (1 + _STEP_ROUNDING), after.t, text


def follows(before: Command, after: Command) -> bool:
    """Whether a command acts while the one before still does."""
    return before.life == after.life and after.t - before.t <= COMMAND_TIMEOUT
