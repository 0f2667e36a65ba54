"""The pace: how a motion slows down towards kinematic singularities and joint limits.

At the pace s the time of the desired motion runs s times as fast, along the same path.  What is
said here is how fast it may run; how it gets there is up to :class:`TimeScale`.

    towards a singularity    s = sigma_min / threshold, where sigma_min of J is below it
    away from one            twice that
    at speed towards one     the tip is to be no faster than it can brake before it
    towards a limit          the joint is to be no faster than POSITION_RATE times its distance
    at its speed limit       it is to be no faster than that, which may have been lowered
    where links are fast     no origin of a link is to be faster than max_link_speed

Notation: ``sigma`` smallest singular value of J, ``s`` pace.
"""

import math
from collections.abc import Callable
from enum import Enum, auto

import numpy as np

from eulerparams_control.laws.inverse import sigma_min
from eulerparams_control.laws.jit import Array
from eulerparams_control.laws.limits import POSITION_RATE, JointLimits
from eulerparams_control.motion.motion_limits import MotionLimits

LEAST = 0.1
"""The slowest pace: a motion that comes to a halt would never lead out again."""

CREEP = 1e-3
"""The slowest pace for limits of joint speeds: it is fast enough again as soon as they allow it."""

LOOK = 0.005
"""The arm is looked at again after this time [s]: it goes not far meanwhile."""

# Inside a singularity sigma is below this part of the threshold; a change of it by less than the
# other part, relative to the threshold, is none.
_INNER, _SAME = 0.25, 1e-6

# Towards a singularity the tip comes to rest with this time constant [s], at last.
_STOP_TIME = 0.2

# The pace follows the speed of a link late: it aims at this part of the limit.
_LINK_PART = 0.85

# A joint slower than this [rad/s, m/s] approaches nothing; within this distance [rad, m] of its
# limit it is there, and within the other one it is near.
_SLOW, _AT_LIMIT, _NEAR_LIMIT = 1e-3, 0.01, 0.1


class Nearness(Enum):
    """How the arm is to a singularity or a limit."""

    CLEAR = auto()
    APPROACHING = auto()
    INSIDE = auto()
    LEAVING = auto()


class Pace:
    """The pace of the desired motion, within the limits of the joints and of the tip.

    Below the singular value ``threshold`` of J, whose units ``length`` [m] takes away, it slows
    down; 0 never.  None for limits slows nothing down.

    Attributes:
        wanted: s, from ``LEAST`` to 1; from ``CREEP`` for the limits of the speeds.
        singularity, limit: how near the arm is to a kinematic singularity, to a limit of a joint.
        joint: the index of that joint.
    """

    def __init__(
        self,
        limits: JointLimits | None,
        threshold: float = 0.05,
        length: float = 1.0,
        motion: MotionLimits | None = None,
        max_link_speed: float = math.inf,
        link_speed: Callable[[Array, Array], float] | None = None,
    ) -> None:
        self.limits, self.motion, self.max_link_speed = limits, motion, max_link_speed
        self._link_speed = link_speed  # [m/s] of the fastest one at q, dq (n,)
        self._threshold, self._length = threshold, length
        self.forget()

    def forget(self) -> None:
        """Start again, at full pace."""
        self.wanted, self._since, self._sigma = 1.0, LOOK, math.nan
        self.singularity, self.limit, self.joint = Nearness.CLEAR, Nearness.CLEAR, 0

    def update(self, dt: float, now: float, q: Array, dq: Array, J: Array) -> None:
        """Choose the pace, dt [s] after the last call, if the arm is to be looked at again.

        ``now`` is the pace of now, q, dq (n,) and J (6, n) those at which the loop is closed.
        """
        self._since += dt
        if self._since < LOOK:
            return
        sigma, before, threshold = sigma_min(J, self._length), self._sigma, self._threshold
        near, pace = _nearness(sigma, before, threshold, self.singularity), 1.0
        if near is not Nearness.CLEAR:
            ratio = sigma / threshold
            pace = min(1.0, max(LEAST, 2.0 * ratio if near is Nearness.LEAVING else ratio))
        if self.motion is not None and sigma < before and threshold > 0.0:
            left, v = sigma * self._since / (before - sigma), J @ dq
            for v_part, a in zip((v[:3], v[3:]), self.motion.accelerations, strict=True):
                braked = _by_braking(now, left, math.sqrt(v_part @ v_part), a)
                pace = min(pace, max(LEAST, braked))
        if self.limits is not None:
            slower, self.limit, self.joint = _by_limits(now, q, dq, self.limits)
            pace = min(pace, slower)
        if self._link_speed is not None and math.isfinite(self.max_link_speed):
            ratio = _LINK_PART * self.max_link_speed / max(self._link_speed(q, dq), _SLOW)
            pace = min(pace, max(CREEP, now * ratio))
        self._sigma, self.singularity = sigma, near
        self.wanted, self._since = pace, 0.0


def _nearness(sigma: float, before: float, threshold: float, was: Nearness) -> Nearness:
    """Return how near a singularity is; ``before`` is NaN, or sigma at the last look."""
    if sigma >= threshold:
        return Nearness.CLEAR
    if sigma < _INNER * threshold:
        return Nearness.INSIDE
    if math.isnan(before) or sigma < before - _SAME * threshold:
        return Nearness.APPROACHING
    if sigma > before + _SAME * threshold:
        return Nearness.LEAVING
    return Nearness.APPROACHING if was is Nearness.CLEAR else was


def _by_braking(now: float, left: float, v: float, a: float) -> float:
    """Return the pace at which a part of the tip, at the speed v, stops before a singularity.

    That is v tau / 2 away if sigma, which is 0 in the time tau, ``left``, at the rate at which it
    falls, goes as the root of the distance: so it does at the edge of the workspace.  The speed
    of the tip comes to a distance d by v^2 + a T v = 2 a d: it brakes by a, then by v / T.
    """
    if not (v > 0.0 and math.isfinite(a)):
        return 1.0
    aT = a * _STOP_TIME
    bearable = (math.sqrt(aT * aT + 4.0 * a * v * left) - aT) / 2.0
    return now * bearable / v


def _by_limits(now: float, q: Array, dq: Array, limits: JointLimits) -> tuple[float, Nearness, int]:
    """Return the pace for limits of the joints, and how near which joint is."""
    below, above, speeds = q - limits.lower, limits.upper - q, np.abs(dq)
    room, ahead = np.minimum(above, below), np.where(dq > 0, above, below)
    moving = np.maximum(speeds, _SLOW)
    ratios, by_speed = POSITION_RATE * np.maximum(ahead, 0.0) / moving, limits.velocity / moving
    first, nearest = int(ratios.argmin()), int(room.argmin())
    near, joint, approaches = Nearness.CLEAR, nearest, speeds[first] > _SLOW
    if room[nearest] < _AT_LIMIT:
        near = Nearness.INSIDE
    elif approaches and ratios[first] < 1:
        near, joint = Nearness.APPROACHING, first
    elif room[nearest] < min(ahead[nearest], _NEAR_LIMIT) and speeds[nearest] > _SLOW:
        near = Nearness.LEAVING
    if speeds.max() <= _SLOW:
        return 1.0, near, joint
    by_position = max(LEAST, now * ratios[first]) if approaches else 1.0
    return float(min(1.0, by_position, max(CREEP, now * by_speed.min()))), near, joint
