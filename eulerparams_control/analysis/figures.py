"""The plots of runs over time, laid over each other."""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.analysis.digest import Curve, Digest
from eulerparams_control.analysis.grids import (
    approach_lines,
    approach_notes,
    bands,
    closest,
    joint_panel,
    top_margin,
    vector_panel,
)
from eulerparams_control.analysis.labels import colour, labels, sequences
from eulerparams_control.analysis.plots import (
    Drawing,
    Figure,
    Panel,
    layout,
    limit_lines,
    limits_of,
    predicted,
    reached,
    time_range,
    traces,
)
from eulerparams_control.analysis.quantities import (
    JOINT_QUANTITIES,
    ORIENTATION_ERROR,
    POLE_DISTANCE,
    QUANTITIES,
    VECTOR_QUANTITIES,
)
from eulerparams_control.analysis.quantity import AnyQuantity, JointQuantity, Prediction, Quantity
from eulerparams_control.analysis.scale import axis, signed_axis
from eulerparams_control.analysis.shaping_quantities import DASHED
from eulerparams_control.errors import UnknownNameError
from eulerparams_control.laws.rotations import Array

_POINTS = 600_000  # of the whole page, which keeps them below 7 MB
_MOST_BINS = 700  # of a line: more than a screen has pixels for


class Panels(NamedTuple):
    """The plots of the page.

    Attributes:
        first: the picture that matters.
        groups: the others by the heading they are under, in order.
    """

    first: Panel
    groups: dict[str, list[Panel]]

    @property
    def figures(self) -> list[Figure]:
        """All plots in the order of the page."""
        others = [panel for panels in self.groups.values() for panel in panels]
        return [figure for panel in (self.first, *others) for figure in panel.figures]


def picture(name: str) -> Quantity:
    """Return the quantity of that name; raises UnknownNameError."""
    names = {quantity.name: quantity for quantity in QUANTITIES}
    if name not in names:
        raise UnknownNameError("picture", name, names)
    return names[name]


def panels(
    digests: Sequence[Digest],
    first: Quantity = ORIENTATION_ERROR,
    predictions: Sequence[Prediction] = (),
) -> Panels:
    """Return the plots of the page, ``first`` first; those without data left out.

    Raises:
        UnknownNameError: if a prediction is of no quantity.
    """
    quantities: list[AnyQuantity] = [*dict.fromkeys((first, *QUANTITIES)), *VECTOR_QUANTITIES]
    quantities += JOINT_QUANTITIES
    _check(predictions, quantities)
    dashed = [*predictions, *_dashed(digests)]
    drawing = Drawing(digests, labels(digests), dashed, _bins(digests))
    has_first = any(first.name in digest.curves for digest in digests)
    drawn = list(_drawn(drawing, quantities, first if has_first else None))
    if not has_first:
        drawn[0] = _enlarged(drawn[0])
    return Panels(drawn[0], _by_group(drawn[1:]))


def _dashed(digests: Sequence[Digest]) -> Iterator[Prediction]:
    """Yield what is drawn dashed with another quantity, of each run."""
    for name, quantity in DASHED.items():
        for label, digest in zip(labels(digests), digests, strict=True):
            for curve in digest.curves.get(quantity.name, ()):
                yield Prediction(name, label, curve.t, curve.y, quantity.title)


def _check(predictions: Iterable[Prediction], quantities: Sequence[AnyQuantity]) -> None:
    names = {quantity.name: quantity for quantity in quantities}
    for prediction in predictions:
        if prediction.quantity not in names:
            raise UnknownNameError("quantity", prediction.quantity, names)


def _bins(digests: Sequence[Digest]) -> int:
    """Return the number of bins of a line with which the page does not grow too large."""
    lines = sum(len(curves) for digest in digests for curves in digest.curves.values())
    return max(20, min(_MOST_BINS, _POINTS // (4 * max(1, lines))))


def _drawn(
    drawing: Drawing, quantities: Sequence[AnyQuantity], first: Quantity | None
) -> Iterator[Panel]:
    for quantity in quantities:
        panel: Panel | None
        if isinstance(quantity, Quantity):
            panel = _panel(quantity, drawing, quantity is first)
        elif isinstance(quantity, JointQuantity):
            panel = joint_panel(quantity, drawing)
        else:
            panel = vector_panel(quantity, drawing)
        if panel is not None:
            yield panel


def _by_group(drawn: Sequence[Panel]) -> dict[str, list[Panel]]:
    order = list(dict.fromkeys(panel.group for panel in drawn))
    ordered = sorted(drawn, key=lambda panel: order.index(panel.group))
    return {group: list(some) for group, some in groupby(ordered, key=lambda p: p.group)}


def _panel(quantity: Quantity, drawing: Drawing, is_first: bool) -> Panel | None:
    digests, name = drawing.digests, quantity.name
    lines = {i: d.curves[name][0] for i, d in enumerate(digests) if name in d.curves}
    if not lines:
        return None
    approaches = closest(digests)
    shapes = [*bands(digests), *approach_lines(approaches)]
    values = _values(quantity, drawing, lines)
    if quantity.limits is not None:
        limits = limits_of(quantity.limits, digests, list(lines))
        shapes += limit_lines(limits)
        values += reached(limits, values)
    data = traces(drawing, lines, quantity.unit) + predicted(drawing, name, quantity.unit)
    if quantity is POLE_DISTANCE:
        data += _markers(digests)
    label = quantity.label.format(sequence=sequences(digests))
    look = layout(digests, _y_axis(quantity, values), label, shapes)
    if is_first:
        look["annotations"] = list(approach_notes(approaches, *time_range(digests)))
        look["margin"]["t"] = top_margin(approaches)
    texts = [f"{prediction.name}: {prediction.text}" for prediction in drawing.of(name)]
    figure = Figure("", data, look, 420 if is_first else 300)
    return Panel(name, quantity.group, quantity.title, quantity.caption, [figure], texts)


def _enlarged(panel: Panel) -> Panel:
    """Return a panel in place of the first one."""
    return panel._replace(figures=[figure._replace(height=420) for figure in panel.figures])


def _values(quantity: Quantity, drawing: Drawing, lines: dict[int, Curve]) -> list[Array]:
    """Return what the axis has to show: the lines, and what is predicted."""
    theory = [prediction.y for prediction in drawing.of(quantity.name)]
    return [curve.y for curve in lines.values()] + theory


def _y_axis(quantity: Quantity, runs: Sequence[Array]) -> dict[str, Any]:
    if any((run[np.isfinite(run)] < -quantity.floor).any() for run in runs):
        return signed_axis(runs, quantity.floor)
    if quantity.floor:
        return axis(runs, quantity.floor, logarithmic=quantity.logarithmic)
    return {"type": "linear", "rangemode": "tozero"}


def _markers(digests: Sequence[Digest]) -> list[dict[str, Any]]:
    """Return the closest approach of each run to its pole, as a point on its line."""
    return [
        {
            "type": "scatter",
            "x": [digest.approach.t],
            "y": [math.degrees(digest.approach.distance)],
            "mode": "markers",
            "marker": {"color": colour(index), "size": 8, "symbol": "diamond"},
            "legendgroup": str(index),
            "hoverinfo": "skip",
        }
        for index, digest in enumerate(digests)
        if math.isfinite(digest.approach.distance)
    ]
