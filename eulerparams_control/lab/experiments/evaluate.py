"""Look at the runs of an experiment: judge its criteria, write summary, page and figure.

What came of it is in summary.json, for the terminal and for pages.  The figure is a chart over a
parameter, or its quantity over time, as SVG.
"""

import json
import math
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from matplotlib.figure import Figure

from eulerparams_control.analysis.charts import Chart, picture
from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.headline import describe, fill
from eulerparams_control.analysis.html import write_html
from eulerparams_control.analysis.labels import quantity
from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.quantities import get_metric, measure, quotient
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.static import chart_figure, image, quantity_figure, svg, write
from eulerparams_control.analysis.verdict import Verdict, all_met, verdict_from_json
from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.lab.experiments.library import Number, Result, is_map, run_library
from eulerparams_control.lab.experiments.model import Criterion, Experiment, equation
from eulerparams_control.lab.run.fingerprint import code, digest
from eulerparams_control.lab.run.run_cache import Run

SUMMARY, REPORT, FIGURE = "summary.json", "report.html", "figure.svg"
"""Files of an experiment in its folder, beside the bags."""


def judge(
    experiment: Experiment,
    recordings: Mapping[str, Recording],
    numbers: Mapping[str, Number] = MappingProxyType({}),
) -> list[Verdict]:
    """Return the verdict on each criterion, for each variant that it concerns.

    Args:
        experiment: the experiment.
        recordings: of its variants, as far as they ran.
        numbers: of its library experiment, if that ran.
    """
    return [
        verdict
        for criterion in experiment.criteria
        for verdict in (
            _of_library(criterion, numbers)
            if criterion.number
            else _verdicts(criterion, experiment, recordings)
        )
    ]


def _of_library(criterion: Criterion, numbers: Mapping[str, Number]) -> Iterator[Verdict]:
    if not numbers:
        return
    if criterion.number not in numbers:
        raise UnknownNameError("number of the library", criterion.number, numbers)
    number = numbers[criterion.number]
    text = criterion.text or number.text
    yield _verdict(criterion, "library", number.value, number.unit, text)


def _verdicts(
    criterion: Criterion, experiment: Experiment, recordings: Mapping[str, Recording]
) -> Iterator[Verdict]:
    metric = get_metric(criterion.metric)
    text = criterion.text or metric.description

    def measured(variant: str) -> float:
        return measure(criterion.metric, recordings[variant], **criterion.options)

    together = criterion.together
    if together:
        if set(together) <= recordings.keys():
            value, unit = _joined(criterion, list(map(measured, together)), metric.unit)
            sign = " / " if criterion.ratio else " - " if criterion.difference else ", "
            yield _verdict(criterion, sign.join(together), value, unit, text)
        return
    for variant in criterion.variants or experiment.variants:
        if variant in recordings:
            yield _verdict(criterion, variant, measured(variant), metric.unit, text)


def _joined(criterion: Criterion, values: list[float], unit: str) -> tuple[float, str]:
    """Return what the values of several variants are together, and its unit."""
    if criterion.difference:
        return abs(values[0] - values[1]), unit
    return (quotient(*values) if criterion.ratio else spread(values)), ""


def spread(values: Sequence[float]) -> float:
    """Return (max - min) / mean; NaN if a value is infinite."""
    if not all(map(math.isfinite, values)):
        return math.nan
    return quotient(max(values) - min(values), sum(values) / len(values))


def _verdict(criterion: Criterion, variant: str, measured: float, unit: str, text: str) -> Verdict:
    above, below = criterion.above, criterion.below
    bounds = [f"> {above:g}"] if above is not None else []
    bounds += [f"< {below:g}"] if below is not None else []
    met = (above is None or measured > above) and (below is None or measured < below)
    return Verdict(text, variant, criterion.predicted, measured, unit, ", ".join(bounds), met)


def why_nothing(experiment: Experiment) -> str:
    """Return why nothing was judged, in words."""
    of = {name for c in experiment.criteria for name in c.variants or c.together}
    if not of:
        return "nothing was judged: it has no criteria"
    names = ", ".join(sorted(of))
    return f"nothing was judged: its criteria need variants that did not run, of {names}"


