"""The axis of values: linear, or logarithmic where runs differ by powers of ten."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eulerparams_control.analysis.quantity import Quantity
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
