"""Numbers of a run that a criterion can be put on; a new one is one function.

Each takes a Recording and keyword options from the experiment's YAML, and returns one
number in the unit that its registration names.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from eulerparams_control.analysis.recording import Recording, Series
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.orientation import EulerSequence


class Metric(NamedTuple):
    """A number of a run.

    Attributes:
        compute: from a recording.
        unit: of the number; "" if it has none.
        description: in words.
    """

    compute: Callable[..., float]
    unit: str
    description: str


METRICS: dict[str, Metric] = {}


def metric(unit: str) -> Callable[[Callable[..., float]], Callable[..., float]]:
    """Register a function as the metric of its name; its first doc line describes it."""

    def register(function: Callable[..., float]) -> Callable[..., float]:
        description = (function.__doc__ or "").split("\n")[0].rstrip(".")
        METRICS[function.__name__] = Metric(function, unit, description)
        return function

    return register


def get_metric(name: str) -> Metric:
    """Return the metric of that name; raises UnknownNameError."""
    if name not in METRICS:
        raise UnknownNameError("metric", name, METRICS)
    return METRICS[name]


def _series(recording: Recording, of: str) -> Series:
    if of == "measured":
        return recording.measured
    if recording.command is None:
        raise BagError(f"{recording.path} has no joint_reference")
    return recording.command


def _peak(values: np.ndarray) -> float:
    if not np.isfinite(values).any():
        raise BagError("no desired frame was recorded: nothing to compare the motion with")
    return float(np.nanmax(values))


@metric("deg")
def peak_orientation_error(recording: Recording, of: str = "command") -> float:
    """Largest orientation error, of the joint_reference or of the measured motion."""
    return math.degrees(_peak(_series(recording, of).orientation_error))


@metric("mm")
def peak_position_error(recording: Recording, of: str = "command") -> float:
    """Largest position error, of the joint_reference or of the measured motion."""
    return 1e3 * _peak(_series(recording, of).position_error)


@metric("rad/s")
def peak_joint_speed(recording: Recording, of: str = "command") -> float:
    """Largest joint speed, of the joint_reference or of the measured motion."""
    return _peak(_series(recording, of).joint_speed)


@metric("deg")
def servo_lag(recording: Recording) -> float:
    """Largest angle between the commanded and the measured position of a joint."""
    command, measured = _series(recording, "command"), recording.measured
    _, i, j = np.intersect1d(command.t, measured.t, return_indices=True)
    return math.degrees(_peak(np.abs(command.q[i] - measured.q[j])))


@metric("")
def period_growth(recording: Recording, period: float, of: str = "command") -> float:
    """Largest orientation error of the last period over that of the first."""
    series = _series(recording, of)
    error, t = series.orientation_error, series.t
    end = math.floor(round(float(t[-1]) / period, 6)) * period
    first, last = error[t <= period], error[(t >= end - period) & (t <= end)]
    return _peak(last) / _peak(first)


@metric("deg")
def closest_approach(recording: Recording, sequence: str = "XYZ", of: str = "command") -> float:
    """Smallest angle to the pole of a sequence of Euler angles."""
    return math.degrees(float(np.min(_series(recording, of).pole_distance(EulerSequence(sequence)))))


@metric("")
def smallest_singular_value(recording: Recording, of: str = "command") -> float:
    """Smallest singular value of the Jacobian on the way."""
    return float(np.min(_series(recording, of).smallest_singular_value))
