"""Look at the runs of an experiment: judge them, write summary, page and figure.

The figure is a chart over a parameter, or its quantity over time, as SVG.
"""

import re
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from itertools import count
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.figures import picture as quantity_of
from eulerparams_control.analysis.headline import describe, fill, placeholders
from eulerparams_control.analysis.labels import COLOURS, quantity
from eulerparams_control.analysis.loading import BLOCK, blocks, load
from eulerparams_control.analysis.metrics import get_metric, measure
from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.quantity import Prediction
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.static import quantity_figure
from eulerparams_control.analysis.static_image import STYLE, svg
from eulerparams_control.analysis.verdict import Verdict
from eulerparams_control.bags.reader import Bag
from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.lab.experiments.charts import Chart, Line
from eulerparams_control.lab.experiments.equations import equation
from eulerparams_control.lab.experiments.fingerprint import code, digest
from eulerparams_control.lab.experiments.html import NOT_JUDGED, criteria, equations, page, picture
from eulerparams_control.lab.experiments.library import Number, Result, run_library
from eulerparams_control.lab.experiments.model import Experiment
from eulerparams_control.lab.experiments.result import (
    FIGURE,
    REPORT,
    SUMMARY,
    Outcome,
    diverged,
    judge,
    read_outcome,
    write_summary,
)
from eulerparams_control.lab.experiments.run_cache import Run

_SIZE = (3.7, 2.5)  # [in]
_MARKERS = "osD^vP"
_DASHES = ((4, 2), (7, 2, 1.5, 2), (2, 1.5), (10, 2))  # of predictions
_PREDICTED: dict[str, Any] = {"color": "black", "linewidth": 0.9, "zorder": 4}
_BOUND: dict[str, Any] = {"color": "0.45", "linestyle": (0, (1, 1.5)), "linewidth": 0.9}

_OF_LIBRARY = re.compile(r"\{library\.(\w+)\}")


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
    experiment: Experiment, result: Result, verdicts: Sequence[Verdict], sentence: str, figure: str
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
        f'<p class="soft">{escape(experiment.claim)} <span class="{kind}">{count}.</span></p>',
        f'<div class="columns"><div>{equations(experiment.equations)}</div>'
        f"{picture(figure, 'this experiment draws none')}</div>",
        "<h2>Criteria</h2>",
        criteria(verdicts),
        f'<h2>Numbers</h2><div class="scroll"><table><tbody>{rows}</tbody></table></div>',
    ]
    return page(sentence or experiment.name, body)


def chart_svg(chart: Chart) -> str:
    """Return a chart as SVG without a ground of its own."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=_SIZE, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        axes.margins(y=0.1)
        counts = {"measured": count(), "predicted": count(), "bound": count()}
        for line in chart.lines:
            x, y = zip(*line.points, strict=True) if line.points else ((), ())
            index = next(counts[line.kind]) if line.label else 0
            axes.plot(x, y, label=line.label or "_", **_look(line, index))
        _scale(axes, chart)
        axes.set_xlabel(chart.xlabel, parse_math=False)
        axes.set_ylabel(chart.ylabel, parse_math=False)
        legend = figure.legend(loc="outside upper center", ncols=2, handlelength=2.4)
        for text in legend.get_texts():
            text.set_parse_math(False)
    return _svg(figure)


def _scale(axes: Axes, chart: Chart) -> None:
    if "x" in chart.log:
        axes.set_xscale("log")
    if "y" in chart.log:
        axes.set_yscale("log")
    elif all(y >= 0 for line in chart.lines for _, y in line.points):
        axes.set_ylim(bottom=0.0)
    if chart.ticks:
        axes.set_xticks(range(len(chart.ticks)), chart.ticks)
        axes.tick_params("x", labelrotation=90 if len(chart.ticks) > 6 else 0)
        axes.set_xlim(-0.5, len(chart.ticks) - 0.5)


def _look(line: Line, index: int) -> dict[str, Any]:
    if line.kind == "bound":
        return _BOUND
    if line.kind == "predicted":
        return _PREDICTED | {"linestyle": (0, _DASHES[index % len(_DASHES)])}
    marker = _MARKERS[index % len(_MARKERS)] if line.markers else ""
    look = {"color": COLOURS[index % len(COLOURS)], "marker": marker, "markersize": 5}
    look |= {"markerfacecolor": "none", "markeredgewidth": 1.2}  # what lies beneath shows
    return look | {"linestyle": "none" if line.markers else "-", "linewidth": 2.2}


def time_svg(
    digests: Sequence[Digest], name: str, predictions: Sequence[Prediction], bounds: Sequence[float]
) -> str:
    """Return a quantity of runs over time as SVG, with predictions and bounds of criteria."""
    figure = quantity_figure(digests, quantity_of(name), predictions)
    axes = figure.axes[0]
    low, high = axes.get_ylim()
    for bound in bounds:
        if low < bound < high:
            axes.axhline(bound, **_BOUND)
    return _svg(figure)


def _svg(figure: Figure) -> str:
    """Return a figure without a ground, from its element ``svg`` on: to be put in a page."""
    figure.patch.set_visible(False)
    for axes in figure.axes:
        axes.patch.set_visible(False)
    text = svg(figure)
    return text[text.index("<svg") :]


@dataclass(frozen=True)
class Seen:
    """The runs of an experiment as they are looked at.

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


