"""The axis of a quantity: linear, or logarithmic where runs differ by powers of ten."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from eulerparams_control.rotations import Array

_SPAN = 50.0  # peak of the largest run over what is usual in the smallest, for a log axis
_HIGHEST = 1e12  # beyond, in whatever unit, is a run that diverged
_MARGIN = 1.1


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


def _logarithmic(bottom: float, top: float, labels: int) -> dict[str, Any]:
    """Return an axis with one label a decade, or fewer if there are many."""
    low, high = np.log10(bottom) - 0.1, np.log10(top) + 0.2
    step = max(1, math.ceil((high - low) / labels))
    return {"type": "log", "range": [float(low), float(high)], "dtick": step}
