"""Recovered when it could: all faults over, the arm goes where it is sent."""

from typing import ClassVar

from eulerparams_control.lab.campaign.oracles.base import Oracle, Violation
from eulerparams_control.lab.campaign.record import ERROR, SequenceRecord

# The tip is there within these [m], [deg].
_NEAR, _ALIGNED = 0.005, 1.0


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
