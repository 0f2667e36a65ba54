"""The orientation error in every representation, and the pose of the tip."""

import numpy as np

from eulerparams_control.analysis.quantities.base import XYZ, Quantity, vectors
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array

_NOTHING = np.zeros(0), np.zeros((0, 3))
_ERRORS = "Orientation error in every representation"
_TIP = "Pose of the tip"
_ANGLES = "alpha", "beta", "gamma"


def _error(kind: type[OrientationRepresentation]) -> Quantity:
    """Return the orientation error in a representation."""
    unit = "deg" if kind.unit == "rad" else kind.unit
    of_angles = "angles" in kind.name
    components = _ANGLES if of_angles else XYZ
    terms = "angles of the sequence that was set" if of_angles else "base frame"

    def of(recording: Recording) -> tuple[Array, Array]:
        known = recording.known
        if not len(known):
            return _NOTHING
        error = recording.displacements(kind.name).error
        return recording.leading.t[known], np.degrees(error) if kind.unit == "rad" else error

    return Quantity(
        f"error_{kind.name}",
        kind.name,
        f"{kind.symbol} [{unit}]" if unit else kind.symbol,
        f"{kind.symbol}, {terms}: what k_Po acts on with orientation: {kind.name}.",
        unit,
        1e-6 if unit else 1e-8,
        of,
        components=components,
        group=_ERRORS,
    )


def _p_e(recording: Recording) -> tuple[Array, Array]:
    return recording.leading.t, recording.leading.p_e


def _phi_e(recording: Recording) -> tuple[Array, Array]:
    with np.errstate(invalid="ignore"):  # a run that diverged
        phi = recording.sequence.extract(recording.leading.R_e)
    return recording.leading.t, np.degrees(phi)


def _p_d(recording: Recording) -> tuple[Array, Array]:
    known = recording.known
    return recording.leading.t[known], recording.leading.desired.p[known]


ERRORS = tuple(map(_error, OrientationRepresentation.registry.values()))
"""One for each representation that is registered."""

TIP = vectors(
    _TIP,
    ("p_d", "Desired position", "p_d [m]",
     "Origin of the desired frame in the base frame.", "m", 1e-9, _p_d),
    ("p_e", "Position of the tip", "p_e [m]",
     "Origin of the tip in the base frame, of the commanded motion if there is one.",
     "m", 1e-9, _p_e),
) + vectors(
    _TIP,
    ("phi_e", "Euler angles of the tip", "phi_e [deg]",
     "Euler angles of the tip in the sequence that was set: they jump at its poles, not the tip.",
     "deg", 1e-6, _phi_e),
    components=_ANGLES,
)  # fmt: skip

PLACES = {22: ERRORS, 24: TIP}
