"""Quantities of contact and compliance: the wrench, the compliant frame, the motion loop."""

from collections.abc import Callable

import numpy as np

from eulerparams_control.analysis.quantity import Quantity, VectorQuantity
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.laws.rotations import Array

_GROUP = "Contact and compliance by component"
Vectors = Callable[[Recording], tuple[Array, Array]]

_NOTHING = np.zeros(0), np.zeros((0, 3))


def _f(recording: Recording) -> tuple[Array, Array]:
    contact = recording.contact
    return _NOTHING if contact is None else (contact.t, contact.f)


def _mu(recording: Recording) -> tuple[Array, Array]:
    contact = recording.contact
    return _NOTHING if contact is None else (contact.t, contact.mu)


def _p_cd_d(recording: Recording) -> tuple[Array, Array]:
    compliant = recording.compliant
    return _NOTHING if compliant is None else _known(compliant.t, 1e3 * compliant.p_cd_d)


def _rho_cd_d(recording: Recording) -> tuple[Array, Array]:
    compliant = recording.compliant
    return _NOTHING if compliant is None else _known(compliant.t, np.degrees(compliant.rho_cd_d))


def _length(of: Vectors) -> Vectors:
    """Return what gives the lengths of vectors over time."""

    def lengths(recording: Recording) -> tuple[Array, Array]:
        t, v = of(recording)
        with np.errstate(over="ignore"):  # a run that diverged
            return t, np.linalg.norm(v, axis=1)

    return lengths


def _loop_position(recording: Recording) -> tuple[Array, Array]:
    leading, frames = recording.leading, recording.compliant_frames(recording.leading)
    return _known(leading.t, 1e3 * leading.distance_to(frames))


def _loop_orientation(recording: Recording) -> tuple[Array, Array]:
    leading, frames = recording.leading, recording.compliant_frames(recording.leading)
    return _known(leading.t, np.degrees(leading.angle_to(frames)))


def _known(t: Array, values: Array) -> tuple[Array, Array]:
    """Return values over time; empty if none is known."""
    some = slice(None) if np.isfinite(values).any() else slice(0, 0)
    return t[some], values[some]


_WRENCH = (
    "what the environment exerts on the tool at the origin of the tip, in base axes: f, mu of "
    "(52), (55), (59), from the sensor, without the weight of the tool that the controller knows"
)

FORCE = Quantity(
    "force", "Contact force", "force |f| [N]", f"Force: {_WRENCH}.", "N", 1e-6, _length(_f)
)
MOMENT = Quantity(
    "moment", "Contact moment", "moment |mu| [Nm]", f"Moment: {_WRENCH}.", "Nm", 1e-6, _length(_mu)
)
COMPLIANT_DISPLACEMENT = Quantity(
    "displacement",
    "Displacement of the compliant frame",
    "|p_c - p_d| [mm]",
    "Distance between the compliant and the desired origin: what the contact force makes of the "
    "translational impedance (52).",
    "mm",
    1e-6,
    _length(_p_cd_d),
)
COMPLIANT_TURN = Quantity(
    "turn",
    "Turn of the compliant frame",
    "angle of R_d' R_c [deg]",
    "Angle of the compliant frame relative to the desired one: what the contact moment makes of "
    "the rotational impedance (55), (59).",
    "deg",
    1e-6,
    _length(_rho_cd_d),
)
MOTION_LOOP_POSITION = Quantity(
    "motion_loop_position",
    "Position error of the motion loop",
    "|p_c - p_e| [mm]",
    "Distance between the compliant and the actual origin of the tip: what the inner motion loop "
    "(49) of Fig. 3 leaves. The position error above is that to the desired frame.",
    "mm",
    1e-6,
    _loop_position,
)
MOTION_LOOP_ORIENTATION = Quantity(
    "motion_loop_orientation",
    "Orientation error of the motion loop",
    "angle of R_e' R_c [deg]",
    "Angle between the compliant and the actual frame: what the inner motion loop (50), (51) of "
    "Fig. 3 leaves. The orientation error above is that to the desired frame.",
    "deg",
    1e-6,
    _loop_orientation,
)

VECTORS = (
    VectorQuantity(
        "f", "Contact force, base axes", "f [N]", f"Force: {_WRENCH}.", "N", 1e-6, _f, group=_GROUP
    ),
    VectorQuantity(
        "mu",
        "Contact moment, base axes",
        "mu [Nm]",
        f"Moment: {_WRENCH}.",
        "Nm",
        1e-6,
        _mu,
        group=_GROUP,
    ),
    VectorQuantity(
        "p_cd_d",
        "Displacement of the compliant frame, desired axes",
        "displacement [mm]",
        "R_d' (p_c - p_d): the compliant relative to the desired origin, in the desired frame.",
        "mm",
        1e-6,
        _p_cd_d,
        group=_GROUP,
    ),
    VectorQuantity(
        "rho_cd_d",
        "Turn of the compliant frame, desired axes",
        "turn [deg]",
        "Rotation vector of R_d' R_c, axis times angle of the compliant relative to the desired "
        "frame: with Euler parameters along the moment where that is along an axis of K_o (65).",
        "deg",
        1e-6,
        _rho_cd_d,
        group=_GROUP,
    ),
)
"""In the order of the page."""