def write_summary(
    path: Path,
    experiment: Experiment,
    recordings: Mapping[str, Recording],
    verdicts: Sequence[Verdict],
    **more: Any,
) -> None:
    """Write summary.json: the claim, each criterion with what was measured, and what diverged.

    It is ``"met": null`` if nothing was judged.

    Args:
        path: of the file.
        experiment: the experiment.
        recordings: of its variants.
        verdicts: on its criteria.
        more: what is written besides; JSON can hold it.
    """
    content = {
        "experiment": experiment.name,
        "claim": experiment.claim,
        "equations": list(experiment.equations),
        "met": all_met(verdicts),
        "criteria": [_json(asdict(verdict)) for verdict in verdicts],
        "diverged": dict(diverged(recordings)),
        **more,
    }
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def diverged(recordings: Mapping[str, Recording]) -> list[tuple[str, float]]:
    """Return the variants that diverged, and when [s]."""
    return [(name, r.diverged) for name, r in recordings.items() if r.diverged is not None]


def _json(values: dict[str, Any]) -> dict[str, Any]:
    """Return values that JSON can hold: it has no infinity and no NaN."""
    return {
        key: str(value) if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in values.items()
    }


@dataclass(frozen=True)
class Outcome:
    """Outcome of an experiment.

    Attributes:
        experiment: which it was.
        folder: what it left.
        verdicts: on its criteria.
        sentence: what it shows, with numbers.
        diverged: variants that diverged, and when [s].
        error: why it could not run, with the last words of a node; "" if it could.
        seconds: of all its runs, each by itself, and of looking at them.
    """

    experiment: Experiment
    folder: Path
    verdicts: tuple[Verdict, ...] = ()
    sentence: str = ""
    diverged: Mapping[str, float] = field(default_factory=dict)
    error: str = ""
    seconds: float = 0.0

    @property
    def met(self) -> bool:
        """Whether it ran, something was judged, and all of that is met."""
        return not self.error and all_met(self.verdicts) is True

    @property
    def missed(self) -> bool:
        """Whether it ran, and a criterion is not met."""
        return not self.error and all_met(self.verdicts) is False

    @property
    def count(self) -> str:
        """How many of its criteria are met, in words."""
        if self.error:
            return "could not run"
        met = sum(verdict.met for verdict in self.verdicts)
        return f"{met} of {len(self.verdicts)} criteria met" if self.verdicts else "nothing judged"

    @property
    def figure(self) -> str:
        """Its picture as SVG; "" if there is none."""
        try:
            return (self.folder / FIGURE).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            return ""


