"""The axis of a quantity: linear, or logarithmic where runs differ by powers of ten."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from eulerparams_control.rotations import Array

_SPAN = 50.0  # peak of the largest run over what is usual in the smallest, for a log axis
_MARGIN = 1.1


def axis(runs: Sequence[Array], floor: float, labels: int = 8) -> dict[str, Any]:
    """Return type, range and ticks of a plotly axis that shows all runs.

    Args:
        runs: the values of each run, >= 0; those that are not finite do not count.
        floor: what is smaller is rounding: a logarithmic axis does not reach down to it.
        labels: most labels that a logarithmic axis has room for.
    """
    values = [run[np.isfinite(run) & (run > 0)] for run in runs]
    values = [run for run in values if len(run)]
    if not values:
        return {"type": "linear", "rangemode": "tozero"}
    top = max(float(run.max()) for run in values)
    usual = min(float(np.median(run)) for run in values)
    if top < _SPAN * usual:
        return {"type": "linear", "range": [0.0, _MARGIN * top]}
    bottom = min(float(np.quantile(run, 0.02)) for run in values)
    return _logarithmic(min(max(bottom, floor), top / _SPAN), top, labels)


def _logarithmic(bottom: float, top: float, labels: int) -> dict[str, Any]:
    """Return an axis with one label a decade, or fewer if there are many."""
    low, high = np.log10(bottom) - 0.1, np.log10(top) + 0.2
    step = max(1, math.ceil((high - low) / labels))
    return {"type": "log", "range": [float(low), float(high)], "dtick": step}
