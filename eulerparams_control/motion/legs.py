"""Legs: the parts of a motion, and when one may follow another."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from eulerparams_control.laws.rotations import Array, log
from eulerparams_control.motion.frames import DesiredFrame, distance
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.plan import Sample

# A motion within so much [m, rad; m/s, rad/s] of the state is there; [m/s^2, rad/s^2] it begins.
_SAME, _SAME_ACCELERATION = ((1e-6, 1e-5), (1e-4, 1e-3)), (1e-2, 4e-2)

# A set-point may be this much beyond what the limits allow from tick to tick: its own rounding.
_MARGIN = 1.05


@dataclass
class Leg:
    """A part of a motion.

    Attributes:
        sample: the frame at a time [s] from its start.
        duration: [s].
        then: the leg that follows the frame at the end.
        is_held: whether it rests for good.
        expires: when it ends [ns], whatever became of its own time: who sends it is silent.
        end: the leg that follows the frame where it expires.
    """

    sample: Sample
    duration: float = math.inf
    then: Callable[[DesiredFrame], "Leg"] | None = None
    is_held: bool = False
    expires: float = math.inf
    end: Callable[[DesiredFrame], "Leg"] | None = None

def resting(frame: DesiredFrame) -> Leg:
    """Return the leg that rests at a frame for good."""
    held = frame.at_rest()
    return Leg(lambda _: held, is_held=True)


def _norm(v: Array) -> float:
    return math.sqrt(v @ v)


def is_there(here: DesiredFrame, there: DesiredFrame) -> bool:
    """Return whether two frames are the same, and as fast."""
    ways = (
        distance(here, there),
        (_norm(here.dp_d - there.dp_d), _norm(here.omega_d - there.omega_d)),
    )
    return all(
        way <= most
        for pair, bounds in zip(ways, _SAME, strict=True)
        for way, most in zip(pair, bounds, strict=True)
    )


def is_alike(here: DesiredFrame, there: DesiredFrame) -> bool:
    """Return whether two frames are the same, as fast, and as accelerated."""
    ways = _norm(here.ddp_d - there.ddp_d), _norm(here.domega_d - there.domega_d)
    return is_there(here, there) and all(
        way <= most for way, most in zip(ways, _SAME_ACCELERATION, strict=True)
    )


def bounded(frame: DesiredFrame, limits: MotionLimits) -> DesiredFrame:
    """Return the frame with a twist, and no acceleration, within the limits."""
    dp_d, omega_d = (
        v if _norm(v) <= most else most / _norm(v) * v
        for v, most in zip((frame.dp_d, frame.omega_d), limits.speeds, strict=True)
    )
    return DesiredFrame(frame.p_d, frame.R_d, dp_d, omega_d)


def passes(before: DesiredFrame, frame: DesiredFrame, dt: float, limits: MotionLimits) -> bool:
    """Return whether the limits allow a frame dt [s] after the one before."""
    if not dt > 0:
        return False
    ways = frame.p_d - before.p_d, log(frame.R_d @ before.R_d.T)
    return all(
        _norm(v) <= speed
        and _norm(a) <= _MARGIN * most
        and _norm(v - v_0) <= _MARGIN * most * dt
        and _norm(a - a_0) <= _MARGIN * jerk * dt
        and _norm(v - v_0 - dt / 2 * (a + a_0)) <= _MARGIN * jerk * dt**2
        and _norm(way - dt / 2 * (v + v_0)) <= _MARGIN * most * dt**2 / 2
        for way, v, v_0, a, a_0, speed, most, jerk in zip(
            ways,
            (frame.dp_d, frame.omega_d),
            (before.dp_d, before.omega_d),
            (frame.ddp_d, frame.domega_d),
            (before.ddp_d, before.domega_d),
            limits.speeds,
            limits.accelerations,
            limits.jerks,
            strict=True,
        )
    )
