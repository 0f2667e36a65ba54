"""The paper reproduced: which experiments are its claims, and the table of all of them.

The page has one sentence, one table, then a section for each claim.
"""

import json
import re
import shlex
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

from rich import box
from rich.table import Table
from rich.text import Text

from eulerparams_control.analysis.verdict import VerdictGroup, groups
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.experiments.html import (
    MISSING,
    NOT_JUDGED,
    bound,
    criteria,
    equations,
    mark,
    page,
    picture,
)
from eulerparams_control.lab.experiments.model import Experiment
from eulerparams_control.lab.experiments.result import REPORT, Outcome
from eulerparams_control.resources import config_names

_CLAIM = re.compile(r"e(\d+)")
_SHOWN_ELSEWHERE = ("demo",)  # two claims at once, for a first look

_OTHERS = 92  # characters of the columns beside the claim

_TITLE = "The Role of Euler Parameters in Robot Control, reproduced"


def number_of(experiment: Experiment) -> str:
    """Return the number of a claim of the paper, such as ``E7``; "" if it is none."""
    match = _CLAIM.fullmatch(experiment.name)
    return f"E{match.group(1)}" if match else ""


def paper_experiments() -> list[Experiment]:
    """Return the experiments of the paper's claims in their order, then those beyond it."""
    names = [name for name in config_names("experiments") if name not in _SHOWN_ELSEWHERE]
    experiments = [e for e in map(load_experiment, names) if not _is_in_real_time(e)]
    return sorted(experiments, key=lambda e: (not number_of(e), int(number_of(e)[1:] or 0)))


def _is_in_real_time(experiment: Experiment) -> bool:
    """Return whether an experiment is in real time, where no two runs are the same."""
    return any(variant.is_in_real_time for variant in experiment.variants.values())


def headline(outcomes: Sequence[Outcome]) -> str:
    """Return how many claims of the paper are met, in one sentence."""
    claims = [outcome for outcome in outcomes if number_of(outcome.experiment)]
    met = sum(outcome.met for outcome in claims)
    text = f"{met} of {len(claims)} claims of the paper met"
    if failed := [number_of(o.experiment) for o in claims if o.error]:
        text += f"; {', '.join(failed)} could not run"
    if missed := [number_of(o.experiment) for o in claims if o.missed]:
        text += f"; not met: {', '.join(missed)}"
    if unjudged := [number_of(o.experiment) for o in claims if not (o.verdicts or o.error)]:
        text += f"; not judged: {', '.join(unjudged)}"
    return text + "."


