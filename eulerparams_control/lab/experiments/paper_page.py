"""The page of the paper reproduced: one sentence, one table, then a section for each claim."""

import shlex
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

from eulerparams_control.analysis.verdict import VerdictGroup, groups
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
from eulerparams_control.lab.experiments.paper import headline, number_of
from eulerparams_control.lab.experiments.result import REPORT, Outcome

_TITLE = "The Role of Euler Parameters in Robot Control, reproduced"


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
