"""The orientation error in every representation, the pose of the tip, and the rates of V."""

import numpy as np

from eulerparams_control.analysis.quantity import Quantity, VectorQuantity
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array

_NOTHING = np.zeros(0), np.zeros((0, 3))
_ERRORS = "Orientation error in every representation"
_TIP = "Pose of the tip"


def _error(kind: type[OrientationRepresentation]) -> VectorQuantity:
    """Return the orientation error in a representation."""
    unit = "deg" if kind.unit == "rad" else kind.unit
    of_angles = "angles" in kind.name
    components = ("alpha", "beta", "gamma") if of_angles else ("x", "y", "z")
    terms = "angles of the sequence that was set" if of_angles else "base frame"

    def of(recording: Recording) -> tuple[Array, Array]:
        known = recording.known
        if not len(known):
            return _NOTHING
        error = recording.displacements(kind.name).error
        return recording.leading.t[known], np.degrees(error) if kind.unit == "rad" else error

    return VectorQuantity(
        f"error_{kind.name}",
        kind.name,
        f"{kind.symbol} [{unit}]" if unit else kind.symbol,
        f"{kind.symbol}, {terms}: what k_Po acts on with orientation: {kind.name}.",
        unit,
        1e-6 if unit else 1e-8,
        of,
        components,
        _ERRORS,
    )


def _p_e(recording: Recording) -> tuple[Array, Array]:
    return recording.leading.t, recording.leading.p_e


def _phi_e(recording: Recording) -> tuple[Array, Array]:
    with np.errstate(invalid="ignore"):  # a run that diverged
        phi = recording.sequence.extract(recording.leading.R_e)
    return recording.leading.t, np.degrees(phi)


def _rates(recording: Recording) -> tuple[Array, Array]:
    found = recording.lyapunov
    if found is None:
        return np.zeros(0), np.zeros((0, 2))
    return found.t, np.column_stack([found.dV, found.dV_measured])


def _p_d(recording: Recording) -> tuple[Array, Array]:
    known = recording.known
    return recording.leading.t[known], recording.leading.desired.p[known]


def _measured_orientation_error(recording: Recording) -> tuple[Array, Array]:
    return _measured(recording, np.degrees(recording.measured.orientation_error))


def _measured_position_error(recording: Recording) -> tuple[Array, Array]:
    return _measured(recording, 1e3 * recording.measured.position_error)


def _measured(recording: Recording, error: Array) -> tuple[Array, Array]:
    """Return an error over time; empty without a command: then it is the error itself."""
    known = np.flatnonzero(np.isfinite(error))
    if recording.command is None:
        known = known[:0]
    return recording.measured.t[known], error[known]


MEASURED_ERRORS = (
    Quantity(
        "measured_orientation_error",
        "Orientation error of the arm itself",
        "orientation error [deg]",
        "Angle between the desired frame and the tip as it was measured, joint_states.",
        "deg",
        1e-6,
        _measured_orientation_error,
    ),
    Quantity(
        "measured_position_error",
        "Position error of the arm itself",
        "position error [mm]",
        "Distance between the desired and the measured origin of the tip, joint_states.",
        "mm",
        1e-6,
        _measured_position_error,
    ),
)
"""Beside those of the command, where there is one."""

ERRORS = tuple(map(_error, OrientationRepresentation.registry.values()))
"""One for each representation that is registered."""

TIP = (
    VectorQuantity(
        "p_d",
        "Desired position",
        "p_d [m]",
        "Origin of the desired frame in the base frame.",
        "m",
        1e-9,
        _p_d,
        group=_TIP,
    ),
    VectorQuantity(
        "p_e",
        "Position of the tip",
        "p_e [m]",
        "Origin of the tip in the base frame, of the commanded motion if there is one.",
        "m",
        1e-9,
        _p_e,
        group=_TIP,
    ),
    VectorQuantity(
        "phi_e",
        "Euler angles of the tip",
        "phi_e [deg]",
        "Euler angles of the tip in the sequence that was set: they jump at its poles, not the "
        "tip.",
        "deg",
        1e-6,
        _phi_e,
        ("alpha", "beta", "gamma"),
        _TIP,
    ),
)

RATES = VectorQuantity(
    "lyapunov_rate",
    "Rate of the Lyapunov function",
    "dV",
    "Derivative of V: by the paper, (31), (43) or (69), and as it was measured, by differences "
    "of V. They agree where the closed loop is that of the paper. V_1 has no unit, V_2 is in "
    "1/s^2, V_3 in J.",
    "",
    1e-9,
    _rates,
    ("by the paper", "as measured"),
    "Lyapunov function",
)
