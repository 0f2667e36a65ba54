"""From one command to the next: is it a step that the limits allow in that time?

The time is that between the two publications, at least a period of joint_states: answers to
states that come in a burst are a period apart each.  A command that is repeated under its stamp,
since its state was, counts from its first publication.  After a silence in which the robot has
braked, and after a restart, a command has no predecessor.

In real time a busy machine lets a controller publish late: then the time may also be that between
the stamps of the states, up to state_timeout, and a period more.
"""

from typing import ClassVar

import numpy as np

from eulerparams_control.lab.campaign.oracles.base import Oracle, Violation
from eulerparams_control.lab.campaign.record import COMMAND_TIMEOUT, Command, SequenceRecord

# Part of a step that is rounding.
_ROUNDING = 1e-6


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
            if first is None or previous is None or not _follows(record, previous, command):
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
            excess = step / (rate * dt)
            i = int(np.argmax(excess))
            if excess[i] > max(1 + _ROUNDING, worst[what][0] if what in worst else 0.0):
                text = (
                    f"{what} of {record.joints[i]} changes by {step[i]:.4g} within "
                    f"{1e3 * (after.t - before.t):.3g} ms; allowed is {rate[i] * dt:.4g}"
                )
                worst[what] = float(excess[i]), self.violation(after.t, text)


def _follows(record: SequenceRecord, before: Command, after: Command) -> bool:
    """Whether a command acts while the one before still does."""
    silence = after.t - before.t
    return before.life == after.life and silence <= COMMAND_TIMEOUT + record.jitter
