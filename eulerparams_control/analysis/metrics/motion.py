"""The way that the arm takes: speed, travel, distance to singularities, posture; its efforts."""

import math
from collections.abc import Sequence

import numpy as np

from eulerparams_control.analysis.metrics.base import metric, quotient, series_of, within
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.series import Efforts
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.laws.orientation import EulerSequence
from eulerparams_control.laws.rotations import angle_between

_ROUNDING = 1e-9  # relative tolerance of an effort that was cut to a limit


def _effort(recording: Recording) -> Efforts:
    if recording.effort is None:
        raise BagError(f"{recording.path} has no joint_effort")
    return recording.effort


@metric("Nm")
def peak_effort(recording: Recording, after: float = 0.0, before: float = math.inf) -> float:
    """Largest commanded effort of a joint."""
    effort = _effort(recording)
    return float(effort.largest[within(effort.t, after, before)].max())


@metric("s")
def saturated_time(recording: Recording, after: float = 0.0, before: float = math.inf) -> float:
    """Time with a commanded effort at its limit.

    The limits are those of the URDF.  A command counts until the next one.
    """
    effort = _effort(recording)
    at_limit = np.abs(effort.tau) >= (1 - _ROUNDING) * recording.robot.limits.effort
    lasting = np.diff(effort.t, append=effort.t[-1])
    return float(lasting[at_limit.any(axis=1) & within(effort.t, after, before)].sum())


@metric("rad/s")
def peak_joint_speed(
    recording: Recording, of: str = "leading", after: float = 0.0, before: float = math.inf
) -> float:
    """Largest joint speed."""
    series = series_of(recording, of)
    return float(series.joint_speed[within(series.t, after, before)].max())


@metric("")
def peak_speed_of_limit(
    recording: Recording, of: str = "leading", after: float = 0.0, before: float = math.inf
) -> float:
    """Largest speed of a joint over its velocity limit.

    The limits are those of the URDF.
    """
    series = series_of(recording, of)
    used = np.abs(series.dq) / recording.robot.limits.velocity
    return float(used[within(series.t, after, before)].max())


@metric("deg")
def orientation_travel(recording: Recording, of: str = "leading") -> float:
    """Angle through which the tip turns, all in all.

    The sum of the angles between its successive orientations.
    """
    return math.degrees(series_of(recording, of).turns.sum())


@metric("")
def travel_ratio(recording: Recording, of: str = "leading") -> float:
    """Angle through which the tip turns over the shortest way between its ends.

    1 if it turns straight from its first to its last orientation.
    """
    series = series_of(recording, of)
    shortest = math.degrees(angle_between(series.R_e[0], series.R_e[-1]))
    return quotient(orientation_travel(recording, of), shortest)


@metric("deg")
def closest_approach(recording: Recording, sequence: str = "", of: str = "leading") -> float:
    """Smallest angle to the pole of the Euler angles.

    Of the sequence in the parameters of the bag, unless another is named.
    """
    poles = EulerSequence(sequence) if sequence else recording.sequence
    return math.degrees(float(np.min(series_of(recording, of).pole_distance(poles))))


@metric("")
def smallest_singular_value(recording: Recording, of: str = "leading") -> float:
    """Smallest singular value of J on the way."""
    return float(np.min(series_of(recording, of).smallest_singular_value))


@metric("rad^2")
def posture_cost(
    recording: Recording, posture: Sequence[float], at: str = "end", of: str = "leading"
) -> float:
    """Half the square of the distance of the joints from a posture.

    1/2 |q - posture|^2 at the ``start`` or at the ``end``; the posture in rad, one number a
    joint.
    """
    if at not in ("start", "end"):
        raise UnknownNameError("time of posture_cost", at, ("start", "end"))
    if len(posture) != recording.robot.n:
        raise BagError(
            f"{recording.path}: the posture has {len(posture)} values; expected one for each of "
            f"the {recording.robot.n} joints {', '.join(recording.robot.joints)}"
        )
    difference = series_of(recording, of).q[0 if at == "start" else -1] - np.array(posture)
    with np.errstate(over="ignore"):  # a run that diverged
        return float(difference @ difference) / 2
