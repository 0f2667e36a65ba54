"""Shared by all plots: the line of a run, limits, predictions, the time axis and the look."""

from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.analysis.decimation import decimate, packed_reals
from eulerparams_control.analysis.digest import Curve, Digest
from eulerparams_control.analysis.labels import line
from eulerparams_control.analysis.quantity import Prediction
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import Robot

GREY = "rgba(128, 128, 128, 0.9)"
PREDICTION_DASHES = ("dash", "dashdot", "dot")

_NEAR_LIMIT = 4.0  # limit over largest value, up to which the axis shows the limit

type Lines = Mapping[int, Curve]
"""The line of each run that has one, by the index of the run."""


class Figure(NamedTuple):
    """A plot as plotly.js takes it.

    Attributes:
        title: above it, "" if there is none: text that is not escaped yet.
        data: its lines.
        layout: its axes, and what is marked.
        height: [px].
    """

    title: str
    data: list[dict[str, Any]]
    layout: dict[str, Any]
    height: int


class Panel(NamedTuple):
    """Plots of a quantity with its words.

    Attributes:
        name: of the quantity.
        group: of quantities it belongs to.
        title: above.
        caption: below.
        figures: one, or one a component, or one a joint.
        predictions: what is drawn dashed: the texts.
    """

    name: str
    group: str
    title: str
    caption: str
    figures: list[Figure]
    predictions: list[str]


class Drawing(NamedTuple):
    """Data of the plots of a page.

    Attributes:
        digests: the runs.
        names: of the runs.
        predictions: of theory.
        bins: of a line.
    """

    digests: Sequence[Digest]
    names: Sequence[str]
    predictions: Sequence[Prediction]
    bins: int

    def of(self, name: str) -> list[Prediction]:
        """Return the predictions of a quantity."""
        return [p for p in self.predictions if p.quantity == name]


def traces(drawing: Drawing, lines: Lines, unit: str) -> list[dict[str, Any]]:
    """Return the lines of the runs; their names come from outside, so they are escaped."""
    names = drawing.names
    return [
        {
            "type": "scatter",
            "name": escape(names[index]),
            "legendgroup": str(index),
            "mode": "lines",
            "line": {**line(index, len(names)), "simplify": False},  # it has few points as it is
            "hovertemplate": f"%{{y:.6~g}} {unit}",
            **_points(*curve, drawing.bins),
        }
        for index, curve in lines.items()
    ]


def predicted(drawing: Drawing, name: str, unit: str, column: int = 0) -> list[dict[str, Any]]:
    """Return what theory says of a column of a quantity, dashed."""
    return [
        {
            "type": "scatter",
            "name": escape(prediction.name) + (f" ({index + 1})" if index else ""),
            "meta": "prediction",
            "mode": "lines",
            "line": {"color": GREY, "width": 2, "dash": prediction_dash(index)},
            "hovertemplate": f"%{{y:.6~g}} {unit}",
            **_points(prediction.t, y[:, column], drawing.bins),
        }
        for index, prediction in enumerate(drawing.of(name))
        if column < (y := prediction.y.reshape(len(prediction.t), -1)).shape[1]
    ]


def prediction_dash(index: int) -> str:
    """Return the dash of a prediction among those of a quantity."""
    return PREDICTION_DASHES[index % len(PREDICTION_DASHES)]


def _points(t: Array, y: Array, bins: int) -> dict[str, Any]:
    x, y = decimate(t, y, bins)
    return {"x": packed_reals(x), "y": packed_reals(y)}


def limits_of(
    limits: Callable[[Robot], Array], digests: Sequence[Digest], runs: Sequence[int]
) -> list[Array]:
    """Return the limits of the robots of some runs: those of their URDFs."""
    return [limits(digests[index].robot) for index in runs]


def limit_lines(limits: Sequence[Array]) -> list[dict[str, Any]]:
    """Return a dashed line for each limit."""
    look = {"line": {"color": GREY, "width": 1, "dash": "dash"}}
    return [
        {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": y, "y1": y, **look}
        for y in _known(limits).tolist()
    ]


def reached(limits: Sequence[Array], values: Sequence[Array]) -> list[Array]:
    """Return the limits that are so near to the values that an axis has to show them."""
    known = _known(limits)
    finite = [run[np.isfinite(run)] for run in values]
    top = max((float(run.max(initial=0.0)) for run in finite), default=0.0)
    near = known[known < _NEAR_LIMIT * top]
    return [near] if len(near) else []


def _known(limits: Sequence[Array]) -> Array:
    known: Array = np.unique(np.concatenate([np.zeros(0), *limits]))
    return known[np.isfinite(known)]


def layout(
    digests: Sequence[Digest],
    y_axis: Mapping[str, Any],
    label: str,
    shapes: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """Return what all plots have in common: the time axis and the look."""
    start, end = time_range(digests)
    x_axis = {"title": {"text": "time [s]", "standoff": 8}, "range": [start, end]}
    title = {"title": {"text": label, "standoff": 14}}
    look = {"showline": True, "zeroline": False}
    power = {"showexponent": "last"} if y_axis.get("type") == "linear" else {}
    return {
        "xaxis": {**look, **x_axis},
        "yaxis": {
            **look,
            **title,
            "automargin": False,
            "exponentformat": "power",
            **power,
            **y_axis,
        },
        "shapes": list(shapes),
        "margin": {"l": 80, "r": 16, "t": 12, "b": 44},
        "hovermode": "x unified",
        "showlegend": False,
    }


def time_range(digests: Sequence[Digest]) -> tuple[float, float]:
    """Return the time [s] that all plots show at first."""
    return min(d.start for d in digests), max(d.end for d in digests)
