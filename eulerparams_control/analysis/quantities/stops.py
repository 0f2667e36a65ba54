"""Stops: what an arm does from the moment on at which a node stopped it, as /diagnostics says.

Where nothing stopped it, the numbers are infinite.  Options:

``since``  [s] after the stop from which on it is looked at; 0, the default, is from the stop on.
``lasting``  [s] for how long; without it to the end.
"""

import math

import numpy as np

from eulerparams_control.analysis.quantities.base import Samples, metric, quotient
from eulerparams_control.analysis.quantities.contact import force
from eulerparams_control.analysis.quantities.motion import joint_speed, tip_speed
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.laws.rotations import Array


def _largest(recording: Recording, samples: Samples, since: float, lasting: float) -> float:
    """Return the largest value in the time after the stop; infinite if there is none."""
    t, y = samples
    start = recording.stopped + since
    inside = (t >= start) & (t <= start + lasting)
    return float(y[inside].max()) if inside.any() else math.inf


def _way(recording: Recording) -> Samples:
    """Return the distance (N,) [mm] of the tip from where it was when it was stopped."""
    arm = recording.measured
    at = min(int(np.searchsorted(arm.t, recording.stopped)), len(arm.t) - 1)
    way: Array = np.linalg.norm(arm.p_e - arm.p_e[at], axis=1)
    return arm.t, 1e3 * way


@metric("mm")
def stop_way(recording: Recording, since: float = 0.0, lasting: float = math.inf) -> float:
    """Largest distance of the stopped tip from where it was when it was stopped."""
    return _largest(recording, _way(recording), since, lasting)


@metric("m/s")
def stop_tip_speed(recording: Recording, since: float = 0.0, lasting: float = math.inf) -> float:
    """Largest speed of the tip after it was stopped."""
    return _largest(recording, tip_speed(recording, "measured"), since, lasting)


@metric("rad/s")
def stop_joint_speed(recording: Recording, since: float = 0.0, lasting: float = math.inf) -> float:
    """Largest joint speed after the arm was stopped."""
    return _largest(recording, joint_speed(recording, "measured"), since, lasting)


@metric("")
def stop_speed_ratio(recording: Recording) -> float:
    """Largest joint speed after the arm was stopped over that before."""
    t, speed = joint_speed(recording, "measured")
    before = float(speed[t <= recording.stopped].max(initial=0.0))
    return quotient(_largest(recording, (t, speed), 0.0, math.inf), before)


@metric("N")
def stop_force(recording: Recording, since: float = 0.0, lasting: float = math.inf) -> float:
    """Largest contact force after the arm was stopped."""
    t, f = force(recording)
    return _largest(recording, (t, np.linalg.norm(f, axis=1)), since, lasting)


@metric("s")
def stop_time(recording: Recording, cause: str = "") -> float:
    """Time at which the arm was stopped.

    With a cause, a key of /diagnostics, when a node first stopped it for that.
    """
    if not cause:
        return recording.stopped
    return min((one.t for one in recording.reports if one.fault == cause), default=math.inf)
