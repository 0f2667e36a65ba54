"""Arrays in the page: as base64 of their bytes, which plotly.js and the replay read."""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.laws.rotations import Array

_LARGEST = float(np.finfo(np.float32).max)
_NAMES = {"float32": "f4", "uint16": "u2", "uint32": "u4", "int16": "i2"}


def packed(values: NDArray[Any]) -> dict[str, str]:
    """Return an array as plotly.js reads it: dtype and bytes; its shape has to be known."""
    kind = _NAMES[values.dtype.name]
    data = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
    return {"dtype": kind, "bdata": base64.b64encode(data).decode("ascii")}


def packed_reals(values: Array) -> dict[str, str]:
    """Return numbers in single precision; those beyond it are its largest, NaN stays."""
    return packed(np.clip(values, -_LARGEST, _LARGEST).astype(np.float32))
