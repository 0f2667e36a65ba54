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
from numpy.typing import NDArray

from eulerparams_control.analysis.compliant import ActingImpedance, Wrenches, in_axes
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

_SWING = 0.1  # [s] within which a force that chatters goes up or down
_RISES = 0.01  # part by which a damping that rises is more


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
    return compared(wrench.t, in_axes(R_d, values))


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


@metric("s")
def rippling_time(
    recording: Recording, most: float = 4.0, after: float = 0.0, before: float = math.inf
) -> float:
    """Time for which the contact force swings.

    By more than ``most`` [N] within 0.1 s, along one base axis.
    """
    t, f = force(recording)
    inside = within(t, after, before)
    t, f = t[inside], f[inside]
    swings = (np.ptp(_soon(t, f), axis=-1) > most).any(axis=1)
    return float(np.diff(t)[: len(swings)] @ swings)


@metric("s")
def calming_time(recording: Recording, most: float = 4.0) -> float:
    """Time from the first swing of the contact force until the damping rises.

    A swing goes by more than ``most`` [N] there and back, within 0.1 s each, along one base axis:
    one bump is one.  The damping is that on ~/impedance.  Infinite if it does not rise; 0 without a
    swing.  It raises BagError if no damping was published up to the first swing.
    """
    acting: ActingImpedance = needed(recording, "acting")
    t, f = force(recording)
    soon = _soon(t, f)
    now = soon[..., 0]
    up, down = soon.max(axis=-1) - now > most, now - soon.min(axis=-1) > most
    then_up, then_down = (_soon(t[: len(now)], way).any(axis=-1) for way in (up, down))
    n = len(then_up)
    swings = ((up[:n] & then_down) | (down[:n] & then_up)).any(axis=1)
    if not swings.any():
        return 0.0
    first = float(t[np.argmax(swings)])
    D_p = np.trace(acting.matrices[:, 1], axis1=1, axis2=2)
    later = acting.t > first
    before = D_p[~later]
    if not len(before) or not before[-1] > 0.0:
        raise BagError("no damping on ~/impedance up to the first swing of the force")
    usual = before[-1]
    rises = later & (D_p > (1.0 + _RISES) * usual)
    return float(acting.t[np.argmax(rises)]) - first if rises.any() else math.inf


def _soon(t: Array, y: NDArray[Any]) -> NDArray[Any]:
    """Return the values (M, 3, K) within ``_SWING`` from each of the first of N instants on."""
    n = int((t < t[:1] + _SWING).sum())
    if n >= len(t):
        return np.zeros((0, y.shape[1], 1))
    return np.lib.stride_tricks.sliding_window_view(y, n + 1, axis=0)


@reduced("contact_energy", "J", "energy given to the contact", "peak", "final")
def contact_energy(recording: Recording) -> Samples:
    """Return what the tool gave to the contact (N,) [J], as the passivity observer counts it."""
    t, f = force(recording)
    _, mu = moment(recording)
    arm = recording.measured
    before = arm.before(t)
    power = -(f * arm.kinematics.dp_e[before] + mu * arm.omega_e[before]).sum(axis=1)
    return t, np.concatenate([[0.0], np.cumsum(power[1:] * np.diff(t))])


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

drawn(
    18.5,
    "Energy given to the contact",
    "energy given, less returned [J]",
    "What the tool gave to all contacts until then, less what they gave back: the passivity "
    "observer. The time integral of -(f' dp_e + mu' omega_e). A spring gives all back while the "
    "tool leaves it, so that the curve falls to 0; below 0 a contact, or a hand, has driven the "
    "tool.",
    "J",
    1e-9,
    name="contact_energy",
)(_felt(contact_energy))

row(10, "force, peak", "peak_force", "contact")
row(11, "force, end", "final_force", "contact")
row(12, "moment, peak", "peak_moment", "contact")
row(13, "moment, end", "final_moment", "contact")
