"""Errors of position and orientation.

They are those of the tip from the ``desired`` frame, or with ``against: compliant`` from the
compliant frame: what the motion loop of an impedance leaves.
"""

import math
from collections.abc import Callable

import numpy as np

from eulerparams_control.analysis.frames import Frames
from eulerparams_control.analysis.metrics.base import metric, quotient, series_of, within
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.series import Series
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.laws.rotations import Array


def _known(t: Array, error: Array, after: float, before: float) -> tuple[Array, Array]:
    """Return instants and errors of a window, where there is an error."""
    known = within(t, after, before) & np.isfinite(error)
    if not known.any():
        raise BagError("no desired frame was recorded: nothing to compare the motion with")
    return t[known], error[known]


def _frames(recording: Recording, series: Series, against: str) -> Frames:
    """Return the frames that a motion is compared with."""
    if against == "desired":
        return series.desired
    if against != "compliant":
        raise UnknownNameError("frame", against, ("desired", "compliant"))
    if recording.compliant is None:
        raise BagError(f"{recording.path} has no compliant_frame")
    return recording.compliant.at(series.t)


def _orientation(
    recording: Recording,
    of: str,
    after: float = 0.0,
    before: float = math.inf,
    against: str = "desired",
) -> tuple[Array, Array]:
    """Return instants [s] and orientation errors [deg]."""
    series = series_of(recording, of)
    frames = _frames(recording, series, against)
    error = series.orientation_error if frames is series.desired else series.angle_to(frames)
    return _known(series.t, np.degrees(error), after, before)


def _position(
    recording: Recording, of: str, after: float, before: float, against: str
) -> tuple[Array, Array]:
    """Return instants [s] and position errors [mm]."""
    series = series_of(recording, of)
    frames = _frames(recording, series, against)
    error = series.position_error if frames is series.desired else series.distance_to(frames)
    return _known(series.t, 1e3 * error, after, before)


def _family(name: str, unit: str, errors: Callable[..., tuple[Array, Array]]) -> None:
    """Register the metrics that both errors have in common."""

    @metric(unit, name=f"peak_{name}_error", text=f"Largest {name} error")
    def _peak(
        recording: Recording,
        of: str = "leading",
        after: float = 0.0,
        before: float = math.inf,
        against: str = "desired",
    ) -> float:
        return float(errors(recording, of, after, before, against)[1].max())

    @metric(unit, name=f"final_{name}_error", text=f"{name.capitalize()} error at the end")
    def _final(
        recording: Recording,
        of: str = "leading",
        before: float = math.inf,
        against: str = "desired",
    ) -> float:
        return float(errors(recording, of, 0.0, before, against)[1][-1])


_family("orientation", "deg", _orientation)
_family("position", "mm", _position)


@metric("deg")
def rms_orientation_error(
    recording: Recording,
    of: str = "leading",
    after: float = 0.0,
    before: float = math.inf,
    against: str = "desired",
) -> float:
    """Root mean square of the orientation error."""
    return math.sqrt(np.mean(_orientation(recording, of, after, before, against)[1] ** 2))


@metric("s")
def settling_time(recording: Recording, threshold: float = 1.0, of: str = "leading") -> float:
    """Last time at which the orientation error exceeds a threshold.

    The threshold is in deg.  Infinite if the error ends above it, or the run diverged.
    """
    t, error = _orientation(recording, of)
    if error[-1] > threshold or recording.diverged is not None:
        return math.inf
    return float(np.max(t[error > threshold], initial=0.0))


@metric("")
def period_growth(recording: Recording, period: float, of: str = "leading") -> float:
    """Largest orientation error of the last period over the first."""
    end = math.floor(round(float(series_of(recording, of).t[-1]) / period, 6)) * period
    first, last = (
        float(_orientation(recording, of, *window)[1].max())
        for window in ((0.0, period), (end - period, end))
    )
    return quotient(last, first)


@metric("deg")
def servo_lag(recording: Recording) -> float:
    """Largest angle of a joint between command and measurement."""
    _, lag = recording.servo_lag
    if not len(lag):
        raise BagError(f"{recording.path} has no joint_reference with a stamp of its joint_states")
    return math.degrees(lag.max())
