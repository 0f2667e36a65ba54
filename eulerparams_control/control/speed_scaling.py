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

from eulerparams_control.laws.compiled import Input, Row, Rows, entry
from eulerparams_control.laws.inverse import smallest_singular_value
from eulerparams_control.laws.limits import POSITION_RATE, JointLimits
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.motion_limits import MotionLimits

LEAST = 0.1
"""The slowest pace: a motion that comes to a halt would never lead out again."""

CREEP = 1e-3
"""The slowest pace for limits of joint speeds: it is fast enough again as soon as they allow it."""

# The arm is looked at again after this time [s]: it goes not far meanwhile.
_LOOK = 0.005

# Inside a singularity sigma is below this part of the threshold; a change of it by less than the
# other part, relative to the threshold, is none.
_INSIDE, _SAME = 0.25, 1e-6

# Towards a singularity the tip comes to rest with this time constant [s], at last.
_STOP_TIME = 0.2

# A joint slower than this [rad/s, m/s] approaches nothing; within this distance [rad, m] of its
# limit it is there, and within the other one it is near.
_SLOW, _AT_LIMIT, _NEAR_LIMIT = 1e-3, 0.01, 0.1

# Rows of the limits.
_LOWER, _UPPER, _VELOCITY = range(3)


class Nearness(IntEnum):
    """How the arm is to a singularity or a limit."""

    CLEAR = 0
    APPROACHING = 1
    INSIDE = 2
    LEAVING = 3


class SpeedScaling:
    """The pace of the desired motion.

    Args:
        limits: of the joints; None slows nothing down.
        threshold: singular value below which the motion slows down; 0 never.
        length: characteristic length of the arm [m], by which J is without units.
        motion: limits of the tip, within which it brakes before a singularity; None: it does not.

    Attributes:
        wanted: s, from ``LEAST`` to 1; from ``CREEP`` for the limits of the speeds.
        singularity: how near the arm is to a kinematic singularity.
        limit: how near it is to a limit of a joint, and ``joint``: the index of which.
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
        self.wanted = 1.0
        self.singularity = self.limit = Nearness.CLEAR
        self.joint = 0
        self._near = np.zeros(2)
        self._sigma: float | None = None
        self._left = math.inf  # [s] until sigma is 0, as it falls now
        self._since = _LOOK

    def advance(self, dt: float) -> bool:
        """Let dt [s] go by; return whether the arm is to be looked at again."""
        self._since += dt
        return self._since >= _LOOK

    def update(self, now: float, q: Array, dq: Array, J: Array) -> None:
        """Choose the pace for the steps until it is due again.

        Args:
            now: s.
            q, dq: (n,) positions and velocities at which the loop is closed.
            J: (6, n) there.
        """
        self._look_at_singularity(J)
        self._since = 0.0
        self.wanted = min(
            self._by_singularity(), self._by_braking(now, J, dq), self._by_limits(now, q, dq)
        )

    def _look_at_singularity(self, J: Array) -> None:
        """Say how near the singularity is, and whether it comes nearer."""
        sigma, before = smallest_singular_value(J, self._length), self._sigma
        self._sigma = sigma
        self._left = math.inf
        if before is not None and sigma < before and self.threshold > 0:
            self._left = sigma * self._since / (before - sigma)
        if sigma >= self.threshold:
            self.singularity = Nearness.CLEAR
        elif sigma < _INSIDE * self.threshold:
            self.singularity = Nearness.INSIDE
        elif before is None or sigma < before - _SAME * self.threshold:
            self.singularity = Nearness.APPROACHING
        elif sigma > before + _SAME * self.threshold:
            self.singularity = Nearness.LEAVING
        elif self.singularity is Nearness.CLEAR:
            self.singularity = Nearness.APPROACHING

    def _by_singularity(self) -> float:
        if self.singularity is Nearness.CLEAR or self._sigma is None:
            return 1.0
        ratio = self._sigma / self.threshold
        return min(1.0, max(LEAST, 2 * ratio if self.singularity is Nearness.LEAVING else ratio))

    def _by_braking(self, now: float, J: Array, dq: Array) -> float:
        """Return the pace at which the tip, at v = J dq, can stop before a singularity.

        That is v tau / 2 away if sigma, which is 0 in the time tau at the rate at which it falls,
        goes as the root of the distance: so it does at the edge of the workspace.  The speed of
        the tip comes to a distance d by v^2 + a T v = 2 a d: it brakes by a, then by v / T.
        """
        if self.motion is None or self._left == math.inf:
            return 1.0
        pace, v = 1.0, J @ dq
        for part, a in zip((v[:3], v[3:]), self.motion.accelerations, strict=True):
            speed, aT = math.sqrt(part @ part), a * _STOP_TIME
            if speed > 0 and math.isfinite(a):
                bearable = (math.sqrt(aT**2 + 4 * a * speed * self._left) - aT) / 2
                pace = min(pace, now * bearable / speed)
        return max(LEAST, pace)

    def _by_limits(self, now: float, q: Array, dq: Array) -> float:
        """Return the pace at which no joint is faster than it may be so near to its limit."""
        self.limit, near, pace = Nearness.CLEAR, self._near, 1.0
        if self.limits is not None:
            pace = float(_pace_of_limits(now, q, dq, self.limits.rows, near))
            self.limit, self.joint = Nearness(int(near[0])), int(near[1])
        return pace


@entry
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
    near[0], near[1] = Nearness.CLEAR.value, nearest
    if least < _AT_LIMIT:
        near[0] = Nearness.INSIDE.value
    elif abs(dq[first]) > _SLOW and ratio < 1:
        near[0], near[1] = Nearness.APPROACHING.value, first
    elif least < _NEAR_LIMIT and leaves:
        near[0] = Nearness.LEAVING.value
    if fastest <= _SLOW:
        return 1.0
    by_position = max(LEAST, now * ratio) if abs(dq[first]) > _SLOW else 1.0
    pace: float = min(1.0, min(by_position, max(CREEP, now * by_speed)))
    return pace
