"""Numbers of a run that a criterion can be put on; a new one is one function.

Each takes a Recording and keyword options from the experiment's YAML, and returns one
number in the unit that its registration names.  ``of`` is what it looks at: the
``command`` (joint_reference), the motion that was ``measured`` (joint_states), or the
``leading`` of them: the command if there is one.  What was not recorded raises BagError.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from eulerparams_control.analysis.recording import Recording, Series
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.orientation import EulerSequence
from eulerparams_control.rotations import Array


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
    if of not in ("command", "measured", "leading"):
        raise UnknownNameError("series", of, ("command", "measured", "leading"))
    if of == "measured":
        return recording.measured
    if of == "leading":
        return recording.leading
    if recording.command is None:
        raise BagError(f"{recording.path} has no joint_reference")
    return recording.command


def _known(values: Array) -> Array:
    """Return the errors where there is one."""
    known = values[np.isfinite(values)]
    if not len(known):
        raise BagError("no desired frame was recorded: nothing to compare the motion with")
    return known


def _peak(values: Array) -> float:
    return float(_known(values).max())


@metric("deg")
def peak_orientation_error(recording: Recording, of: str = "command", after: float = 0.0) -> float:
    """Largest orientation error."""
    series = _series(recording, of)
    return math.degrees(_peak(series.orientation_error[series.t >= after]))


@metric("deg")
def final_orientation_error(recording: Recording, of: str = "command") -> float:
    """Orientation error at the end."""
    return math.degrees(_known(_series(recording, of).orientation_error)[-1])


@metric("mm")
def peak_position_error(recording: Recording, of: str = "command") -> float:
    """Largest position error."""
    return 1e3 * _peak(_series(recording, of).position_error)


@metric("mm")
def final_position_error(recording: Recording, of: str = "command") -> float:
    """Position error at the end."""
    return 1e3 * float(_known(_series(recording, of).position_error)[-1])


@metric("rad/s")
def peak_joint_speed(recording: Recording, of: str = "command") -> float:
    """Largest joint speed."""
    return float(_series(recording, of).joint_speed.max())


@metric("deg")
def servo_lag(recording: Recording) -> float:
    """Largest angle of a joint between command and measurement."""
    _, lag = recording.servo_lag
    if not len(lag):
        raise BagError(f"{recording.path} has no joint_reference with a stamp of its joint_states")
    return math.degrees(lag.max())


@metric("")
def period_growth(recording: Recording, period: float, of: str = "command") -> float:
    """Largest orientation error of the last period over the first."""
    series = _series(recording, of)
    error, t = series.orientation_error, series.t
    end = math.floor(round(float(t[-1]) / period, 6)) * period
    first, last = error[t <= period], error[(t >= end - period) & (t <= end)]
    return _peak(last) / _peak(first)


@metric("deg")
def closest_approach(recording: Recording, sequence: str = "", of: str = "command") -> float:
    """Smallest angle to the pole of the Euler angles.

    Of the sequence in the parameters of the bag, unless another is named.
    """
    poles = EulerSequence(sequence) if sequence else recording.sequence
    return math.degrees(float(np.min(_series(recording, of).pole_distance(poles))))


@metric("")
def smallest_singular_value(recording: Recording, of: str = "command") -> float:
    """Smallest singular value of J on the way."""
    return float(np.min(_series(recording, of).smallest_singular_value))
