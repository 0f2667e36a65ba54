"""The results of a campaign: a page for people, and a file for programs."""

import json
from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path

from eulerparams_control.lab.campaign.oracles import Oracle
from eulerparams_control.lab.campaign.outcome import SequenceOutcome, count_by_oracle, headline
from eulerparams_control.lab.campaign.plan import CONTROLLERS, MODES, faults_of
from eulerparams_control.lab.experiments.html import cells, page, table

_TITLE = "Random faults"


def write_summary(path: Path, outcomes: Sequence[SequenceOutcome]) -> None:
    """Write all outcomes as JSON."""
    found = count_by_oracle(outcomes)
    content = {
        "sentence": headline(outcomes),
        "met": all(outcome.is_good for outcome in outcomes),
        "sequences_not_wholly_judged": sum(bool(outcome.unjudged) for outcome in outcomes),
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
    path.write_text(page(_TITLE, _body(outcomes)), encoding="utf-8")


def _body(outcomes: Sequence[SequenceOutcome]) -> list[str]:
    return [
        f"<h1>{escape(headline(outcomes))}</h1>",
        '<p class="soft">Each sequence is a control node, an arm and its user; between them '
        "messages are lost, late, doubled, mixed, frozen, noisy or no numbers, clocks jump, nodes "
        "are killed, and others interfere. Then all is well again, the reference is sent again, "
        "and the arm has to go there. A sequence is made of its seed.</p>",
        _failures(outcomes),
        "<section><h2>What must hold, and where it did not</h2>",
        _oracles(outcomes),
        "</section><section><h2>What was run</h2>",
        _runs(outcomes),
        "</section><section><h2>Which faults: sequences with each, and of them those that "
        "failed</h2>",
        _faults(outcomes),
        "</section>",
    ]


def _failures(outcomes: Sequence[SequenceOutcome]) -> str:
    failed = [outcome for outcome in outcomes if not outcome.is_good]
    if not failed:
        return ""
    return "".join(("<section><h2>What failed</h2>", *map(_failure, failed), "</section>"))


def _failure(outcome: SequenceOutcome) -> str:
    lines = [str(violation) for violation in outcome.violations]
    lines += [f"could not be run: {outcome.error}"] if outcome.error else []
    faults = "\n".join(str(fault) for fault in faults_of(outcome.plan))
    story = "\n".join(outcome.story)
    plan = outcome.plan
    title, what = ", ".join((plan.name, plan.motion, plan.orientation)), "\n".join(lines)
    return (
        f'<p class="no">{escape(title)}</p><p class="warning">{escape(what)}</p>'
        f"<p><code>{escape(plan.repeat)}</code></p>"
        "<details><summary>Its faults and its story</summary>"
        f"<pre>{escape(faults)}\n\n{escape(story)}</pre></details>"
    )


def _oracles(outcomes: Sequence[SequenceOutcome]) -> str:
    found = count_by_oracle(outcomes)
    rows = [
        (escape(name), escape(kind.claim), _count(found[name]))
        for name, kind in Oracle.registry.items()
    ]
    return table(("oracle", "what must hold", "sequences with a violation"), map(cells, rows))


def _runs(outcomes: Sequence[SequenceOutcome]) -> str:
    names = ("", "sequences", "failed", "commands", "simulated", "in trouble", "worst tip error")
    rows = []
    for mode in MODES:
        for controller in CONTROLLERS:
            some = [o for o in outcomes if (o.plan.mode, o.plan.controller) == (mode, controller)]
            if some:
                rows.append((f"{controller}, {mode}", *_run(some)))
    return table(names, map(cells, rows))


def _run(some: Sequence[SequenceOutcome]) -> tuple[str, ...]:
    """Return the row of a controller in a mode."""
    good = [outcome for outcome in some if not outcome.error]
    worst = [max((o.tip_error[k] for o in good), default=0.0) for k in (0, 1)]
    return (
        str(len(some)),
        _count(sum(not outcome.is_good for outcome in some)),
        f"{sum(outcome.commands for outcome in some):,}",
        f"{sum(outcome.duration for outcome in some):.0f} s",
        f"{sum(outcome.troubled for outcome in some):.0f} s",
        f"{1e3 * worst[0]:.2g} mm, {worst[1]:.2g} deg",
    )


def _faults(outcomes: Sequence[SequenceOutcome]) -> str:
    with_it: Counter[tuple[str, str]] = Counter()
    failed: Counter[tuple[str, str]] = Counter()
    for outcome in outcomes:
        for name in set(outcome.faults):
            with_it[name, outcome.plan.controller] += 1
            failed[name, outcome.plan.controller] += not outcome.is_good
    rows = []
    for name in sorted({name for name, _ in with_it}):
        keys = [(name, controller) for controller in CONTROLLERS]
        counts = [f"{with_it[key]} {_of(failed[key])}".strip() for key in keys]
        rows.append((escape(name.replace("_", " ")), *counts))
    return table(("fault", *CONTROLLERS), map(cells, rows))


def _of(failed: int) -> str:
    return f'<span class="no">({failed} failed)</span>' if failed else ""


def _count(value: int) -> str:
    return f'<span class="{"no" if value else "yes"}">{value}</span>'
