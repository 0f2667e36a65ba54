"""The motion that was made of the references over time, and how its time ran."""

import numpy as np

from eulerparams_control.analysis.quantities.base import Quantity
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.laws.rotations import Array

_GROUP = "What was made of the references"
_REST = 1e-6  # [m/s, rad/s]
_NOTHING = np.zeros(0), np.zeros(0)


def _speed(name: str, title: str, of: str, column: str, what: str, unit: str) -> Quantity:
    """Return the speed of a frame: a column of what was asked, or made."""

    def values(recording: Recording) -> tuple[Array, Array]:
        shaped = recording.shaped
        if shaped is None:
            return _NOTHING
        rates = {name: getattr(getattr(shaped, name), column) for name in ("asked", "made")}
        with np.errstate(over="ignore", invalid="ignore"):
            speeds = {name: np.linalg.norm(rate, axis=1) for name, rate in rates.items()}
        moves = any((speed > _REST).any() for speed in speeds.values())
        return (shaped.t, speeds[of]) if moves else _NOTHING

    caption = f"{what} of the motion that the controller follows, ~/desired: smooth, within the "
    caption += "limits of the tip. Dashed: as the references asked."
    return Quantity(name, title, f"speed [{unit}]", caption, unit, 0.0, values, group=_GROUP)


def _said(name: str, title: str, column: int, caption: str) -> Quantity:
    """Return what the controller said of its ticks: it holds until it says something else."""

    def values(recording: Recording) -> tuple[Array, Array]:
        shaped = recording.shaped
        if shaped is None or not shaped.rates[:, column].any():
            return _NOTHING
        return shaped.rates[:, 0].repeat(2)[1:], shaped.rates[:, column].repeat(2)[:-1]

    return Quantity(name, title, title.lower(), caption, "", 0.0, values, group=_GROUP)


_PACE = "How fast the time of the desired motion ran, as /diagnostics said: below 1 near a limit "
_PACE += "of a joint or a singularity. Dashed: a trajectory at its slowest within the limits."

SHAPING = (
    _speed("tip_speed", "Speed of the tip", "made", "dp", "Speed", "m/s"),
    _speed("turning", "Turning of the tip", "made", "omega", "Angular velocity", "rad/s"),
    _said("pace", "Rate of time", 1, _PACE),
    _said("saturation", "Saturated ticks", 3, "How many commands limits had changed, up to then."),
)
"""In the order of the page."""

DASHED = {
    "tip_speed": _speed("asked_speed", "as asked", "asked", "dp", "Speed", "m/s"),
    "turning": _speed("asked_turning", "as asked", "asked", "omega", "Turning", "rad/s"),
    "pace": _said("slowed", "trajectory at its slowest", 2, _PACE),
}
"""What is drawn dashed with each of them."""

PLACES = {17: SHAPING, 40: tuple(DASHED.values())}
