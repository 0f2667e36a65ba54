"""The pace: how a motion slows down towards kinematic singularities and joint limits.

The desired motion goes on along its path, but later: at the pace s its time runs s times as
fast.  Nothing is stopped where the damped inverse and the limits suffice.  What is said here is
how fast it may run; how it gets there is up to :class:`TimeScale`.

    towards a singularity    s = sigma_min / threshold, where sigma_min of J is below it
    away from one            twice that
    at speed towards one     the tip is to be no faster than it can brake before it
    towards a limit          the joint is to be no faster than POSITION_RATE times its distance
    at its speed limit       it is to be no faster than that, which may have been lowered

Notation: ``sigma`` smallest singular value of J, ``s`` pace.
"""

import math
from enum import IntEnum

import numpy as np

from eulerparams_control.laws._old.compiled import NONE, Input, Inputs, Row, Rows, entry, kernel
from eulerparams_control.laws.inverse import sigma_min
from eulerparams_control.laws.limits import POSITION_RATE, UNLIMITED, JointLimits
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.motion_limits import MotionLimits

LEAST = 0.1
"""The slowest pace: a motion that comes to a halt would never lead out again."""

CREEP = 1e-3
"""The slowest pace for limits of joint speeds: it is fast enough again as soon as they allow it."""

LOOK = 0.005
"""The arm is looked at again after this time [s]: it goes not far meanwhile."""

# Inside a singularity sigma is below this part of the threshold; a change of it by less than the
# other part, relative to the threshold, is none.
_INSIDE, _SAME = 0.25, 1e-6

# Towards a singularity the tip comes to rest with this time constant [s], at last.
_STOP_TIME = 0.2

# A joint slower than this [rad/s, m/s] approaches nothing; within this distance [rad, m] of its
# limit it is there, and within the other one it is near.
_SLOW, _AT_LIMIT, _NEAR_LIMIT = 1e-3, 0.01, 0.1

# Rows of the limits, and the row of the pace.
_LOWER, _UPPER, _VELOCITY = range(3)
_WANTED, _SIGMA, _SINGULARITY, _LIMIT, _JOINT = range(5)


class Nearness(IntEnum):
    """How the arm is to a singularity or a limit."""

    CLEAR = 0
    APPROACHING = 1
    INSIDE = 2
    LEAVING = 3


_CLEAR, _APPROACHES, _IS_INSIDE, _LEAVES = (float(near) for near in Nearness)


class SpeedScaling:
    """The pace of the desired motion.

    Args:
        limits: of the joints; None slows nothing down.
        threshold: singular value below which the motion slows down; 0 never.
        length: characteristic length of the arm [m], by which J is without units.
        motion: limits of the tip, within which it brakes before a singularity; None: it does not.

    Attributes:
        wanted: s, from ``LEAST`` to 1; from ``CREEP`` for the limits of the speeds.
        since: [s] since the arm was looked at; it is due again after ``LOOK``.
    """

    def __init__(
        self,
        limits: JointLimits | None,
        threshold: float = 0.05,
        length: float = 1.0,
        motion: MotionLimits | None = None,
    ) -> None:
        self.limits, self.threshold, self._length = limits, threshold, length
        self.motion = motion
        self.forget()

    def forget(self) -> None:
        """Start again, at full pace."""
        self.wanted, self.since = 1.0, LOOK
        self._row = np.array([1.0, math.nan, _CLEAR, _CLEAR, 0.0])

    def update(self, now: float, q: Array, dq: Array, J: Array) -> None:
        """Choose the pace for the steps until it is due again.

        Args:
            now: s.
            q, dq: (n,) positions and velocities at which the loop is closed.
            J: (6, n) there.
        """
        limits = UNLIMITED if self.limits is None else self.limits.rows
        most = NONE if self.motion is None else self.motion.row
        look(now, self.since, q, dq, J, self.threshold, self._length, limits, most, self._row)
        self.wanted, self.since = self._row.item(_WANTED), 0.0

    @property
    def singularity(self) -> Nearness:
        """How near the arm is to a kinematic singularity."""
        return Nearness(int(self._row[_SINGULARITY]))

    @property
    def limit(self) -> Nearness:
        """How near it is to a limit of a joint."""
        return Nearness(int(self._row[_LIMIT]))

    @property
    def joint(self) -> int:
        """The index of the joint that is near its limit."""
        return int(self._row[_JOINT])


