"""A trajectory that is too fast goes slower along its own path: time gives way, not geometry.

Its time runs at the rate s(tau) <= 1, which is smooth, and 1 where the trajectory is slow enough:

    dp = s dp_d,  ddp = s^2 ddp_d + s s' dp_d        s' = ds / dtau

and likewise for the rotation.  s follows from the speed, acceleration and jerk along the
trajectory: the least of its surroundings, averaged, so that it changes slowly.
"""

import numpy as np

from eulerparams_control.laws.compiled import Array, Row, Rows, entry
from eulerparams_control.motion.frames import DesiredFrame, at_pace, put_frame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.trajectories import (
    Trajectory,
    polynomial,
    quintic,
    sampled,
)

# A trajectory is checked at its points, between them, and at a number of places a second; the
# smallest and the largest number of places.
_RATE, _FEWEST, _MOST = 200.0, 60, 4000

# Where a segment is looked at: its jerk is largest at its ends, its acceleration near the second
# and the fourth.  Where there are many points their distance is short, and the middle will do.
_PARTS, _MANY = (0.02, 0.2, 0.5, 0.8, 0.98), 2000

# Rounding, and how far [of the limits] a slowed trajectory may be from its limits.
_ROUNDING, _TOLERANCE, _TRIALS = 1e-6, 0.01, 12

# Shortest trajectory [s]; a shorter one is stretched to it first.
_SHORTEST = 1e-3

# The slowest rate.
_SLOWEST = 1e-3

# Time of a change from one rate to another, as a multiple of the time from rest to full speed.
_SURROUNDINGS = 4.0


class Dilated:
    """A trajectory whose time runs slower.

    Attributes:
        trajectory: as it was asked for.
        duration: [s] that it takes.
        slowest: the least rate of its time.
    """

    def __init__(self, trajectory: Trajectory, tau: Array, s: Array) -> None:
        self.trajectory, self.slowest = trajectory, float(s.min())
        steps = np.diff(tau) / ((s[1:] + s[:-1]) / 2)
        times = np.concatenate(([0.0], np.cumsum(steps)))
        rates = s * np.gradient(s, tau)
        self._times, self._rows = times, np.column_stack((tau, s, rates))
        self.duration = float(times[-1])

    def time_at(self, tau: float) -> float:
        """Return the time [s] at which the trajectory is as it was asked to be at tau [s]."""
        return float(np.interp(tau, self._rows[:, 0], self._times))

    def sample(self, t: float) -> DesiredFrame:
        """Return the desired frame at t [s]."""
        if t >= self.duration:
            tau, s, ds = self._rows[-1].tolist()
            end = self.trajectory.sample(tau)
            return end.at_rest() if t > self.duration else end.at_pace(s, ds)
        row = np.empty(24)
        _sample(self._times, self._rows, *self.trajectory.segments, t, row)
        return DesiredFrame.of(row)


@entry
def _sample(times: Row, rows: Rows, points: Row, segments: Rows, t: float, row: Row) -> None:
    k = max(int(np.searchsorted(times, t, side="right")) - 1, 0)
    (x_0, v_0, a_0), (x_1, v_1, a_1) = rows[k], rows[k + 1]
    c = quintic(x_0, v_0, a_0, x_1, v_1, a_1, times[k + 1] - times[k])
    tau, s, ds = polynomial(c, max(t - times[k], 0.0))
    put_frame(row, 0, at_pace(sampled(points, segments, tau), s, ds))


def within(trajectory: Trajectory, limits: MotionLimits) -> Trajectory | Dilated:
    """Return a trajectory within the limits: the same one if it is."""
    begin, end = trajectory.times[0], trajectory.times[-1]
    if len(trajectory.times) == 1:
        return trajectory
    if end - begin < _SHORTEST:
        return within(trajectory.lasting(_SHORTEST), limits)
    count = int(min(max((end - begin) * _RATE, _FEWEST), _MOST))
    tau, points = np.linspace(begin, end, count + 1), np.array(trajectory.times)
    parts = _PARTS if len(points) < _MANY else (0.5,)
    between = (points[:-1] + np.diff(points) * part for part in parts)
    fine = np.unique(np.round(np.concatenate((tau, points, *between)), 9))
    most = limits.row.reshape(3, 2)
    rates = _rates(trajectory, fine)
    used = _used(fine, np.ones(len(fine)), *rates, most)
    if used.max() <= 1 + _ROUNDING:
        return trajectory
    wide = _SURROUNDINGS * float((most[0] / most[1]).max())
    half = min(max(int(wide / (tau[1] - tau[0]) / 2), 1), count)
    powers_of_s = np.array([1.0, 2.0, 3.0])[:, None]
    borne = np.clip((used ** (-1 / powers_of_s)).min(axis=0), _SLOWEST, 1.0)
    place = np.searchsorted(tau, fine, side="right") - 1
    for _ in range(_TRIALS):
        s = np.ones(len(tau))
        for neighbour in (place, np.minimum(place + 1, count)):
            np.minimum.at(s, neighbour, borne)
        s = _smooth(s, half)
        at_fine = np.interp(fine, tau, s)
        excess = _used(fine, at_fine, *rates, most)
        if excess.max() <= 1 + _TOLERANCE:
            break
        slower = (np.maximum(excess, 1.0) ** (-1 / powers_of_s)).min(axis=0)
        borne = np.minimum(borne, at_fine * slower)
    return Dilated(trajectory, tau, s)


def _rates(trajectory: Trajectory, tau: Array) -> tuple[Array, Array]:
    """Return speeds and accelerations (2, M, 3) of the point and of the turning at tau (M,) [s]."""
    frames = trajectory.samples(tau)
    return np.stack((frames.dp_d, frames.omega_d)), np.stack((frames.ddp_d, frames.domega_d))


def _used(tau: Array, s: Array, rates: Array, accelerations: Array, most: Array) -> Array:
    """Return how much of its limits a trajectory takes at a rate s (M,) of its time.

    Args:
        tau: (M,) [s].
        s: (M,).
        rates, accelerations: (2, M, 3) of the point and of the turning, in tau.
        most: (3, 2) speeds, accelerations, jerks.

    Returns:
        (3, M) the larger part of the two, of speeds, accelerations, jerks.
    """
    ds = s * np.gradient(s, tau)
    v = s[:, None] * rates
    a = s[:, None] ** 2 * accelerations + ds[:, None] * rates
    j = s[:, None] * np.gradient(a, tau, axis=1)
    norms = np.array([np.linalg.norm(one, axis=2) for one in (v, a, j)])
    return np.maximum((norms / most[:, :, None]).max(axis=1), 1e-12)


def _smooth(s: Array, half: int) -> Array:
    """Return s averaged over 2 ``half`` neighbours, nowhere above s."""
    window = np.lib.stride_tricks.sliding_window_view
    least = window(np.pad(s, 2 * half, mode="edge"), 4 * half + 1).min(axis=1)
    kernel = np.full(half, 1.0 / half)
    kernel = np.convolve(kernel, kernel)  # 2 half - 1 long
    return np.convolve(np.pad(least, half - 1, mode="edge"), kernel, mode="valid")
