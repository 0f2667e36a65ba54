"""Verdicts on the criteria of an experiment: as summary.json has them, and for pages."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from eulerparams_control.analysis.labels import quantity

_FEW = 3  # runs that are named each, even if they are the same


@dataclass(frozen=True)
class Verdict:
    """One criterion judged.

    Attributes:
        text: what was measured, in words.
        variant: of which variant, or of which of them together.
        predicted: by theory or a prototype; "" if nothing.
        measured: the number.
        unit: of it.
        bound: in words, such as ``< 0.001``.
        met: whether it holds.
    """

    text: str
    variant: str
    predicted: str
    measured: float
    unit: str
    bound: str
    met: bool


def verdict_from_json(content: Mapping[str, Any]) -> Verdict:
    """Return a verdict from summary.json."""
    return Verdict(**{**content, "measured": float(content["measured"])})


def all_met(verdicts: Sequence[Verdict]) -> bool | None:
    """Return whether every criterion that was judged is met; None if none was judged."""
    return all(verdict.met for verdict in verdicts) if verdicts else None


def shown(verdict: Verdict) -> str:
    """Return what was measured, with more digits where it has to be between two bounds."""
    if "," in verdict.bound and math.isfinite(verdict.measured):
        return f"{f'{verdict.measured:#.5g}'.rstrip('.')} {verdict.unit}".rstrip()
    return quantity(verdict.measured, verdict.unit)


@dataclass(frozen=True)
class VerdictGroup:
    """The verdicts on one criterion.

    Attributes:
        verdicts: one a variant, or one for several together.
    """

    verdicts: tuple[Verdict, ...]

    @property
    def first(self) -> Verdict:
        """The first verdict; it has all that they share."""
        return self.verdicts[0]

    @property
    def met(self) -> bool:
        """Whether all hold."""
        return all(verdict.met for verdict in self.verdicts)

    @property
    def measured(self) -> str:
        """The values in words: one, or from the least to the largest."""
        ordered = sorted(self.verdicts, key=lambda verdict: verdict.measured)
        least, most = shown(ordered[0]), shown(ordered[-1])
        if least == most:
            return least
        return f"{least.removesuffix(self.first.unit).strip()} to {most}"

    @property
    def in_short(self) -> tuple[Verdict, ...]:
        """The verdicts to show: the first alone if it is the same for many."""
        are_same = len({(shown(verdict), verdict.met) for verdict in self.verdicts}) == 1
        return self.verdicts[:1] if are_same and len(self.verdicts) > _FEW else self.verdicts

    @property
    def bound(self) -> str:
        """What is asked for, with its unit."""
        return f"{self.first.bound} {self.first.unit}".rstrip()


def groups(verdicts: Sequence[Verdict]) -> list[VerdictGroup]:
    """Return the verdicts by criterion, in the order of the file."""
    found = groupby(verdicts, key=lambda verdict: (verdict.text, verdict.predicted, verdict.bound))
    return [VerdictGroup(tuple(group)) for _, group in found]
