"""Legs: the parts of a motion, and when one may follow another."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from eulerparams_control.laws._old.compiled import formula
from eulerparams_control.laws._old.linear import Vec, norm
from eulerparams_control.laws._old.rotations import log
from eulerparams_control.motion.frames import DesiredFrame, apart
from eulerparams_control.motion.motion_limits import MotionLimits, TipLimits
from eulerparams_control.motion.plan import Sample, bounded

__all__ = ["bounded"]

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
    return _within(here, there, _SAME[:4])


def is_alike(here: DesiredFrame, there: DesiredFrame) -> bool:
    """Return whether two frames are the same, as fast, and as accelerated."""
    return _within(here, there, _SAME)


def _within(here: DesiredFrame, there: DesiredFrame, bounds: tuple[float, ...]) -> bool:
    ways = apart.row(*here, *there).tolist()
    return all(way <= most for way, most in zip(ways, bounds, strict=False))


def passes(before: DesiredFrame, frame: DesiredFrame, dt: float, limits: MotionLimits) -> bool:
    """Return whether the limits allow a frame dt [s] after the one before."""
    return dt > 0 and bool(are_near.row(*before, *frame, dt, limits.row)[0])


@formula
def are_near(a: DesiredFrame, b: DesiredFrame, dt: float, most: TipLimits) -> bool:
    """Return whether limits allow a frame dt [s] after the one before."""
    return _is_near(
        b.p_d - a.p_d, a.dp_d, b.dp_d, a.ddp_d, b.ddp_d,
        dt, most.linear_speed, most.linear_acceleration, most.linear_jerk,
    ) and _is_near(
        log(b.R_d @ a.R_d.T), a.omega_d, b.omega_d, a.domega_d, b.domega_d,
        dt, most.angular_speed, most.angular_acceleration, most.angular_jerk,
    )  # fmt: skip


@formula
def _is_near(
    way: Vec, v_0: Vec, v: Vec, a_0: Vec, a: Vec, dt: float, speed: float, most: float, jerk: float
) -> bool:
    half, most, jerk = dt / 2.0, _MARGIN * most, _MARGIN * jerk
    return (
        norm(v) <= speed
        and norm(a) <= most
        and norm(v - v_0) <= most * dt
        and norm(a - a_0) <= jerk * dt
        and norm(v - v_0 - half * (a + a_0)) <= jerk * dt * dt
        and norm(way - half * (v + v_0)) <= most * dt * half
    )


are_near.prepare()
