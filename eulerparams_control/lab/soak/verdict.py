"""What must hold of a soak."""

import math
import statistics
from collections.abc import Iterator
from dataclasses import dataclass

from eulerparams_control.lab.soak.ledger import Histogram
from eulerparams_control.lab.soak.record import Life, Page, SoakPlan, SoakRecord, Usage

GROWTH = 0.01
"""Memory of a node may grow by this part of what it was after the warm-up."""

SLOWER = 1.5
"""The p99 of the last quarter may be this many times that of the first one.

Between runs of the same round trip p99 differs by 30 % where nothing else runs; the factor leaves
as much again for what else the machine does in one quarter and not in the other.
"""

MONITOR = "monitor"
"""The process that watches, which is not judged."""

_AT_ENDS = 10  # samples at each end, whose median counts


@dataclass(frozen=True)
class SoakVerdict:
    """One criterion judged.

    Attributes:
        text: what was measured.
        of: of which node or controller.
        measured: in words, with the unit.
        bound: in words.
        met: whether it holds.
    """

    text: str
    of: str
    measured: str
    bound: str
    met: bool


def judge(record: SoakRecord) -> list[SoakVerdict]:
    """Return the verdict on each criterion."""
    return [
        SoakVerdict(
            "all nodes run to the end", "all", record.death or "they do", "none dies",
            not record.death,
        ),
        *_memory(record),
        *_latency(record),
        *_answers(record),
    ]  # fmt: skip


def growth(life: Life, warm_up: float) -> float:
    """Return the growth of memory, shared or own, whichever grew more; NaN if it is unknown.

    Args:
        life: of a process.
        warm_up: [s] of its beginning that do not count.
    """
    begin = max(0.0, life.samples[0][0] + warm_up)
    later = [usage for t, usage in life.samples if t >= begin]
    if len(later) < 2 * _AT_ENDS:
        return math.nan
    return max(
        _median(later[-_AT_ENDS:], name) / _median(later[:_AT_ENDS], name) - 1
        for name in ("rss", "uss")
    )


def _median(samples: list[Usage], name: str) -> float:
    return float(statistics.median(getattr(usage, name) for usage in samples))


def longest(record: SoakRecord) -> list[Life]:
    """Return the longest life of each node."""
    lives: dict[str, Life] = {}
    for life in record.lives:
        best = lives.get(life.name)
        if life.name != MONITOR and (best is None or len(life.samples) > len(best.samples)):
            lives[life.name] = life
    return list(lives.values())


def _memory(record: SoakRecord) -> Iterator[SoakVerdict]:
    for life in longest(record):
        part, text = growth(life, record.plan.warm_up), "growth of its memory after the warm-up"
        measured = "unknown" if math.isnan(part) else f"{100 * part:+.2f} %"
        yield SoakVerdict(text, life.name, measured, f"<= {100 * GROWTH:g} %", part <= GROWTH)


def quarter(plan: SoakPlan, pages: list[Page], number: int) -> Histogram:
    """Return the latencies of a quarter of the time, 0 to 3, after the warm-up."""
    size, together = plan.pages // 4, Histogram()
    for page in pages[1 + number * size : 1 + (number + 1) * size]:
        together.merge(page.latencies)
    return together


def _latency(record: SoakRecord) -> Iterator[SoakVerdict]:
    for controller, pages in record.pages.items():
        first, last = (quarter(record.plan, pages, k).percentile(99) for k in (0, 3))
        yield SoakVerdict(
            "p99 of the round trip, last quarter by first",
            controller,
            f"{last / first:.2f} ({1e3 * last:.2f} by {1e3 * first:.2f} ms)",
            f"<= {SLOWER:g}",
            last <= SLOWER * first,
        )


def _answers(record: SoakRecord) -> Iterator[SoakVerdict]:
    for controller, pages in record.pages.items():
        mine = [one for one in record.unanswered if one.controller == controller]
        unexplained = sum(not one.cause for one in mine)
        states = sum(page.states for page in pages[1:])
        yield SoakVerdict(
            "states without a command that nothing explains",
            controller,
            f"{unexplained} ({len(mine)} without a command, of {states} states)",
            "0 of at least 1",
            unexplained == 0 and states > 0,
        )
