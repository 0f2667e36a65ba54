"""Interface of the oracles."""

from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

from eulerparams_control.lab.campaign.record import SequenceRecord


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


class Oracle(ABC):
    """Judges what was seen of a sequence.

    Attributes:
        name: of it.
        claim: what must hold, in words.
        holds_if_starved: whether it must hold also on a machine that has no time for it.
    """

    registry: ClassVar[dict[str, type["Oracle"]]] = {}
    name: ClassVar[str] = ""
    claim: ClassVar[str] = ""
    holds_if_starved: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        """Register an oracle by its name."""
        if cls.name:
            Oracle.registry[cls.name] = cls

    @abstractmethod
    def check(self, record: SequenceRecord) -> list[Violation]:
        """Return what must not be."""

    def violation(self, t: float, text: str) -> Violation:
        """Return a violation found by this oracle."""
        return Violation(self.name, t, text)


def judge(record: SequenceRecord) -> list[Violation]:
    """Return what all oracles find, in the order of time."""
    found = [violation for kind in Oracle.registry.values() for violation in kind().check(record)]
    return sorted(found, key=lambda violation: violation.t)