# --- the formulas ---------------------------------------------------------------------------


@kernel
def _nearness(sigma: float, before: float, threshold: float, was: float) -> float:
    """Return how near a singularity is; ``before`` is NaN, or sigma at the last look."""
    if sigma >= threshold:
        return _CLEAR
    if sigma < _INSIDE * threshold:
        return _IS_INSIDE
    if math.isnan(before) or sigma < before - _SAME * threshold:
        return _APPROACHES
    if sigma > before + _SAME * threshold:
        return _LEAVES
    return _APPROACHES if was == _CLEAR else was


@kernel
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


@kernel
def _pace_of_limits(now: float, q: Input, dq: Input, limits: Rows, near: Row) -> float:
    """Return the pace for limits of the joints; fill ``near`` (2,): how near which joint is."""
    first, ratio, by_speed, fastest, nearest, least = 0, math.inf, math.inf, 0.0, 0, math.inf
    for i in range(len(q)):
        below, above, speed = q[i] - limits[_LOWER, i], limits[_UPPER, i] - q[i], abs(dq[i])
        room, ahead = min(above, below), above if dq[i] > 0 else below
        rate = POSITION_RATE * max(ahead, 0.0) / max(speed, _SLOW)
        if rate < ratio:
            first, ratio = i, rate
        if room < least:
            nearest, least, leaves = i, room, ahead > room and speed > _SLOW
        by_speed = min(by_speed, limits[_VELOCITY, i] / max(speed, _SLOW))
        fastest = max(fastest, speed)
    near[0], near[1] = _CLEAR, nearest
    if least < _AT_LIMIT:
        near[0] = _IS_INSIDE
    elif abs(dq[first]) > _SLOW and ratio < 1:
        near[0], near[1] = _APPROACHES, first
    elif least < _NEAR_LIMIT and leaves:
        near[0] = _LEAVES
    if fastest <= _SLOW:
        return 1.0
    by_position = max(LEAST, now * ratio) if abs(dq[first]) > _SLOW else 1.0
    pace: float = min(1.0, min(by_position, max(CREEP, now * by_speed)))
    return pace


@entry
def look(
    now: float, since: float, q: Input, dq: Input, J: Inputs, threshold: float, length: float,
    limits: Rows, most: Input, row: Row,
) -> None:  # fmt: skip
    """Fill the row of the pace: what is wanted, and how near the arm is to what.

    Args:
        now: s.
        since: [s] since the last look.
        q, dq, J: of the arm.
        threshold, length: of sigma.
        limits: rows of the joints, or none.
        most: limits of the tip, as :attr:`MotionLimits.row`; none: it does not brake.
        row: is filled.
    """
    sigma, before, left, pace = sigma_min(J, length), row[_SIGMA], math.inf, 1.0
    if sigma < before and threshold > 0.0:
        left = sigma * since / (before - sigma)
    near = _nearness(sigma, before, threshold, row[_SINGULARITY])
    row[_SIGMA], row[_SINGULARITY] = sigma, near
    if near != _CLEAR:
        ratio = sigma / threshold
        pace = min(1.0, max(LEAST, 2.0 * ratio if near == _LEAVES else ratio))
    if len(most) > 0 and left < math.inf:
        braked = 1.0
        for part in range(2):
            square = 0.0
            for i in range(3 * part, 3 * part + 3):
                v = 0.0
                for k in range(len(dq)):
                    v += J[i, k] * dq[k]
                square += v * v
            braked = min(braked, _by_braking(now, left, math.sqrt(square), most[2 + part]))
        pace = min(pace, max(LEAST, braked))
    row[_LIMIT] = _CLEAR
    if limits.shape[1] > 0:
        pace = min(pace, _pace_of_limits(now, q, dq, limits, row[_LIMIT:]))
    row[_WANTED] = pace
