"""The orientation error in every representation, the pose of the tip, and the rates of V."""

import numpy as np

from eulerparams_control.analysis.quantity import VectorQuantity
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.orientation import OrientationRepresentation
from eulerparams_control.rotations import Array

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
        phi = recording.sequence.extracts(recording.leading.R_e)
    return recording.leading.t, np.degrees(phi)


def _rates(recording: Recording) -> tuple[Array, Array]:
    found = recording.lyapunov
    if found is None:
        return np.zeros(0), np.zeros((0, 2))
    return found.t, np.column_stack([found.dV, found.dV_measured])


ERRORS = tuple(map(_error, OrientationRepresentation.registry.values()))
"""One for each representation that is registered."""

TIP = (
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
    "dV [1/s]",
    "Derivative of V: by the paper, (31), (43) or (69), and as it was measured, by differences "
    "of V. They agree where the closed loop is that of the paper.",
    "1/s",
    1e-9,
    _rates,
    ("by the paper", "as measured"),
    "Lyapunov function",
)
