"""Is each command one that a robot may be given, and each step one that the limits allow?

The time of a step is that between two publications, at least a period of joint_states: answers to
states that come in a burst are a period apart each.  A command that is repeated under its stamp,
since its state was, counts from its first publication.  After a silence in which the robot has
braked, and after a restart, a command has no predecessor.

In real time a busy machine lets a controller publish late: then the time may also be that between
the stamps of the states, up to state_timeout, and a period more.
"""

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from eulerparams_control.control.mode import Cause
from eulerparams_control.lab.campaign.draws import COMMAND_TIMEOUT
from eulerparams_control.lab.campaign.oracles.base import Oracle, Violation
from eulerparams_control.lab.campaign.record import Command, SequenceRecord

# Beyond a limit by this part of it is rounding.
_ROUNDING = 1e-9

# Part of a step that is rounding.
_STEP_ROUNDING = 1e-6


class Survives(Oracle):
    """The controller does not end, and expects all that it is given."""

    name: ClassVar[str] = "survives"
    claim: ClassVar[str] = "no message ends the controller, or leads to an internal error"
    holds_if_starved: ClassVar[bool] = True

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return how it ended, or what it did not expect."""
        found = [self.violation(record.end, record.crash)] if record.crash else []
        errors = [said for said in record.said if said.cause == Cause.DEFECT]
        return found + [self.violation(said.t, said.message) for said in errors[:1]]


class Finite(Oracle):
    """Commands are whole, and of finite numbers."""

    name: ClassVar[str] = "finite"
    claim: ClassVar[str] = "every command has a finite number for each joint, and their names"
    holds_if_starved: ClassVar[bool] = True

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return the commands that are not."""
        return _first_of(record, self, self._fault)

    def _fault(self, command: Command, record: SequenceRecord) -> str:
        n = len(record.joints)
        if command.names != record.joints:
            return f"the joints are {', '.join(command.names)}"
        sizes = len(command.q), len(command.dq), len(command.effort)
        if sizes not in ((n, n, 0), (0, 0, n)):
            return f"there are {sizes} positions, velocities, efforts for {n} joints"
        values = (*command.q, *command.dq, *command.effort)
        return "" if np.isfinite(values).all() else f"the values are {values}"


class WithinLimits(Oracle):
    """Commands keep to the limits of the URDF."""

    name: ClassVar[str] = "limits"
    claim: ClassVar[str] = "no position, speed or effort beyond the limits of the URDF"
    holds_if_starved: ClassVar[bool] = True

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return the commands that do not."""
        return _first_of(record, self, self._fault)

    def _fault(self, command: Command, record: SequenceRecord) -> str:
        limits = record.limits
        for what, values, low, high in (
            ("position", command.q, limits.lower, limits.upper),
            ("speed", command.dq, -limits.velocity, limits.velocity),
            ("effort", command.effort, -limits.effort, limits.effort),
        ):
            beyond = _beyond(np.array(values), low, high)
            if beyond is not None:
                most = low[beyond], high[beyond]
                joint = record.joints[beyond]
                return f"{what} {values[beyond]:.6g} of {joint}, limits {most[0]:g} ... {most[1]:g}"
        return ""


def _beyond(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> int | None:
    """Return the index of a value that is out of bounds, or None; others judge what is no value."""
    if values.shape != low.shape:
        return None
    slack = _ROUNDING * np.maximum(1.0, np.minimum(np.abs(high), 1e6))
    out = np.isfinite(values) & ((values < low - slack) | (values > high + slack))
    return int(np.argmax(out)) if out.any() else None


def _first_of(
    record: SequenceRecord, oracle: Oracle, fault: Callable[[Command, SequenceRecord], str]
) -> list[Violation]:
    """Return the first command with a fault, and how many have one."""
    found = [(command, text) for command in record.commands if (text := fault(command, record))]
    if not found:
        return []
    command, text = found[0]
    return [oracle.violation(command.t, f"{text}; {len(found)} commands in all")]


class NoJump(Oracle):
    """Commands do not jump."""

    name: ClassVar[str] = "no jump"
    claim: ClassVar[str] = (
        "efforts change by at most max_effort_rate, positions by at most the velocity limit, times "
        "the time between two commands"
    )

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return the largest jump of each kind."""
        worst: dict[str, tuple[float, Violation]] = {}
        first: Command | None = None  # of those that are the same
        previous: Command | None = None
        for command in record.commands:
            if first is None or previous is None or not follows(record, previous, command):
                first = command
            elif command[2:] != previous[2:]:
                self._compare(record, first, command, worst)
                first = command
            previous = command
        return [violation for _, violation in worst.values()]

    def _compare(
        self,
        record: SequenceRecord,
        before: Command,
        after: Command,
        worst: dict[str, tuple[float, Violation]],
    ) -> None:
        dt = max(after.t - before.t, record.period)
        if record.jitter:
            by_stamps = min(after.stamp - before.stamp, record.state_timeout)
            dt = max(dt, by_stamps) + record.period
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
                worst[what] = float(excess[i]), self.violation(after.t, text)


def follows(record: SequenceRecord, before: Command, after: Command) -> bool:
    """Whether a command acts while the one before still does."""
    silence = after.t - before.t
    return before.life == after.life and silence <= COMMAND_TIMEOUT + record.jitter
