"""Interface of the oracles."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from eulerparams_control.lab.campaign.record import SequenceRecord

type Found = Iterable[tuple[float, str]]
"""When [s] of the sequence something is that must not be, and what, with the numbers."""


class Violation(NamedTuple):
    """Something that must not be.

    Attributes:
        oracle: name of who found it.
        t: [s] of the sequence.
        text: what, with the numbers.
    """

    oracle: str
    t: float
    text: str

    def __str__(self) -> str:
        """Return it as a line."""
        return f"{self.oracle} at {self.t:.3f} s: {self.text}"


@dataclass(frozen=True)
class Oracle:
    """Judges what was seen of a sequence.

    Attributes:
        claim: what must hold, in words.
        check: returns what must not be.
    """

    registry: ClassVar[dict[str, "Oracle"]] = {}

    claim: str
    check: Callable[[SequenceRecord], Found]


def oracle[F: Callable[[SequenceRecord], Found]](name: str, claim: str) -> Callable[[F], F]:
    """Register a function of a record as an oracle, with what must hold."""

    def register(check: F) -> F:
        Oracle.registry[name] = Oracle(claim, check)
        return check

    return register


def judge(record: SequenceRecord) -> list[Violation]:
    """Return what all oracles find, in the order of time."""
    found = [
        Violation(name, t, text)
        for name, each in Oracle.registry.items()
        for t, text in each.check(record)
    ]
    return sorted(found, key=lambda violation: violation.t)
