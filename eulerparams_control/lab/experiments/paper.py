"""The paper reproduced: which experiments are its claims, and the table of all of them.

The page has one sentence, one table, then a section for each claim.
"""

import json
import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from rich import box
from rich.table import Table
from rich.text import Text

from eulerparams_control.analysis.html import MISSING, write_html
from eulerparams_control.analysis.verdict import groups
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.experiments.evaluate import REPORT, Outcome
from eulerparams_control.lab.experiments.laws_table import table_of_laws
from eulerparams_control.lab.experiments.model import Experiment, equation
from eulerparams_control.resources import config_names

_CLAIM = re.compile(r"e(\d+)")
_DEMO = "demo"  # two claims at once, for a first look
COMPARISON = (
    *("closed_path_contact", "guided_path", "closed_path_law", "joint_stiffness"),
    *("geometric_contact", "geometric", "large_errors", "half_turn", "screw_path", "screw"),
    *("set_points", "log_filter"),
)
"""The experiments that compare laws: which one is in your controller?"""

MAPS = ("map_failure", "map_set_points", "map_stiffness")
"""The experiments over all directions of the tool axis."""

STOPS = (
    *("stops", "stops_contact", "stops_pushed", "stops_wall", "stops_load", "stops_admittance"),
)
"""The experiments of stops under efforts: many arms, joints and rates."""

_OTHERS = 92  # characters of the columns beside the claim


def number_of(experiment: Experiment) -> str:
    """Return the number of a claim of the paper, such as ``E7``; "" if it is none."""
    match = _CLAIM.fullmatch(experiment.name)
    return f"E{match.group(1)}" if match else ""


def paper_experiments() -> list[Experiment]:
    """Return the experiments of the paper's claims in their order, then those beyond it."""
    names = [
        name
        for name in config_names("experiments")
        if name not in (_DEMO, *COMPARISON, *MAPS, *STOPS)
    ]
    experiments = [e for e in map(load_experiment, names) if not _is_in_real_time(e)]
    return sorted(experiments, key=lambda e: (not number_of(e), int(number_of(e)[1:] or 0)))


def _is_in_real_time(experiment: Experiment) -> bool:
    """Return whether an experiment is in real time, where no two runs are the same."""
    return any(variant.is_in_real_time for variant in experiment.variants.values())


def claims_of(outcomes: Sequence[Outcome], comparison: bool = False) -> list[Outcome]:
    """Return those that are claims of the paper; of the comparison all are its claims."""
    return [outcome for outcome in outcomes if comparison or number_of(outcome.experiment)]


def headline(outcomes: Sequence[Outcome], comparison: bool = False) -> str:
    """Return how many claims of the paper, or of the comparison, are met, in one sentence."""
    claims = claims_of(outcomes, comparison)
    met = sum(outcome.met for outcome in claims)
    of = "comparison" if comparison else "paper"
    text = f"{met} of {len(claims)} claims of the {of} met"

    def name(outcome: Outcome) -> str:
        return number_of(outcome.experiment) or outcome.experiment.name

    if failed := [name(o) for o in claims if o.error]:
        text += f"; {', '.join(failed)} could not run"
    if missed := [name(o) for o in claims if o.missed]:
        text += f"; not met: {', '.join(missed)}"
    if unjudged := [name(o) for o in claims if not (o.verdicts or o.error)]:
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


def write_paper_summary(path: Path, outcomes: Sequence[Outcome], comparison: bool = False) -> None:
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
    content = {"headline": headline(outcomes, comparison), "experiments": rows}
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def write_paper_page(path: Path, outcomes: Sequence[Outcome], comparison: bool = False) -> None:
    """Write the page.

    Args:
        path: of the file; results of experiments are in folders beside it.
        outcomes: of the experiments.
        comparison: whether it is that of the comparison, with its table of laws.
    """
    claims = claims_of(outcomes, comparison)
    write_html(
        path,
        "paper.html",
        headline=headline(outcomes, comparison),
        laws=table_of_laws() if comparison else (),
        claims=claims,
        beyond=[outcome for outcome in outcomes if outcome not in claims],
        number_of=number_of,
        equations=lambda of: [equation(number) for number in of.equations],
        command=lambda of: shlex.join([".venv/bin/experiment", of.source, "--out", "out"]),
        REPORT=REPORT,
    )
