"""The orientation error in every representation, and the pose of the tip."""

import numpy as np

from eulerparams_control.analysis.quantities.base import XYZ, Samples, drawn
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.stacks import euler_angles
from eulerparams_control.laws.orientation import ORIENTATIONS, OrientationRepresentation

_NOTHING = np.zeros(0), np.zeros((0, 3))
_ERRORS = "Orientation error in every representation"
_TIP = "Pose of the tip"
_ANGLES = "alpha", "beta", "gamma"


def _draw_error(place: float, kind: type[OrientationRepresentation]) -> None:
    """Register the orientation error in a representation."""
    unit = "deg" if kind.unit == "rad" else kind.unit
    of_angles = "angles" in kind.name
    terms = "angles of the sequence that was set" if of_angles else "base frame"

    def error(recording: Recording) -> Samples:
        known = recording.known
        if not (len(known) and _is_drawn(kind.name, recording)):
            return _NOTHING
        error = recording.error_in(kind.name)
        return recording.leading.t[known], np.degrees(error) if kind.unit == "rad" else error

    drawn(
        place, kind.name, f"{kind.symbol} [{unit}]" if unit else kind.symbol,
        f"{kind.symbol}, {terms}: what k_Po acts on with orientation: {kind.name}.",
        unit=unit, floor=1e-6 if unit else 1e-8, name=f"error_{kind.name}",
        components=_ANGLES if of_angles else XYZ, group=_ERRORS,
    )(error)  # fmt: skip


def _is_drawn(name: str, recording: Recording) -> bool:
    """Return whether a representation is one of the package, or that of the run."""
    return name in ORIENTATIONS or recording.parameter("orientation") == name


for _i, _kind in enumerate(OrientationRepresentation.registry.values()):
    _draw_error(22 + _i / 100, _kind)


@drawn(
    24, "Desired position", "p_d [m]",
    "Origin of the desired frame in the base frame.",
    unit="m", floor=1e-9, components=XYZ, group=_TIP,
)  # fmt: skip
def p_d(recording: Recording) -> Samples:
    """Return the desired position (N, 3) [m]."""
    known = recording.known
    return recording.leading.t[known], recording.leading.desired.p[known]


@drawn(
    24.1, "Position of the tip", "p_e [m]",
    "Origin of the tip in the base frame, of the commanded motion if there is one.",
    unit="m", floor=1e-9, components=XYZ, group=_TIP,
)  # fmt: skip
def p_e(recording: Recording) -> Samples:
    """Return the position (N, 3) [m] of the tip."""
    return recording.leading.t, recording.leading.p_e


@drawn(
    24.2, "Euler angles of the tip", "phi_e [deg]",
    "Euler angles of the tip in the sequence that was set: they jump at its poles, not the tip.",
    unit="deg", floor=1e-6, components=_ANGLES, group=_TIP,
)  # fmt: skip
def phi_e(recording: Recording) -> Samples:
    """Return the Euler angles (N, 3) [deg] of the tip."""
    phi = euler_angles(recording.sequence, recording.leading.R_e)
    return recording.leading.t, np.degrees(phi)