def look(experiment: Experiment, folder: Path, runs: Mapping[str, Run]) -> Outcome:
    """Return what came of an experiment; write it unless that was done before.

    Args:
        experiment: the experiment.
        folder: for the summary, the page and the figure.
        runs: by variant, those that ran.
    """
    stamp = _stamp(experiment, runs)
    known = read_outcome(experiment, folder, stamp)
    if known is not None:
        return known
    started = time.monotonic()
    seen = _see(experiment, runs)
    verdicts = judge(experiment, seen.recordings, seen.result.numbers)
    sentence = _sentence(seen)
    folder.mkdir(parents=True, exist_ok=True)
    figure = _figure(seen)
    (folder / FIGURE).write_text(figure, encoding="utf-8")
    digests = list(seen.digests.values())
    predictions = experiment.predicted(list(runs))
    write_report(
        folder / REPORT, experiment, digests, predictions, seen.result, verdicts, sentence, figure
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


def _see(experiment: Experiment, runs: Mapping[str, Run]) -> Seen:
    seen = _part_by_part if _is_of_bags(experiment) else _whole
    both = {name: seen(run) for name, run in runs.items()}
    recordings = {name: recording for name, (recording, _) in both.items()}
    digests = {name: digest for name, (_, digest) in both.items()}
    result = run_library(experiment.library) if experiment.library else Result()
    return Seen(experiment, recordings, digests, result)


def _is_of_bags(experiment: Experiment) -> bool:
    """Return whether all that is measured is of bags as they are: then a run may be of hours."""
    names = [criterion.metric for criterion in experiment.criteria if criterion.metric]
    names += [name for name, _, _ in placeholders(experiment.summary) if name != "library"]
    return not experiment.chart and all(get_metric(name).raw for name in names)


def _whole(run: Run) -> tuple[Recording, Digest]:
    recording = replace(load(run.bag), diverged=run.diverged)
    return recording, Digest.of(recording)


def _part_by_part(run: Run) -> tuple[Recording, Digest]:
    """Return the digest of a run, and of its recording the last part."""
    bag, last = Bag(run.bag), deque[Recording](maxlen=1)

    def parts() -> Iterator[Recording]:
        for part in blocks(bag, size=BLOCK):
            last.append(replace(part, diverged=run.diverged))
            yield last[0]

    count = bag.topics["/joint_states"].count
    digest = Digest.of_parts(parts(), count if count > BLOCK else 0)
    return last[0], digest


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
    if seen.result.chart is not None:
        return chart_svg(seen.result.chart)
    predictions = experiment.predicted(list(seen.digests))
    try:
        digests = list(seen.digests.values())
        return time_svg(digests, experiment.picture, predictions, _bounds(experiment))
    except ConfigurationError:
        return ""  # no run has recorded the quantity


def _bounds(experiment: Experiment) -> list[float]:
    """Return the bounds of the peak of the quantity that is drawn."""
    metric = f"peak_{experiment.picture}"
    criteria = [c for c in experiment.criteria if c.metric == metric and not c.together]
    return [c.below for c in criteria if c.below is not None]
