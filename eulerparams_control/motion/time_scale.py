"""How fast the time of a motion runs: it halts and goes on along its path, within the limits.

At the rate u the tip has the acceleration u^2 a + du v, where v and a are those of the motion as
planned.  du is bounded by what u^2 a leaves of the limit, its change by the jerk.

Notation: ``u`` rate of time, ``du`` [1/s] its change.
"""

import math

from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits

# u changes by no more than this [1/s], du by no more than that [1/s^2], where the tip is slow.
_MOST_RATE, _MOST_CHANGE = 10.0, 200.0

# Of the acceleration it takes this part: a law of finite rate adds to it where it changes.
_OF_ACCELERATION = 0.9

# Of the acceleration a brake gets this part, whatever the motion takes.
_AT_LEAST = 0.6

# Of the jerk du gets this part; the rest is the motion's own.
_OF_THE_JERK = 0.7

# Braking begins early by this part, since du ends with a jerk of its own.
_EARLY = 0.8


class TimeScale:
    """The rate of time.

    Args:
        limits: of the tip; None: u changes by the plain rates.

    Attributes:
        now: u, from 0 to 1.
        rate: du [1/s].
    """

    def __init__(self, limits: MotionLimits | None) -> None:
        self.limits = limits
        self.now, self.rate = 1.0, 0.0

    def forget(self, now: float = 1.0) -> None:
        """Start again at a rate; nothing moves."""
        self.now, self.rate = now, 0.0

    def update(self, dt: float, wanted: float, planned: DesiredFrame) -> None:
        """Go towards a rate.

        Args:
            dt: [s] of the step.
            wanted: rate of time, from 0 to 1.
            planned: the frame of the motion as planned, at u = 1.
        """
        if (self.now == wanted and self.rate == 0.0) or dt <= 0:
            return
        low, high, change = self._bounds(planned)
        away = wanted - self.now
        ideal = math.copysign(math.sqrt(2 * _EARLY * change * abs(away)), away)
        ideal = min(max(ideal, low), high)
        self.rate += min(max(ideal - self.rate, -change * dt), change * dt)
        after = self.now + self.rate * dt
        if (after - wanted) * away >= 0 and abs(self.rate) <= 2 * change * dt:
            self.now, self.rate = wanted, 0.0  # it is there
        else:
            self.now = min(max(after, 0.0), 1.0)

    def _bounds(self, planned: DesiredFrame) -> tuple[float, float, float]:
        """Return the least and the largest du, and by how much it may change [1/s^2]."""
        low, high, change = -_MOST_RATE, _MOST_RATE, _MOST_CHANGE
        if self.limits is None:
            return low, high, change
        for v, a, most, jerk in zip(
            (planned.dp_d, planned.omega_d),
            (planned.ddp_d, planned.domega_d),
            (_OF_ACCELERATION * most for most in self.limits.accelerations),
            self.limits.jerks,
            strict=True,
        ):
            least, largest, speed = _interval(v, self.now**2 * a, most)
            if speed > 0:
                # to brake lowers u^2 a, too: it is possible where that is beyond the limit
                least, largest = min(least, -_AT_LEAST * most / speed), max(largest, 0.0)
                low, high = max(low, least), min(high, largest)
                change = min(change, _OF_THE_JERK * jerk / speed)
        return low, high, change


def _interval(v: Array, a: Array, most: float) -> tuple[float, float, float]:
    """Return between which du |a + du v| is at most ``most``, and |v|."""
    vv, av = float(v @ v), float(a @ v)
    if vv == 0.0 or not math.isfinite(most):
        return -math.inf, math.inf, math.sqrt(vv)
    root = math.sqrt(max(av * av - vv * (float(a @ a) - most * most), 0.0))
    return (-av - root) / vv, (-av + root) / vv, math.sqrt(vv)
