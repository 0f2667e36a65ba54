"""Less data for the page: fewer points with every peak kept, and numbers packed into text."""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.laws.rotations import Array

_LARGEST = float(np.finfo(np.float32).max)
_NAMES = {"float32": "f4", "uint16": "u2", "uint32": "u4", "int16": "i2"}


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
    width = -(-len(t) // bins)
    places = np.minimum(np.arange(bins * width), len(t) - 1).reshape(bins, width)
    chosen = np.unique(_extremes(y, places))
    return t[chosen], np.where(np.isfinite(y[chosen]), y[chosen], np.nan)


def _extremes(y: Array, places: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the places that represent each row of places; its ends if nothing is finite."""
    values = y[places]
    finite = np.isfinite(values)
    lowest = np.where(finite, values, np.inf).argmin(axis=1)
    highest = np.where(finite, values, -np.inf).argmax(axis=1)
    first = finite.argmax(axis=1)
    last = places.shape[1] - 1 - finite[:, ::-1].argmax(axis=1)
    columns = np.stack([first, lowest, highest, last], axis=1)
    chosen: NDArray[np.intp] = np.take_along_axis(places, columns, axis=1)
    return chosen


def packed(values: NDArray[Any]) -> dict[str, str]:
    """Return an array as plotly.js reads it: dtype and bytes; its shape has to be known."""
    kind = _NAMES[values.dtype.name]
    data = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
    return {"dtype": kind, "bdata": base64.b64encode(data).decode("ascii")}


def packed_reals(values: Array) -> dict[str, str]:
    """Return numbers in single precision; those beyond it are its largest, NaN stays."""
    return packed(np.clip(values, -_LARGEST, _LARGEST).astype(np.float32))
