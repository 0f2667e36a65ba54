"""Contact: force and moment at the tip, from wrench.

They are what the environment exerts on the tool, at the origin of the tip.  Options:

``axis``  three numbers: the component along them, with its sign; without it the length.
``frame``  whose axes ``axis`` refers to: ``base``, the default, or ``desired``.
``window``  [s] at the end over which the mean is taken; 0, the default, is the last sample.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from eulerparams_control.analysis.compliant import Wrenches
from eulerparams_control.analysis.quantities.base import (
    XYZ,
    Axis,
    Samples,
    along,
    compared,
    drawn,
    metric,
    needed,
    reduced,
    row,
    within,
)
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.laws.rotations import Array

FRAMES = ("base", "desired")


def desired_rotations(recording: Recording, t: Array) -> Array:
    """Return R_d (N, 3, 3) at instants t (N,) [s], the last before each; NaN where is none."""
    measured = recording.measured
    before = np.searchsorted(measured.t, t, side="right") - 1
    return measured.desired.take(before).R


def _wrench(recording: Recording, part: str, frame: str) -> Samples:
    """Return f or mu (N, 3) in the axes of a frame."""
    wrench: Wrenches = needed(recording, "wrench")
    if frame not in FRAMES:
        raise UnknownNameError("frame", frame, FRAMES)
    values: Array = getattr(wrench, part)
    if frame == "base":
        return wrench.t, values
    R_d = desired_rotations(recording, wrench.t)
    return compared(wrench.t, np.einsum("nji,nj->ni", R_d, values))  # R_d' v


@reduced("force", "N", "contact force", "peak", "least", "final", vectors=True)
def force(recording: Recording, frame: str = "base") -> Samples:
    """Return f (N, 3) [N]."""
    return _wrench(recording, "f", frame)


@reduced("moment", "Nm", "contact moment", "peak", "final", vectors=True)
def moment(recording: Recording, frame: str = "base") -> Samples:
    """Return mu (N, 3) [Nm]."""
    return _wrench(recording, "mu", frame)


@metric("N")
def force_ripple(recording: Recording, window: float, axis: Axis = ()) -> float:
    """Largest less smallest contact force over the last seconds.

    Of the component along an axis, else of that base component of which it is largest: chatter
    shows even where the length of the force stays.
    """
    t, f = force(recording)
    last = f[within(t, float(t[-1]) - window, math.inf)]
    components = along(last, axis)[:, None] if len(axis) else last
    return float(np.ptp(components, axis=0).max())


def _felt(of: Callable[[Recording], Samples]) -> Callable[[Recording], Samples]:
    """Return what gives components, where anything was felt or an impedance answers it."""

    def felt(recording: Recording) -> Samples:
        if recording.contact is None:
            raise BagError(f"{recording.path}: nothing was felt")
        return of(recording)

    return felt


def lengths(of: Callable[[Recording], Samples]) -> Callable[[Recording], Samples]:
    """Return what gives the lengths of vectors over time."""

    def found(recording: Recording) -> Samples:
        t, values = of(recording)
        return t, along(values, ())

    return found


GROUP = "Contact and compliance by component"
_WRENCH = (
    "what the environment exerts on the tool at the origin of the tip, in base axes: f, mu of "
    "(52), (55), (59), from the sensor, without the weight of the tool that the controller knows"
)
_F, _MU = _felt(force), _felt(moment)
_BOTH = (
    ("force", "f", "Contact force", "Force", "N", _F),
    ("moment", "mu", "Contact moment", "Moment", "Nm", _MU),
)
for _i, (_name, _symbol, _title, _word, _unit, _of) in enumerate(_BOTH):
    _caption, _label = f"{_word}: {_WRENCH}.", f"{_word.lower()} |{_symbol}| [{_unit}]"
    drawn(2 + _i, _title, _label, _caption, _unit, 1e-6, name=_name)(lengths(_of))
    _look: dict[str, Any] = {"components": XYZ, "group": GROUP}
    _title, _label = f"{_title}, base axes", f"{_symbol} [{_unit}]"
    drawn(20 + _i / 10, _title, _label, _caption, _unit, 1e-6, name=_symbol, **_look)(_of)

row(10, "force, peak", "peak_force", "contact")
row(11, "force, end", "final_force", "contact")
row(12, "moment, peak", "peak_moment", "contact")
row(13, "moment, end", "final_moment", "contact")
