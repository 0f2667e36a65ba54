"""The picture of an experiment: a chart over a parameter, or its quantity over time, as SVG."""

from collections.abc import Sequence
from itertools import count
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.figures import picture
from eulerparams_control.analysis.labels import COLOURS
from eulerparams_control.analysis.quantity import Prediction
from eulerparams_control.analysis.static import quantity_figure
from eulerparams_control.analysis.static_image import STYLE, svg
from eulerparams_control.lab.experiments.charts import Chart, Line

_SIZE = (3.7, 2.5)  # [in]
_MARKERS = "osD^vP"
_DASHES = ((4, 2), (7, 2, 1.5, 2), (2, 1.5), (10, 2))  # of predictions
_PREDICTED: dict[str, Any] = {"color": "black", "linewidth": 0.9, "zorder": 4}
_BOUND: dict[str, Any] = {"color": "0.45", "linestyle": (0, (1, 1.5)), "linewidth": 0.9}


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
    figure = quantity_figure(digests, picture(name), predictions)
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
