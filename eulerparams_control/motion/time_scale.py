"""The rate of time of a motion: it halts and goes on along its path, within the limits.

At the rate u the tip has the acceleration u^2 a + du v, where v and a are those of the motion as
planned.  du is bounded by what u^2 a leaves of the limit, and by the jerk of the sum.

Notation: ``u`` rate of time, ``du`` [1/s] its change.
"""

import math

from eulerparams_control.laws.jit import Array
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.plan import Sample

# u changes by no more than this [1/s], du by no more than that [1/s^2], where the tip is slow.
_MOST_RATE, _MOST_CHANGE = 10.0, 200.0

# A rate is reached within this.
_SAME = 1e-9

# Of the acceleration it takes this part: a law of finite rate adds to it where it changes.
_OF_ACCELERATION = 0.9

# Of the acceleration a brake gets this part, whatever the motion takes.
_AT_LEAST = 0.54

# du comes to its end with this part of the jerk that the motion leaves at the rate wanted; it gets
# the other part of the whole jerk, whatever the motion takes.
_TO_THE_END, _LEAST_JERK = 0.9, 0.1


class TimeScale:
    """The rate of time.

    Args:
        limits: of the tip; None: u changes by the plain rates.

    Attributes:
        now: u, from 0 to 1.
        rate: du [1/s], until the next step.
        mean: of u in the last step.
        before: the frame at the last step; None after a start.
    """

    def __init__(self, limits: MotionLimits | None) -> None:
        self.limits = limits
        self.forget()

    def forget(self, now: float = 1.0) -> None:
        """Start again at a rate; nothing moves."""
        self.now = self.mean = now
        self.rate = 0.0
        self.before: DesiredFrame | None = None

    def advance(self, dt: float) -> None:
        """Let dt [s] go by."""
        self.mean = before = self.now
        if self.rate:
            self.now = min(max(before + self.rate * dt, 0.0), 1.0)
            self.mean = (before + self.now) / 2

    def paced(self, dt: float, wanted: float, planned: DesiredFrame, after: Sample) -> DesiredFrame:
        """Choose du, and return the frame at this pace.

        Args:
            dt: [s] of a step.
            wanted: rate of time to go to, from 0 to 1.
            planned: the frame as planned, at u = 1.
            after: the same, this many seconds of its own time later.
        """
        if abs(wanted - self.now) < _SAME:
            self.now = wanted
        if (self.now != wanted or self.rate) and dt > 0:
            self.rate = self._chosen(dt, wanted, planned, after(self.now * dt))
        self.before = paced = planned.at_pace(self.now, self.rate)
        return paced

    def _chosen(
        self, dt: float, wanted: float, planned: DesiredFrame, later: DesiredFrame
    ) -> float:
        """Return the du which falls in equal steps until the rate wanted, within the bounds."""
        low, high, change = -_MOST_RATE, _MOST_RATE, _MOST_CHANGE
        least, most = -change * dt, change * dt  # of the step of du
        limits = self.limits or MotionLimits()
        now, then = planned.at_pace(self.now, 0.0), later.at_pace(self.now, 0.0)
        before = now.moved(-dt) if self.before is None else self.before
        for v, (v_0, a_0), (v_1, a_1), (v_2, _), most_a, jerk in zip(
            (planned.dp_d, planned.omega_d),
            *(_rates(frame) for frame in (before, now, then)),
            limits.accelerations,
            limits.jerks,
            strict=True,
        ):
            speed = math.sqrt(v @ v)
            if speed == 0:
                continue
            a, b = _interval(v, a_1, _OF_ACCELERATION * most_a)
            # to brake lowers u^2 a, too: it is possible where that is beyond the limit
            low, high = max(low, min(a, -_AT_LEAST * most_a / speed)), min(high, max(b, 0.0))
            part = max(_LEAST_JERK, _TO_THE_END * (1 - wanted**3))
            change = min(change, part * jerk / speed)
            kept = _LEAST_JERK * jerk / speed * dt
            for da in (a_1 - a_0, (v_2 - 2 * v_1 + v_0) / dt):  # of the instant, and of the step
                a, b = _interval(v, da + self.rate * v, jerk * dt)
                least, most = max(least, min(a, -kept)), min(most, max(b, kept))
        away, step = abs(wanted - self.now), change * dt
        whole = math.floor(math.sqrt(2 * away / (step * dt) + 0.25) - 0.5)  # of the steps
        ideal = math.copysign(whole / 2 * step + away / ((whole + 1) * dt), wanted - self.now)
        return self.rate + min(max(min(max(ideal, low), high) - self.rate, least), most)


def _rates(frame: DesiredFrame) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return velocity and acceleration (3,) of the point and of the turning."""
    return (frame.dp_d, frame.ddp_d), (frame.omega_d, frame.domega_d)


def _interval(v: Array, a: Array, most: float) -> tuple[float, float]:
    """Return between which du |a + du v| is at most ``most``; v is not 0."""
    if not math.isfinite(most):
        return -math.inf, math.inf
    vv, av = float(v @ v), float(a @ v)
    root = math.sqrt(max(av * av - vv * (float(a @ a) - most * most), 0.0))
    return (-av - root) / vv, (-av + root) / vv
