"""What metrics of vectors over time share: a component or the length, and the mean at the end."""

import math
from collections.abc import Sequence

import numpy as np

from eulerparams_control.analysis.metrics.base import within
from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.laws.rotations import Array

type Axis = Sequence[float]
"""Three numbers, of any length but 0; none at all means no axis."""


def along(vectors: Array, axis: Axis) -> Array:
    """Return the components (...) of vectors (..., 3) along an axis, or without one their lengths.

    Raises:
        ConfigurationError: if the axis is no direction.
    """
    if not len(axis):
        with np.errstate(over="ignore"):  # a run that diverged
            return np.linalg.norm(vectors, axis=-1)
    direction = np.array(axis, dtype=float)
    length = float(np.linalg.norm(direction)) if direction.shape == (3,) else math.nan
    if not 0 < length < math.inf:
        raise ConfigurationError(f"axis is {list(axis)}; expected three numbers, not all 0")
    return vectors @ (direction / length)


def known(t: Array, vectors: Array, after: float, before: float) -> tuple[Array, Array]:
    """Return instants and vectors (N, 3) of a window that are known; raises BagError if none is."""
    inside = within(t, after, before) & np.isfinite(vectors).all(axis=1)
    if not inside.any():
        raise BagError("no desired frame was recorded: nothing to compare the motion with")
    return t[inside], vectors[inside]


def mean_at_end(t: Array, vectors: Array, window: float, before: float) -> Array:
    """Return the mean (3,) of known vectors (N, 3) over the last ``window`` [s].

    The end is the last known one that is not after ``before``; a window of 0 is that alone.
    """
    t, vectors = known(t, vectors, 0.0, before)
    mean: Array = vectors[t >= t[-1] - window * (1 + 1e-9)].mean(axis=0)
    return mean
