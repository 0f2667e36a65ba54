"""The page of one experiment: that of its runs, or of its numbers if it has no runs."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.labels import quantity
from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.quantity import Prediction
from eulerparams_control.analysis.verdict import Verdict
from eulerparams_control.lab.experiments.html import NOT_JUDGED, criteria, equations, page, picture
from eulerparams_control.lab.experiments.library import Result
from eulerparams_control.lab.experiments.model import Experiment


def write_report(
    path: Path,
    experiment: Experiment,
    digests: Sequence[Digest],
    predictions: Sequence[Prediction],
    result: Result,
    verdicts: Sequence[Verdict],
    sentence: str,
    figure: str,
) -> None:
    """Write report.html of an experiment.

    Args:
        path: of the file.
        experiment: the experiment.
        digests: of its runs; none if it is in the library alone.
        predictions: curves over time, for these runs.
        result: of its library experiment.
        verdicts: on its criteria.
        sentence: what it shows.
        figure: its picture as SVG.
    """
    if digests:
        claim, first = experiment.claim, experiment.picture
        write_page(path, digests, claim, sentence, verdicts, first, predictions)
        return
    text = _of_numbers(experiment, result, verdicts, sentence, figure)
    path.write_text(text, encoding="utf-8")


def _of_numbers(
    experiment: Experiment,
    result: Result,
    verdicts: Sequence[Verdict],
    sentence: str,
    figure: str,
) -> str:
    rows = "".join(
        f"<tr><td>{escape(number.text)}</td>"
        f'<td class="number">{escape(quantity(number.value, number.unit))}</td></tr>'
        for number in result.numbers.values()
    )
    met = sum(verdict.met for verdict in verdicts)
    kind = "yes" if met == len(verdicts) else "no"
    count = f"{met} of {len(verdicts)} criteria met"
    if not verdicts:
        kind, count = "soft", NOT_JUDGED
    body = [
        f"<h1>{escape(sentence or experiment.claim)}</h1>",
        f'<p class="soft">{escape(experiment.claim)} '
        f'<span class="{kind}">{count}.</span></p>',
        f'<div class="columns"><div>{equations(experiment.equations)}</div>'
        f"{picture(figure, 'this experiment draws none')}</div>",
        "<h2>Criteria</h2>",
        criteria(verdicts),
        f'<h2>Numbers</h2><div class="scroll"><table><tbody>{rows}</tbody></table></div>',
    ]
    return page(sentence or experiment.name, body)
