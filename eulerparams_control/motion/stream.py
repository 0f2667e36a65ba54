"""A stream of set-points: where it is, how fast it goes, how regularly it comes.

Set-points come with noise and jitter.  An alpha-beta filter (Kalata, 1984) tells position and
speed of those without a twist; those with one need no estimate of the speed.  What the
interval between two of them has to do with the rate of the filter is its time constant T_f:

    theta = exp(-T / T_f),  alpha = 1 - theta^2,  beta = (1 - theta)^2
"""

import math

from eulerparams_control.laws.rotations import exp, log, norm, product
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits

# Time constants [s] of the filter for poses alone, and for those with a twist.
_POSES, _TWISTS = 0.05, 0.1

# Pause [s] after which a set-point begins a stream, or is a goal.
PAUSE = 0.6

# Part of the difference by which the interval follows further ones, and the factor of its jitter.
_SMOOTHING, _JITTER = 0.2, 2.0


class StreamFilter:
    """What is known of a stream of set-points.

    Attributes:
        frame: pose and twist of now, filtered, at ``at``.
        last: the set-point that came last, as it came.
        at: [s] when that was, by the time of the source.
        interval: [s] between two of them; 0 while there is one only.
        has_twists: whether they come with twists.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Let the next set-point be the first."""
        self.frame: DesiredFrame | None = None
        self.last: DesiredFrame | None = None
        self.at = -math.inf
        self.interval = self._jitter = 0.0
        self.has_twists = False

    @property
    def next_within(self) -> float:
        """Time [s] within which the next set-point is to be expected; 0 if none is."""
        return self.interval + _JITTER * self._jitter

    def take(self, frame: DesiredFrame, at: float, limits: MotionLimits) -> None:
        """Take a set-point.

        Args:
            frame: pose, and twist if it has one.
            at: [s] by the time of the source.
            limits: a stream that is faster leaps: its next set-point is the first again.
        """
        T = at - self.at
        if self.frame is None or not 0 < T < PAUSE:
            self.forget()
        self.has_twists |= frame.moves
        before, self.last, self.at = self.frame, frame, at
        if before is None:
            self.frame = frame
            return
        self._time(T)
        self.frame = _filtered(before, frame, T, self.has_twists, limits.speeds)

    def _time(self, T: float) -> None:
        if self.interval == 0.0:
            self.interval = T
        self._jitter += _SMOOTHING * (abs(T - self.interval) - self._jitter)
        self.interval += _SMOOTHING * (T - self.interval)


def _filtered(
    before: DesiredFrame,
    frame: DesiredFrame,
    T: float,
    has_twists: bool,
    speeds: tuple[float, float],
) -> DesiredFrame:
    """Return the stream at a set-point T [s] after the one before; itself if it leaps."""
    expected = before.moved(T)
    e_p, e_R = frame.p_d - expected.p_d, log(product(expected.R_d.T, frame.R_d))
    alpha, dp_d, omega_d = 1 - math.exp(-T / _TWISTS), frame.dp_d, frame.omega_d
    if not has_twists:
        most = T + 2 * _POSES
        if norm(e_p) > most * speeds[0] or norm(e_R) > most * speeds[1]:
            return frame
        theta = math.exp(-T / _POSES)
        alpha, beta = 1 - theta**2, (1 - theta) ** 2
        dp_d = before.dp_d + beta / T * e_p
        omega_d = before.omega_d + beta / T * (expected.R_d @ e_R)
    return DesiredFrame(
        expected.p_d + alpha * e_p,
        expected.R_d @ exp(alpha * e_R),
        dp_d,
        omega_d,
        frame.ddp_d,
        frame.domega_d,
    )
