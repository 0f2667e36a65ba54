"""Is each command one that a robot may be given, and each step one that the limits allow?

The time of a step is that between two publications, at least a period of joint_states: answers to
states that come in a burst are a period apart each.  A command that is repeated under its stamp,
since its state was, counts from its first publication.  After a silence in which the robot has
braked, and after a restart, a command has no predecessor.
"""

from collections.abc import Callable, Iterator

import numpy as np

from eulerparams_control.analysis.checks import beyond_limits
from eulerparams_control.control.mode import Cause
from eulerparams_control.lab.campaign.draws import COMMAND_TIMEOUT
from eulerparams_control.lab.campaign.oracles.base import Found, oracle
from eulerparams_control.lab.campaign.record import Command, SequenceRecord

# Part of a step that is rounding.
_STEP_ROUNDING = 1e-6


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
    for what, values in (
        ("position", command.q),
        ("velocity", command.dq),
        ("effort", command.effort),
    ):
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
    worst: dict[str, tuple[float, float, str]] = {}
    first: Command | None = None  # of those that are the same
    previous: Command | None = None
    for command in record.commands:
        if first is None or previous is None or not follows(record, previous, command):
            first = command
        elif command[2:] != previous[2:]:
            _compare(record, first, command, worst)
            first = command
        previous = command
    return [(t, text) for _, t, text in worst.values()]


def _compare(
    record: SequenceRecord,
    before: Command,
    after: Command,
    worst: dict[str, tuple[float, float, str]],
) -> None:
    dt = max(after.t - before.t, record.period)
    n = len(record.joints)
    for what, old, new, rate in (
        ("effort", before.effort, after.effort, np.full(n, record.max_effort_rate)),
        ("position", before.q, after.q, record.limits.velocity),
    ):
        if len(old) != n or len(new) != n or not np.isfinite((*old, *new)).all():
            continue  # others say so
        step = np.abs(np.subtract(new, old))
        if what == "position":
            step = record.limits.deviation(np.array(new), np.array(old))
        excess = step / (rate * dt)
        i = int(np.argmax(excess))
        if excess[i] > max(1 + _STEP_ROUNDING, worst[what][0] if what in worst else 0.0):
            text = (
                f"{what} of {record.joints[i]} changes by {step[i]:.4g} within "
                f"{1e3 * (after.t - before.t):.3g} ms; allowed is {rate[i] * dt:.4g}"
            )
            worst[what] = float(excess[i]), after.t, text


def follows(record: SequenceRecord, before: Command, after: Command) -> bool:
    """Whether a command acts while the one before still does."""
    silence = after.t - before.t
    return before.life == after.life and silence <= COMMAND_TIMEOUT
