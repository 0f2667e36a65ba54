"""Legs: the parts of a motion, and when one may follow another."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from operator import le

from eulerparams_control.laws.jit import Array, b1, f8, jit, vector
from eulerparams_control.laws.rotations import log, norm
from eulerparams_control.motion.frames import DesiredFrame, apart
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.plan import Sample

# Largest differences of two frames that are the same [m, rad], as fast [m/s, rad/s], and as
# accelerated [m/s^2, rad/s^2].
_SAME = 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 4e-2

# A set-point may be this much beyond what the limits allow from tick to tick: its own rounding.
_MARGIN = 1.05


@dataclass
class Leg:
    """A part of a motion.

    Attributes:
        sample: the frame at a time [s] from its start.
        duration: [s].
        then: the leg that follows the frame at the end.
        held: the frame at which it rests for good; None if it does not.
        expires: when it ends [ns], whatever became of its own time: who sends it is silent.
        end: the leg that follows the frame where it expires.
    """

    sample: Sample
    duration: float = math.inf
    then: Callable[[DesiredFrame], "Leg"] | None = None
    held: DesiredFrame | None = None
    expires: float = math.inf
    end: Callable[[DesiredFrame], "Leg"] | None = None


def resting(frame: DesiredFrame) -> Leg:
    """Return the leg that rests at a frame for good."""
    held = frame.at_rest()
    return Leg(lambda _: held, held=held)


def is_there(here: DesiredFrame, there: DesiredFrame) -> bool:
    """Return whether two frames are the same, and as fast."""
    return all(map(le, apart(here, there), _SAME[:4]))


def is_alike(here: DesiredFrame, there: DesiredFrame) -> bool:
    """Return whether two frames are the same, as fast, and as accelerated."""
    return all(map(le, apart(here, there), _SAME))


def passes(before: DesiredFrame, frame: DesiredFrame, dt: float, limits: MotionLimits) -> bool:
    """Return whether the limits allow a frame dt [s] after the one before."""
    if not dt > 0:
        return False
    p, R, v_0, w_0, a_0, dw_0 = before
    p_d, R_d, v, w, a, dw = frame
    most_p, most_x = limits.by_derivative.T
    is_near = _is_near(p_d - p, v_0, v, a_0, a, dt, most_p)
    return is_near and _is_near(log(R_d @ R.T), w_0, w, dw_0, dw, dt, most_x)


@jit(b1(vector, vector, vector, vector, vector, f8, vector))
def _is_near(
    way: Array, v_0: Array, v: Array, a_0: Array, a: Array, dt: float, most: Array
) -> bool:
    """Return whether speed, acceleration and jerk (3,) allow a way (3,) in dt [s]."""
    half, speed, acceleration, jerk = dt / 2.0, most[0], _MARGIN * most[1], _MARGIN * most[2]
    return (
        norm(v) <= speed
        and norm(a) <= acceleration
        and norm(v - v_0) <= acceleration * dt
        and norm(a - a_0) <= jerk * dt
        and norm(v - v_0 - half * (a + a_0)) <= jerk * dt * dt
        and norm(way - half * (v + v_0)) <= acceleration * dt * half
    )
