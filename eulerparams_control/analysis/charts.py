"""Charts: lines, limits, shades and axes, of runs over time or over a parameter.

    drawn = panel(picture("orientation_error"), digests)
    drawn.charts          # one, or one a component, or one a joint

``interactive`` draws a chart with plotly, ``static`` with matplotlib.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, zip_longest
from typing import Literal, NamedTuple

import numpy as np

from eulerparams_control.analysis.digest import NEAR, Approach, Digest, Interval, merged
from eulerparams_control.analysis.labels import labels, sequences
from eulerparams_control.analysis.quantities import BY_NAME, EVERYTHING
from eulerparams_control.analysis.quantities.base import Prediction, Quantity
from eulerparams_control.errors import UnknownNameError
from eulerparams_control.laws.rotations import Array

_SPAN = 50.0  # peak of the largest run over what is usual in the smallest, for a log axis
_HIGHEST = 1e12  # largest value, in whatever unit, of a run that did not diverge
_MARGIN = 1.1
_OFFSET = 3.0  # largest ratio of value to change of a component whose axis shows 0
_NEAR_LIMIT = 4.0  # limit over largest value, up to which the axis shows the limit


class Scale(NamedTuple):
    """The axis of values of a chart.

    Attributes:
        logarithmic: whether it is.
        low, high: its ends.
        step: decades a label, if logarithmic.
    """

    logarithmic: bool
    low: float
    high: float
    step: int = 1


type Column = dict[int, Array]
"""The values of a component, or joint, of each run that has it, by the index of the run."""


def scales(
    quantity: Quantity,
    columns: Sequence[Column],
    theory: Sequence[Array] = (),
    limits: Sequence[Array] = (),
) -> list[Scale]:
    """Return the axis of each component, or joint, of a quantity.

    Args:
        quantity: which.
        columns: what was recorded.
        theory: what is predicted.
        limits: (n,) of the URDFs; those that are near belong to the axis.
    """
    values = [*(y for column in columns for y in column.values()), *theory]
    floor = quantity.floor
    if quantity.is_vector:
        centred = spans([[*column.values()] for column in columns], floor)
        return centred or [symmetric_axis(values, floor)] * len(columns)
    if any((y[np.isfinite(y)] < -floor).any() for y in values):
        return [signed_axis(values, floor)] * len(columns)
    if quantity.is_of_joints:
        own = ([limit[joint : joint + 1] for limit in limits] for joint in range(len(columns)))
        return [_joint_axis(columns, [*theory, *_reached(near, values)], floor) for near in own]
    return [axis(values + _reached(limits, values), floor, logarithmic=quantity.logarithmic)]


def axis(runs: Sequence[Array], floor: float, labels: int = 8, logarithmic: bool = False) -> Scale:
    """Return an axis from 0, or logarithmic, that shows all runs.

    A run that diverges to 1e30, say, leaves the plot: else nothing but its end could be read.

    Args:
        runs: the values of each run, >= 0; those that are not finite do not count.
        floor: what is smaller is rounding: it is not enlarged; 0 is never logarithmic.
        labels: most labels that a logarithmic axis has room for.
        logarithmic: whether it is logarithmic in any case.
    """
    values = [run[np.isfinite(run) & (run > 0)] for run in runs]
    values = [run for run in values if len(run)]
    top = max((float(run.max()) for run in values), default=0.0)
    if top <= floor or not values:
        return Scale(False, 0.0, floor or 1.0)
    usual = min(float(np.median(run)) for run in values)
    if not floor or (top < _SPAN * usual and not logarithmic):
        return Scale(False, 0.0, _MARGIN * min(top, _HIGHEST))
    top = min(top, _HIGHEST)
    bottom = min(float(np.quantile(run, 0.02)) for run in values)
    return _logarithmic(min(max(bottom, floor), top / _SPAN), top, labels)


def symmetric_axis(runs: Sequence[Array], floor: float) -> Scale:
    """Return a linear axis about 0 that shows all runs; those that are not finite do not count.

    Args:
        runs: the values of each run, of any shape and sign.
        floor: what is smaller is rounding: it is not enlarged.
    """
    largest = [float(np.abs(run[np.isfinite(run)]).max(initial=0.0)) for run in runs]
    top = _MARGIN * min(max(*largest, floor), _HIGHEST)
    return Scale(False, -top, top)


def signed_axis(runs: Sequence[Array], floor: float) -> Scale:
    """Return a linear axis that shows all runs, whatever their sign, and 0."""
    values = _finite(runs)
    low, high = min(values.min(initial=0.0), 0.0), max(values.max(initial=0.0), 0.0)
    low, high = max(float(low), -_HIGHEST), min(float(high), _HIGHEST)
    margin = max((_MARGIN - 1) * (high - low), floor)
    return Scale(False, low - margin, high + margin)


def spans(components: Sequence[Sequence[Array]], floor: float) -> list[Scale]:
    """Return an axis for each component, of equal length but each about its own middle.

    Empty where an axis about 0 shows as much: where the components are not far from 0 for their
    change.

    Args:
        components: the values of each run, for each component.
        floor: what is smaller is rounding: it is not enlarged.
    """
    found = [_finite(runs) for runs in components]
    found = [np.clip(values, -_HIGHEST, _HIGHEST) for values in found if len(values)]
    if len(found) < len(components) or not found:
        return []
    length = max(float(np.ptp(values)) for values in found)
    if max(float(np.abs(values).max()) for values in found) < _OFFSET * max(length, floor):
        return []
    half = _MARGIN * max(length, floor) / 2
    middles = [float(values.min() + values.max()) / 2 for values in found]
    return [Scale(False, middle - half, middle + half) for middle in middles]


def _joint_axis(columns: Sequence[Column], besides: Sequence[Array], floor: float) -> Scale:
    """Return the axis of a joint: like that of the largest, down to the smallest if log."""
    runs = sorted({run for column in columns for run in column})
    joints = [[column[run] for column in columns if run in column] for run in runs]
    shown = axis([*(max(some, key=_peak) for some in joints), *besides], floor, labels=4)
    if not shown.logarithmic:
        return shown
    return axis([*map(np.concatenate, joints), *besides], floor, labels=4, logarithmic=True)


def _reached(limits: Sequence[Array], values: Sequence[Array]) -> list[Array]:
    """Return the limits that are so near to the values that an axis has to show them."""
    known = _finite(limits)
    top = max(map(_peak, values), default=0.0)
    near = known[known < _NEAR_LIMIT * top]
    return [near] if len(near) else []


def _peak(y: Array) -> float:
    """Return the largest finite value, 0 if none is above it."""
    return float(y[np.isfinite(y)].max(initial=0.0))


def _finite(runs: Sequence[Array]) -> Array:
    values: Array = np.concatenate([np.zeros(0), *runs])
    return values[np.isfinite(values)]


def _logarithmic(bottom: float, top: float, labels: int) -> Scale:
    """Return an axis with one label a decade, or fewer if there are many."""
    low, high = math.log10(bottom) - 0.1, math.log10(top) + 0.2
    return Scale(True, 10.0**low, 10.0**high, max(1, math.ceil((high - low) / labels)))


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
    names = {q.name: q for q in EVERYTHING if not q.components and not q.beside}
    if name not in names:
        raise UnknownNameError("picture", name, names)
    return names[name]


def panels(
    digests: Sequence[Digest],
    first: Quantity = BY_NAME["orientation_error"],
    predictions: Sequence[Prediction] = (),
) -> Panels:
    """Return all quantities, ``first`` first; those without data, and zero vectors, left out.

    Raises:
        UnknownNameError: if a prediction is of no quantity.
    """
    quantities = dict.fromkeys((first, *(each for each in EVERYTHING if not each.beside)))
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
    for quantity in filter(lambda each: each.beside, EVERYTHING):
        for label, digest in zip(labels(digests), digests, strict=True):
            for curve in digest.curves.get(quantity.name, ()):
                yield Prediction(quantity.beside, label, curve.t, curve.y, quantity.title)


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
    if not any(digest.curves.get(name) for digest in digests):
        return None
    curves = {
        i: found
        for i, digest in enumerate(digests)
        if (found := digest.curves.get(name) or digest.curves.get(quantity.otherwise))
    }
    count = max(map(len, curves.values()))
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
        lines += _closest(digests) if name == "pole_distance" else []
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