def read_outcome(experiment: Experiment, folder: Path, stamp: str) -> Outcome | None:
    """Return the outcome stored in a folder, if its stamp is the same; else None."""
    try:
        content = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        is_whole = all((folder / name).is_file() for name in (REPORT, FIGURE))
        if content["stamp"] != stamp or not is_whole:
            return None
        verdicts = tuple(map(verdict_from_json, content["criteria"]))
        sentence, ended = content["sentence"], content["diverged"]
        return Outcome(experiment, folder, verdicts, sentence, ended, seconds=content["seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


_OF_LIBRARY = re.compile(r"\{library\.(\w+)\}")


def chart_svg(chart: Chart) -> str:
    """Return a chart as SVG without a background."""
    return _svg(chart_figure(chart))


def _svg(figure: Figure) -> str:
    """Return a figure without a background, from its element ``svg`` on, for a page."""
    figure.patch.set_visible(False)
    for axes in figure.axes:
        axes.patch.set_visible(False)
    return svg(figure)


@dataclass(frozen=True)
class Seen:
    """The runs of an experiment as they are evaluated.

    Attributes:
        experiment: which.
        recordings: by variant, those that ran.
        digests: of them.
        result: of its library experiment.
    """

    experiment: Experiment
    recordings: Mapping[str, Recording]
    digests: Mapping[str, Digest]
    result: Result

    def measured(self, metric: str, variant: str) -> float | None:
        """Return a metric with the options of the criterion on it; None if it did not run."""
        if variant not in self.recordings:
            return None
        options = self.experiment.options(metric, variant)
        return measure(metric, self.recordings[variant], **options)


def look(
    experiment: Experiment, folder: Path, runs: Mapping[str, Run], cells: Executor | None = None
) -> Outcome:
    """Return the outcome of an experiment; write it unless it was written before.

    Args:
        experiment: the experiment.
        folder: for the summary, the page and the figure.
        runs: by variant, those that ran.
        cells: where the cells of a map are simulated.
    """
    stamp = _stamp(experiment, runs)
    known = read_outcome(experiment, folder, stamp)
    if known is not None:
        return known
    started = time.monotonic()
    seen = _see(experiment, runs, cells)
    verdicts = judge(experiment, seen.recordings, seen.result.numbers)
    sentence = _sentence(seen)
    folder.mkdir(parents=True, exist_ok=True)
    figure = _figure(seen)
    (folder / FIGURE).write_text(figure, encoding="utf-8")
    if isinstance(seen.result.picture, Figure):  # of a map: for documents, too
        write(folder / "figure.png", image(seen.result.picture, "png"))
    if runs:
        digests, predictions = list(seen.digests.values()), experiment.predicted(list(runs))
        claim, first = experiment.claim, experiment.picture
        write_page(folder / REPORT, digests, claim, sentence, verdicts, first, predictions)
    else:
        write_html(
            folder / REPORT,
            "experiment.html",
            experiment=experiment,
            equations=[equation(number) for number in experiment.equations],
            numbers=seen.result.numbers.values(),
            verdicts=verdicts,
            sentence=sentence,
            figure=figure,
            is_map=is_map(experiment.library),
        )
    seconds = sum(run.seconds for run in runs.values()) + time.monotonic() - started
    more = {"sentence": sentence, "seconds": round(seconds, 1), "stamp": stamp}
    numbers = {name: number.value for name, number in seen.result.numbers.items()}
    write_summary(folder / SUMMARY, experiment, seen.recordings, verdicts, numbers=numbers, **more)
    ended = dict(diverged(seen.recordings))
    return Outcome(experiment, folder, tuple(verdicts), sentence, ended, seconds=seconds)


def _stamp(experiment: Experiment, runs: Mapping[str, Run]) -> str:
    """Return the version of what an outcome is made of."""
    bags = {name: (run.bag / "metadata.yaml").stat().st_mtime_ns for name, run in runs.items()}
    return digest([repr(experiment), list(map(equation, experiment.equations)), bags, code()])


def _see(experiment: Experiment, runs: Mapping[str, Run], cells: Executor | None) -> Seen:
    recordings = {name: replace(load(run.bag), diverged=run.diverged) for name, run in runs.items()}
    digests = {name: Digest.of(recording) for name, recording in recordings.items()}
    result = run_library(experiment.library, cells) if experiment.library else Result()
    return Seen(experiment, recordings, digests, result)


def _sentence(seen: Seen) -> str:
    """Return the summary of the experiment with its numbers; if only some variants ran, theirs."""
    experiment, recordings = seen.experiment, seen.recordings
    if experiment.summary and recordings.keys() == experiment.variants.keys():
        text = _OF_LIBRARY.sub(partial(_number, seen.result.numbers), experiment.summary)
        return fill(text, recordings, experiment.options)
    return describe(list(seen.digests.values())) if recordings else ""


def _number(numbers: Mapping[str, Number], match: re.Match[str]) -> str:
    name = match.group(1)
    if name not in numbers:
        raise UnknownNameError("number of the library", name, numbers)
    return quantity(numbers[name].value, numbers[name].unit)


def _figure(seen: Seen) -> str:
    """Return the picture of the experiment as SVG; "" if it has none."""
    experiment = seen.experiment
    if experiment.chart is not None:
        return chart_svg(experiment.chart.filled(seen.measured))
    if isinstance(seen.result.picture, Chart):
        return chart_svg(seen.result.picture)
    if seen.result.picture is not None:
        return svg(seen.result.picture)
    digests, drawn = list(seen.digests.values()), picture(experiment.picture)
    predictions = experiment.predicted(list(seen.digests))
    try:
        return _svg(quantity_figure(digests, drawn, predictions, _bounds(experiment)))
    except ConfigurationError:
        return ""  # no run has recorded the quantity


def _bounds(experiment: Experiment) -> list[float]:
    """Return the bounds of the peak of the quantity that is drawn."""
    metric = f"peak_{experiment.picture}"
    criteria = [c for c in experiment.criteria if c.metric == metric and not c.together]
    return [c.below for c in criteria if c.below is not None]
