"""Each command for itself: is it one that a robot may be given?"""

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from eulerparams_control.lab.campaign.oracles.base import Oracle, Violation
from eulerparams_control.lab.campaign.record import DEFECT, Command, SequenceRecord

# Beyond a limit by this part of it is rounding.
_ROUNDING = 1e-9


class Survives(Oracle):
    """The controller does not end, and expects all that it is given."""

    name: ClassVar[str] = "survives"
    claim: ClassVar[str] = "no message ends the controller, or leads to an internal error"
    holds_if_starved: ClassVar[bool] = True

    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return how it ended, or what it did not expect."""
        found = [self.violation(record.end, record.crash)] if record.crash else []
        errors = [said for said in record.said if DEFECT in said.message]
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
