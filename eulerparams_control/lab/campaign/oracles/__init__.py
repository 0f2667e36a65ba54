"""Oracles: each is a property that must hold in a sequence, whatever goes wrong in it.

An oracle sees what was on the wire and where the arm was, never what the controller thought.
One is added as a function in a file of this folder, which is found by being there.
"""

import importlib
import pkgutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from eulerparams_control.lab.campaign.record import SequenceRecord

type Found = Iterable[tuple[float, str]]
"""When [s] of the sequence something is that must not be, and what, with the numbers."""


class Violation(NamedTuple):
    """A violation of what must hold.

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


def worst_of(excesses: Iterable[tuple[str, float, float, str]]) -> Found:
    """Return the worst excess of each kind.

    Args:
        excesses: kind, value over what is allowed, time [s], words.
    """
    worst: dict[str, tuple[float, float, str]] = {}
    for kind, part, t, text in excesses:
        if part > worst.get(kind, (1.0,))[0]:
            worst[kind] = part, t, text
    return [(t, text) for _, t, text in worst.values()]


for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    importlib.import_module(_module.name)
