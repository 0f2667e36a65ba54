"""Fewer points for a plot, with every peak kept."""

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.rotations import Array


def decimate(t: Array, y: Array, bins: int) -> tuple[Array, Array]:
    """Return the first, the last, the lowest and the highest point of each bin, in order.

    A gap in y (a value that is not finite) stays a gap if it is as long as a bin.

    Args:
        t: (N,) instants.
        y: (N,) values.
        bins: number of bins of equally many points.

    Returns:
        t and y, of at most 4 points a bin.
    """
    if len(t) <= 4 * bins:
        return t, np.where(np.isfinite(y), y, np.nan)
    kept = [_extremes(y, part) for part in np.array_split(np.arange(len(t)), bins)]
    chosen = np.unique(np.concatenate(kept))
    return t[chosen], np.where(np.isfinite(y[chosen]), y[chosen], np.nan)


def _extremes(y: Array, part: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the indices of ``part`` that stand for it."""
    finite = part[np.isfinite(y[part])]
    if not len(finite):
        return part[[0, -1]]
    ends = finite[[0, -1]]
    return np.append(ends, [finite[y[finite].argmin()], finite[y[finite].argmax()]])
