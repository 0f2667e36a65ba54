"""Charts: lines, limits, shades and axes, of runs over time or over a parameter.

    drawn = panel(ORIENTATION_ERROR, digests)
    drawn.charts          # one, or one a component, or one a joint

``interactive`` draws a chart with plotly, ``static`` with matplotlib.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, zip_longest
from typing import Literal, NamedTuple

import numpy as np

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.labels import labels, sequences
from eulerparams_control.analysis.poles import NEAR, Approach, Interval, merged
from eulerparams_control.analysis.quantities import (
    JOINT_QUANTITIES,
    ORIENTATION_ERROR,
    POLE_DISTANCE,
    QUANTITIES,
    VECTOR_QUANTITIES,
)
from eulerparams_control.analysis.quantities.shaping import DASHED
from eulerparams_control.analysis.quantity import Prediction, Quantity
from eulerparams_control.analysis.scale import Column, Scale, scales
from eulerparams_control.errors import UnknownNameError
from eulerparams_control.laws.rotations import Array

type Kind = Literal["measured", "predicted", "bound", "point"]
type Points = tuple[tuple[float, float], ...] | Array


@dataclass(frozen=True)
class Line:
    """One line of a chart.

    Attributes:
        label: its name.
        points: (N, 2) x and y of its points; NaN in y is a gap.
        kind: ``measured``, ``predicted`` (dashed), ``bound`` of a criterion (dotted), or a
            ``point`` on a measured line.
        markers: whether its points are marked.
        index: of its colour, or dash; None: its place among the lines of its kind.
    """

    label: str
    points: Points
    kind: Kind = "measured"
    markers: bool = True
    index: int | None = None

    @property
    def xy(self) -> tuple[Array, Array]:
        """(N,) x and (N,) y."""
        x, y = np.asarray(self.points, float).reshape(-1, 2).T
        return x, y


@dataclass(frozen=True)
class Chart:
    """Lines and what is marked beside them, over a common axis.

    Attributes:
        xlabel, ylabel: of the axes, with units.
        lines: in the order in which they are drawn.
        log: the axes that are logarithmic if there is no scale: "", "x", "y" or "xy".
        ticks: names of x = 0, 1, ...; () if x is a number.
        title: of the component, or joint; "" if there is one chart.
        unit: of single values.
        runs: how many there are, with or without a line.
        span: ends of the axis of x; None as the lines have it.
        scale: the axis of y; None as the lines have it.
        limits: of the URDFs, horizontal.
        near_pole, near_singular: where x is shaded.
        approaches: the closest to the poles, marked.
    """

    xlabel: str
    ylabel: str
    lines: tuple[Line, ...]
    log: str = ""
    ticks: tuple[str, ...] = ()
    title: str = ""
    unit: str = ""
    runs: int = 0
    span: Interval | None = None
    scale: Scale | None = None
    limits: tuple[float, ...] = ()
    near_pole: Sequence[Interval] = ()
    near_singular: Sequence[Interval] = ()
    approaches: Sequence[Approach] = ()

    def indexed(self) -> Iterator[tuple[int, Line]]:
        """Yield the lines with the indices of their looks."""
        counts: dict[str, int] = {}
        for line in self.lines:
            index = counts.get(line.kind, 0) if line.index is None else line.index
            counts[line.kind] = index + 1
            yield index, line


class Panel(NamedTuple):
    """A quantity of some runs over time.

    Attributes:
        quantity: which.
        charts: one, or one a component, or one a joint.
        predictions: those that are drawn.
    """

    quantity: Quantity
    charts: list[Chart]
    predictions: Sequence[Prediction]


class Panels(NamedTuple):
    """All quantities of some runs.

    Attributes:
        first: the one that matters.
        groups: the others by the heading they are under, in order.
    """

    first: Panel
    groups: dict[str, list[Panel]]

    @property
    def charts(self) -> list[Chart]:
        """All charts in the order of the page."""
        others = [panel for panels in self.groups.values() for panel in panels]
        return [chart for panel in (self.first, *others) for chart in panel.charts]


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
    """Return all quantities, ``first`` first; those without data, and zero vectors, left out.

    Raises:
        UnknownNameError: if a prediction is of no quantity.
    """
    quantities: list[Quantity] = [*dict.fromkeys((first, *QUANTITIES)), *VECTOR_QUANTITIES]
    quantities += JOINT_QUANTITIES
    names = {quantity.name: quantity for quantity in quantities}
    for prediction in predictions:
        if prediction.quantity not in names:
            raise UnknownNameError("quantity", prediction.quantity, names)
    dashed = [*predictions, *_dashed(digests)]
    found = (panel(each, digests, dashed) for each in quantities if _is_drawn(each, digests))
    leading, *others = (each for each in found if each is not None)
    order = list(dict.fromkeys(each.quantity.group for each in others))
    others.sort(key=lambda each: order.index(each.quantity.group))
    groups = groupby(others, key=lambda each: each.quantity.group)
    return Panels(leading, {group: list(some) for group, some in groups})


def _dashed(digests: Sequence[Digest]) -> Iterator[Prediction]:
    """Yield what is drawn dashed with another quantity, of each run."""
    for name, quantity in DASHED.items():
        for label, digest in zip(labels(digests), digests, strict=True):
            for curve in digest.curves.get(quantity.name, ()):
                yield Prediction(name, label, curve.t, curve.y, quantity.title)


def _is_drawn(quantity: Quantity, digests: Sequence[Digest]) -> bool:
    """Return whether there is more of a vector than rounding."""
    values = [curve.y for digest in digests for curve in digest.curves.get(quantity.name, ())]
    above = ((np.abs(y[np.isfinite(y)]) > quantity.floor).any() for y in values)
    return not quantity.is_vector or any(above)


def panel(
    quantity: Quantity, digests: Sequence[Digest], predictions: Sequence[Prediction] = ()
) -> Panel | None:
    """Return a quantity of the runs that have it; None if none has.

    Args:
        quantity: which.
        digests: the runs.
        predictions: those of other quantities are left out.
    """
    name, names = quantity.name, labels(digests)
    curves = {i: digest.curves[name] for i, digest in enumerate(digests) if name in digest.curves}
    count = max(map(len, curves.values()), default=0)
    if not count:
        return None
    theory = [prediction for prediction in predictions if prediction.quantity == name]
    robots = [digests[run].robot for run in curves]
    limits = []
    if quantity.limits is not None:
        limits = [quantity.limits(robot) for robot in robots]
    columns: list[Column] = [
        {run: found[k].y for run, found in curves.items() if k < len(found)} for k in range(count)
    ]
    predicted = [[(i, p, y) for i, p in enumerate(theory) if (y := _column(p, k)) is not None]
                 for k in range(count)]  # fmt: skip
    axes = scales(quantity, columns, [y for some in predicted for _, _, y in some], limits)
    titles: Sequence[str] = quantity.components or [""]
    if quantity.is_of_joints:
        joints = zip_longest(*(robot.joints for robot in robots), fillvalue="")
        titles = [" / ".join(filter(None, dict.fromkeys(joint))) for joint in joints]
    shared = Chart(
        "time [s]",
        quantity.label.format(sequence=sequences(digests)),
        (),
        unit=quantity.unit,
        runs=len(digests),
        span=time_range(digests),
        near_pole=merged(span for digest in digests for span in digest.near_pole),
        near_singular=merged(span for digest in digests for span in digest.near_singular),
        approaches=() if quantity.components else _approaches(digests),
    )
    charts = []
    for k, (column, title, scale) in enumerate(zip(columns, titles, axes, strict=False)):
        lines = [Line(names[i], np.transpose(curves[i][k]), "measured", False, i) for i in column]
        for i, p, y in predicted[k]:
            label = p.name + (f" ({i + 1})" if i else "")
            lines.append(Line(label, np.transpose([p.t, y]), "predicted", False, i))
        own = [x[k : k + 1] for x in limits] if quantity.is_of_joints else limits
        known = np.unique(np.concatenate([np.zeros(0), *own]))
        lines += _closest(digests) if quantity is POLE_DISTANCE else []
        at = tuple(known[np.isfinite(known)].tolist())
        charts.append(replace(shared, lines=tuple(lines), title=title, scale=scale, limits=at))
    return Panel(quantity, charts, theory)


def _column(prediction: Prediction, k: int) -> Array | None:
    """Return what a prediction says of a component; None if it says nothing."""
    y = prediction.y.reshape(len(prediction.t), -1)
    return y[:, k] if k < y.shape[1] else None


def _closest(digests: Sequence[Digest]) -> Iterator[Line]:
    """Yield the closest approach of each run to its pole, as a point on its line."""
    for index, digest in enumerate(digests):
        t, distance, _ = digest.approach
        if math.isfinite(distance):
            yield Line("", ((t, math.degrees(distance)),), "point", True, index)


def _approaches(digests: Sequence[Digest]) -> list[Approach]:
    """Return the closest approach to the pole of each sequence of Euler angles, if near."""
    found: dict[str, Approach] = {}
    for approach in sorted((digest.approach for digest in digests), key=lambda a: a.distance):
        if approach.distance < NEAR:
            found.setdefault(approach.sequence, approach)
    return list(found.values())


def time_range(digests: Sequence[Digest]) -> Interval:
    """Return the time [s] that all charts show at first."""
    return min(d.start for d in digests), max(d.end for d in digests)
