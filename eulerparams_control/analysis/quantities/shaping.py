"""The motion that was made of the references over time, and how its time ran."""

from typing import Any

import numpy as np

from eulerparams_control.analysis.quantities.base import Samples, drawn
from eulerparams_control.analysis.recording import Recording

_GROUP = "What was made of the references"
_REST = 1e-6  # [m/s, rad/s]
_NOTHING = np.zeros(0), np.zeros(0)


_PACE = "How fast the time of the desired motion ran, as /diagnostics said: below 1 near a limit "
_PACE += "of a joint or a singularity. Dashed: a trajectory at its slowest within the limits."


def _draw_speed(place: float, of: str, column: str, what: str, unit: str, *title: str) -> None:
    """Register the speed of a frame: a column of what was asked, or made."""

    def speed(recording: Recording) -> Samples:
        shaped = recording.shaped
        if shaped is None:
            return _NOTHING
        rates = {name: getattr(getattr(shaped, name), column) for name in ("asked", "made")}
        with np.errstate(over="ignore", invalid="ignore"):
            speeds = {name: np.linalg.norm(rate, axis=1) for name, rate in rates.items()}
        moves = any((speed > _REST).any() for speed in speeds.values())
        is_known = not np.isnan(speeds[of]).all()
        return (shaped.t, speeds[of]) if moves and is_known else _NOTHING

    name, words, *beside = title
    caption = f"{what} of the motion that the controller follows, ~/desired: smooth, within the "
    caption += "limits of the tip. Dashed: as the references asked."
    look: dict[str, Any] = {"name": name, "group": _GROUP, "beside": "".join(beside)}
    drawn(place, words, f"speed [{unit}]", caption, unit, **look)(speed)


def _draw_said(place: float, column: int, caption: str, *title: str) -> None:
    """Register what the controller reported of its ticks: it holds until the next report."""

    def said(recording: Recording) -> Samples:
        shaped = recording.shaped
        if shaped is None or not shaped.rates[:, column].any():
            return _NOTHING
        return shaped.rates[:, 0].repeat(2)[1:], shaped.rates[:, column].repeat(2)[:-1]

    name, words, *beside = title
    look: dict[str, Any] = {"name": name, "group": _GROUP, "beside": "".join(beside)}
    drawn(place, words, words.lower(), caption, **look)(said)


_draw_speed(17.0, "made", "dp", "Speed", "m/s", "tip_speed", "Speed of the tip")
_draw_speed(17.1, "made", "omega", "Angular velocity", "rad/s", "turning", "Turning of the tip")
_draw_said(17.2, 1, _PACE, "pace", "Rate of time")
_COUNT = "How many commands limits had changed, up to then."
_draw_said(17.3, 3, _COUNT, "saturation", "Saturated ticks")

_draw_speed(40.0, "asked", "dp", "Speed", "m/s", "asked_speed", "as asked", "tip_speed")
_draw_speed(40.1, "asked", "omega", "Turning", "rad/s", "asked_turning", "as asked", "turning")
_draw_said(40.2, 2, _PACE, "slowed", "trajectory at its slowest", "pace")
