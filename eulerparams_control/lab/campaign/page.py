"""The results of a campaign: a page for people, and a file for programs."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from eulerparams_control.analysis.html import write_html
from eulerparams_control.lab.campaign.oracles import Oracle
from eulerparams_control.lab.campaign.outcome import SequenceOutcome, count_by_oracle, headline
from eulerparams_control.lab.campaign.plan import CONTROLLERS, faults_of


def write_summary(path: Path, outcomes: Sequence[SequenceOutcome]) -> None:
    """Write all outcomes as JSON."""
    found = count_by_oracle(outcomes)
    content = {
        "sentence": headline(outcomes),
        "met": all(outcome.is_good for outcome in outcomes),
        "protective_stops": sum(outcome.stops for outcome in outcomes),
        "oracles": {
            name: {"claim": kind.claim, "sequences_with_a_violation": found[name]}
            for name, kind in Oracle.registry.items()
        },
        "sequences": [outcome.as_json() for outcome in outcomes],
    }
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def write_page(path: Path, outcomes: Sequence[SequenceOutcome]) -> None:
    """Write the page; it loads nothing."""
    found = count_by_oracle(outcomes)
    write_html(
        path,
        "campaign.html",
        headline=headline(outcomes),
        failed=[outcome for outcome in outcomes if not outcome.is_good],
        faults_of=faults_of,
        oracles=[(name, kind.claim, found[name]) for name, kind in Oracle.registry.items()],
        runs=list(_runs(outcomes)),
        faults=_faults(outcomes),
        controllers=CONTROLLERS,
    )


def _runs(outcomes: Sequence[SequenceOutcome]) -> Iterator[tuple[str, int, int, list[str]]]:
    """Yield each controller: its name, its sequences, those that failed, numbers."""
    for controller in CONTROLLERS:
        some = [outcome for outcome in outcomes if outcome.plan.controller == controller]
        if some:
            failed = sum(not outcome.is_good for outcome in some)
            yield controller, len(some), failed, _numbers(some)


def _numbers(some: Sequence[SequenceOutcome]) -> list[str]:
    """Return commands, times, and the worst error of the tip."""
    good = [outcome for outcome in some if not outcome.error]
    worst = [max((o.tip_error[k] for o in good), default=0.0) for k in (0, 1)]
    return [
        f"{sum(outcome.commands for outcome in some):,}",
        f"{sum(outcome.duration for outcome in some):.0f} s",
        f"{sum(outcome.troubled for outcome in some):.0f} s",
        f"{1e3 * worst[0]:.2g} mm, {worst[1]:.2g} deg",
    ]


def _faults(outcomes: Sequence[SequenceOutcome]) -> dict[str, list[tuple[int, int]]]:
    """Return for each fault and controller the sequences with it, and those of them that failed."""
    with_it: Counter[tuple[str, str]] = Counter()
    failed: Counter[tuple[str, str]] = Counter()
    for outcome in outcomes:
        for name in set(outcome.faults):
            with_it[name, outcome.plan.controller] += 1
            failed[name, outcome.plan.controller] += not outcome.is_good
    return {
        name: [(with_it[name, controller], failed[name, controller]) for controller in CONTROLLERS]
        for name in sorted({name for name, _ in with_it})
    }