def paper_table(outcomes: Sequence[Outcome], width: int) -> Table:
    """Return the summary for a terminal of some characters: a line for each experiment."""
    table = Table(title=None, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    widths = {"": 17, "claim": max(8, width - _OTHERS), "predicted": 16, "bound": 18}
    for name in ("", "claim", "predicted", "measured", "bound", "met"):
        table.add_column(name, no_wrap=True, overflow="ellipsis", max_width=widths.get(name))
    for outcome in outcomes:
        first = groups(outcome.verdicts)[0] if outcome.verdicts else None
        style = "green" if outcome.met else "red" if outcome.missed or outcome.error else "yellow"
        met = sum(verdict.met for verdict in outcome.verdicts)
        count = "error" if outcome.error else f"{met}/{len(outcome.verdicts)}"
        table.add_row(
            number_of(outcome.experiment) or outcome.experiment.name,
            Text(outcome.experiment.claim),
            Text((first and first.first.predicted) or MISSING),
            first.measured if first else MISSING,
            first.first.bound if first else MISSING,
            Text(count, style),
        )
    return table


def write_paper_summary(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Write summary.json of all experiments: claims, criteria with what was measured, errors."""
    rows = []
    for outcome in outcomes:
        criteria = [
            {
                "text": group.first.text,
                "variants": [verdict.variant for verdict in group.verdicts],
                "predicted": group.first.predicted,
                "measured": group.measured,
                "bound": group.first.bound,
                "met": group.met,
            }
            for group in groups(outcome.verdicts)
        ]
        rows.append(
            {
                "experiment": outcome.experiment.name,
                "claim_of_paper": bool(number_of(outcome.experiment)),
                "claim": outcome.experiment.claim,
                "met": outcome.met if outcome.verdicts or outcome.error else None,
                "error": outcome.error,
                "sentence": outcome.sentence,
                "seconds": round(outcome.seconds, 1),
                "criteria": criteria,
            }
        )
    content = {"headline": headline(outcomes), "experiments": rows}
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def write_paper_page(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Write the page.

    Args:
        path: of the file; results of experiments are in folders beside it.
        outcomes: of the experiments.
    """
    claims = [outcome for outcome in outcomes if number_of(outcome.experiment)]
    beyond = [outcome for outcome in outcomes if not number_of(outcome.experiment)]
    body = [
        f"<header><h1>{escape(headline(outcomes))}</h1>",
        f'<p class="soft">{_ABOUT}</p></header>',
        _overview(claims),
        *(section for outcome in claims for section in _section(outcome)),
    ]
    if beyond:
        met = sum(outcome.met for outcome in beyond)
        body += [
            f"<h1 style='margin-top:64px'>Beyond the paper: {met} of {len(beyond)} met.</h1>",
            '<p class="soft">What an engineer asks next: other arms, real sensors, contact.</p>',
            _overview(beyond),
            *(section for outcome in beyond for section in _section(outcome)),
        ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page(_TITLE, body), encoding="utf-8")


_ABOUT = (
    "F. Caccavale, B. Siciliano, L. Villani, <i>The Role of Euler Parameters in Robot Control</i>, "
    "1999. Each claim was put to the test: E1, E2, E5 in the library alone, the others through "
    "the real nodes and topics, an arm in PyBullet and recorded bags, in lock-step, so that they "
    "repeat. Dashed in the figures: what theory predicts; dotted: bounds."
)


def _overview(outcomes: Sequence[Outcome]) -> str:
    head = "".join(
        f"<th>{name}</th>" for name in ("", "claim", "predicted", "measured", "bound", "criteria")
    )
    rows = "".join(map(_row, outcomes))
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
        "</div>"
        '<p class="soft small">The numbers are those of the first criterion of each, named under '
        "the claim, over all the runs that it concerns; the sections have all of them.</p>"
    )


def _row(outcome: Outcome) -> str:
    name = outcome.experiment.name
    first = groups(outcome.verdicts)[0] if outcome.verdicts else None
    met = sum(verdict.met for verdict in outcome.verdicts)
    style = "yes" if outcome.met else "no"
    sign = "✓ " if outcome.met else "✗ "
    count = "could not run" if outcome.error else f"{met} of {len(outcome.verdicts)}"
    if not (outcome.verdicts or outcome.error):
        style, sign, count = "soft", "", NOT_JUDGED
    texts = (MISSING, "nothing", MISSING)
    if first:
        texts = first.first.predicted or MISSING, first.measured, bound(first.first)
    cells = zip(texts, ("", "", "whole"), strict=True)
    number = number_of(outcome.experiment) or name
    return (
        f'<tr><td><a href="#{escape(name)}">{escape(number)}</a></td>'
        f"<td>{escape(outcome.experiment.claim)}{_criterion(first)}</td>"
        + "".join(f'<td class="{kind}">{escape(cell)}</td>' for cell, kind in cells)
        + f'<td class="{style}">{sign}{escape(count)}</td></tr>'
    )


def _criterion(group: VerdictGroup | None) -> str:
    """Return what the numbers of a row are of."""
    if group is None:
        return ""
    first = group.first
    of = first.variant if len(group.verdicts) == 1 else f"{len(group.verdicts)} runs"
    text = f"{first.text} ({of})" if of != "library" else first.text
    return f'<div class="soft small">{escape(text).replace("_", "_<wbr>")}</div>'


def _section(outcome: Outcome) -> Iterator[str]:
    """Yield the section of an experiment."""
    experiment = outcome.experiment
    number = number_of(experiment) or experiment.name
    yield f'<section id="{escape(experiment.name)}">'
    yield f"<h2>{escape(number)}. {escape(experiment.claim)} {_verdict(outcome)}</h2>"
    if outcome.error:
        yield f'<div class="warning">It could not run. {escape(outcome.error)}</div>'
    yield f"<p>{escape(outcome.sentence)}</p>"
    for variant, t in outcome.diverged.items():
        yield f'<p class="soft small">{escape(variant)} diverged at {t:.3f} s.</p>'
    why = "the experiment could not run" if outcome.error else "no run has recorded its quantity"
    yield (
        f'<div class="columns"><div>{equations(experiment.equations)}</div>'
        f"{picture('' if outcome.error else outcome.figure, why)}</div>"
    )
    if outcome.verdicts:
        yield criteria(outcome.verdicts)
    yield _repeat(outcome)
    yield "</section>"


def _verdict(outcome: Outcome) -> str:
    if outcome.met:
        return mark(True)
    if outcome.error:
        return '<span class="no">could not run</span>'
    return mark(False) if outcome.verdicts else f'<span class="soft">{NOT_JUDGED}</span>'


def _repeat(outcome: Outcome) -> str:
    """Return the command that repeats an experiment, and where its own page is."""
    command = shlex.join([".venv/bin/experiment", outcome.experiment.source, "--out", "out"])
    link = (
        f' &nbsp; <a href="{escape(outcome.experiment.name)}/{REPORT}">its page, with all curves'
        "</a>"
        if (outcome.folder / REPORT).is_file()
        else ' &nbsp; <span class="soft">it has no page</span>'
    )
    took = f" ({outcome.seconds:.0f} s)" if outcome.seconds else ""
    return f'<p class="small">Again: <code>{escape(command)}</code>{took}{link}</p>'
