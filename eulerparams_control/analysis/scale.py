"""The axis of a quantity: linear, or logarithmic where runs differ by powers of ten."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from eulerparams_control.laws.rotations import Array

_SPAN = 50.0  # peak of the largest run over what is usual in the smallest, for a log axis
_HIGHEST = 1e12  # largest value, in whatever unit, of a run that did not diverge
_MARGIN = 1.1
_OFFSET = 3.0  # largest ratio of value to change of a component whose axis shows 0


def axis(
    runs: Sequence[Array], floor: float, labels: int = 8, logarithmic: bool = False
) -> dict[str, Any]:
    """Return type, range and ticks of a plotly axis that shows all runs.

    A run that diverges to 1e30, say, leaves the plot: else nothing but its end could be read.

    Args:
        runs: the values of each run, >= 0; those that are not finite do not count.
        floor: what is smaller is rounding: it is not enlarged.
        labels: most labels that a logarithmic axis has room for.
        logarithmic: whether it is logarithmic in any case.
    """
    values = [run[np.isfinite(run) & (run > 0)] for run in runs]
    values = [run for run in values if len(run)]
    if not values:
        return {"type": "linear", "rangemode": "tozero"}
    top = max(float(run.max()) for run in values)
    if top <= floor:
        return {"type": "linear", "range": [0.0, floor]}
    usual = min(float(np.median(run)) for run in values)
    if top < _SPAN * usual and not logarithmic:
        return {"type": "linear", "range": [0.0, _MARGIN * top]}
    top = min(top, _HIGHEST)
    bottom = min(float(np.quantile(run, 0.02)) for run in values)
    return _logarithmic(min(max(bottom, floor), top / _SPAN), top, labels)


def symmetric_axis(runs: Sequence[Array], floor: float) -> dict[str, Any]:
    """Return a linear axis about 0 that shows all runs; those that are not finite do not count.

    Args:
        runs: the values of each run, of any shape and sign.
        floor: what is smaller is rounding: it is not enlarged.
    """
    largest = [float(np.abs(run[np.isfinite(run)]).max(initial=0.0)) for run in runs]
    top = _MARGIN * min(max(*largest, floor), _HIGHEST)
    return {"type": "linear", "range": [-top, top]}


def signed_axis(runs: Sequence[Array], floor: float) -> dict[str, Any]:
    """Return a linear axis that shows all runs, whatever their sign, and 0."""
    values = _finite(runs)
    low, high = min(values.min(initial=0.0), 0.0), max(values.max(initial=0.0), 0.0)
    low, high = max(float(low), -_HIGHEST), min(float(high), _HIGHEST)
    margin = max((_MARGIN - 1) * (high - low), floor)
    return {"type": "linear", "range": [low - margin, high + margin]}


def spans(components: Sequence[Sequence[Array]], floor: float) -> list[dict[str, Any]]:
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
    return [{"type": "linear", "range": [middle - half, middle + half]} for middle in middles]


def _finite(runs: Sequence[Array]) -> Array:
    values: Array = np.concatenate([np.zeros(0), *runs])
    return values[np.isfinite(values)]


def _logarithmic(bottom: float, top: float, labels: int) -> dict[str, Any]:
    """Return an axis with one label a decade, or fewer if there are many."""
    low, high = np.log10(bottom) - 0.1, np.log10(top) + 0.2
    step = max(1, math.ceil((high - low) / labels))
    return {"type": "log", "range": [float(low), float(high)], "dtick": step}
