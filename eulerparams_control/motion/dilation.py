"""A trajectory that is too fast goes slower along its own path: time gives way, not geometry.

Its time runs at the rate s(tau) <= 1, which is smooth, and 1 where the trajectory is slow enough:

    dp = s dp_d,  ddp = s^2 ddp_d + s s' dp_d        s' = ds / dtau

and likewise for the rotation.  s follows from the speed, acceleration and jerk along the
trajectory: the least of its surroundings, averaged, so that it changes slowly.
"""

import math
from bisect import bisect_right

import numpy as np

from eulerparams_control.laws.jit import Array
from eulerparams_control.laws.rotations import norm
from eulerparams_control.motion.frames import DesiredFrame, stacked
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.trajectories import Trajectory, polynomial, quintic

# A trajectory is checked at its points, between them, and at a number of places a second; the
# smallest and the largest number of places.
_RATE, _FEWEST, _MOST = 200.0, 60, 4000

# Where a segment is looked at: its jerk is largest at its ends, its acceleration near the second
# and the fourth.  Where there are many points their distance is short, and the middle will do.
_PARTS, _MANY = (0.02, 0.2, 0.5, 0.8, 0.98), 2000

# No part of a limit; rounding; how far [of the limits] a slowed trajectory may be from them.
_TINY, _ROUNDING, _TOLERANCE, _TRIALS = 1e-12, 1e-6, 0.01, 12

# Part of the jerk that it gets: between the places it is larger than the differences say.
_OF_JERK = 0.95

# Places at which a ramp is checked; the shortest trajectory [s], to which a shorter one is
# stretched first; the slowest rate.
_PLACES, _SHORTEST, _SLOWEST = 33, 1e-3, 1e-3

# The rate changes with this part of the acceleration; in each further trial it does so by a factor
# milder.
_OF_ACCELERATION, _MILDER = 0.7, 0.85


class Dilated:
    """A trajectory whose time runs slower.

    Attributes:
        trajectory: as it was asked for.
        duration: [s] that it takes.
        slowest: the least rate of its time.
    """

    def __init__(self, trajectory: Trajectory, tau: Array, s: Array) -> None:
        self.trajectory, self.slowest = trajectory, float(s.min())
        rates, step = s * np.gradient(s, tau), np.diff(tau)
        # of dtau / s, to the fourth order: else the acceleration ripples
        steps = step / 2 * (1 / s[1:] + 1 / s[:-1]) + step**2 / 12 * np.diff(rates / s**3)
        times = np.concatenate(([0.0], np.cumsum(steps)))
        self.duration, self._times, self._tau = float(times[-1]), times.tolist(), tau
        self._end = float(tau[-1]), float(s[-1]), float(rates[-1])
        columns = np.stack((tau, s, rates))[..., None]
        T = np.diff(times)[:, None]
        self._coefficients = quintic(columns[:, :-1], columns[:, 1:], T)

    def time_at(self, tau: float) -> float:
        """Return the time [s] at which the trajectory is as it was asked to be at tau [s]."""
        return float(np.interp(tau, self._tau, self._times))

    def sample(self, t: float) -> DesiredFrame:
        """Return the desired frame at t [s]."""
        if t >= self.duration:
            tau, s, ds = self._end
            end = self.trajectory.sample(tau)
            return end.at_rest() if t > self.duration else end.at_pace(s, ds)
        k = max(bisect_right(self._times, t) - 1, 0)
        values = polynomial(self._coefficients[k], max(t - self._times[k], 0.0))
        tau, s, ds = (value.item() for value in values)
        return self.trajectory.sample(tau).at_pace(s, ds)


class Ramped:
    """A motion that gets up to speed from rest, and comes to rest, along its own path.

    The rate u of its time comes from 0 within ``up`` and goes to 0 within ``down`` [s], as
    3 x^2 - 2 x^3; where the motion is too short it does not come to 1.

    Attributes:
        motion: whose time it is.
        duration: [s] that it takes.
        fits: whether it gets as fast as it is without a ramp.
        slowest: the least rate of the time of the motion.
    """

    def __init__(self, motion: Trajectory | Dilated, up: float, down: float) -> None:
        self.motion, self._up, self._down = motion, up, down
        self.slowest = motion.slowest
        length = motion.duration
        self._most = min(1.0, 2 * length / max(up + down, 1e-12))
        self._even = max(length / self._most - (up + down) / 2, 0.0)
        self.duration, self._length = up + self._even + down, length
        self.fits = self._most == 1.0

    def sample(self, t: float) -> DesiredFrame:
        """Return the desired frame at t [s]."""
        left = self.duration - t
        if left <= 0 and self._down:
            return self.motion.sample(self._length).at_rest()
        if self._up and t < self._up:
            tau, u, du = self._ramp(t, self._up)
        elif self._down and left < self._down:
            tau, u, du = self._ramp(left, self._down)
            tau, du = self._length - tau, -du
        else:
            tau, u, du = self._most * (t - self._up / 2), self._most, 0.0
        return self.motion.sample(tau).at_pace(u, du)

    def _ramp(self, t: float, T: float) -> tuple[float, float, float]:
        """Return time, rate and its change after t [s] of a ramp of T [s]."""
        x, most = max(t / T, 0.0), self._most
        return most * T * x**3 * (1 - x / 2), most * x * x * (3 - 2 * x), most / T * 6 * x * (1 - x)


def ramped(
    motion: Trajectory | Dilated, rests: tuple[bool, bool], limits: MotionLimits
) -> Ramped | None:
    """Return a motion that rests at its start, at its end; None if it is too short for that."""
    if motion.duration <= 0.0:
        return None
    T = [
        _shortest_ramp(motion.sample(t), motion.duration, limits) if rests_there else 0.0
        for t, rests_there in zip((0.0, motion.duration), rests, strict=True)
    ]
    for _ in range(_TRIALS):
        found = Ramped(motion, *T)
        begins = 0.0, found.duration - T[1]
        longer = [_longer(found, t, one, limits) for t, one in zip(begins, T, strict=True)]
        if max(longer) <= 1 + _TOLERANCE:
            break
        T = [one * max(factor, 1.0) for one, factor in zip(T, longer, strict=True)]
    return found if found.fits or all(rests) else None


def _shortest_ramp(frame: DesiredFrame, length: float, limits: MotionLimits) -> float:
    """Return the time [s] of a ramp to the speed of a frame, in a motion of a length [s]."""
    T = 0.0
    speeds = norm(frame.dp_d), norm(frame.omega_d)
    for speed, a, j in zip(speeds, limits.accelerations, limits.jerks, strict=True):
        T = max(T, min(1.5 * speed / a, math.sqrt(1.5 * speed * length / a)))
        T = max(T, min(math.sqrt(6 * speed / j), (6 * speed * length / j) ** (1 / 3)))
    return T


def _longer(motion: Ramped, begin: float, T: float, limits: MotionLimits) -> float:
    """Return the factor by which a ramp of T [s] that begins at a time [s] is to be longer."""
    if T == 0.0:
        return 0.0
    times = np.linspace(begin, begin + T, _PLACES)
    frames = stacked(motion.sample(t) for t in times.tolist())
    accelerations = np.stack((frames.ddp_d, frames.domega_d), axis=1)
    a = np.linalg.norm(accelerations, axis=2) / limits.accelerations
    j = np.linalg.norm(np.diff(accelerations, axis=0), axis=2) / (T / (_PLACES - 1)) / limits.jerks
    return max(float(a.max()), math.sqrt(float(j.max())))


class _Places:
    """Where a trajectory is compared with its limits.

    Attributes:
        even: (K,) [s] places at even distances, at which the rate of its time is chosen.
        tau: (M,) [s] all places.
        rates, accelerations: (2, M, 3) of the point and of the turning.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        points = np.array(trajectory.times)
        begin, end = points[0], points[-1]
        count = int(min(max((end - begin) * _RATE, _FEWEST), _MOST))
        self.even = np.linspace(begin, end, count + 1)
        parts = _PARTS if len(points) < _MANY else (0.5,)
        between = (points[:-1] + np.diff(points) * part for part in parts)
        tau = np.unique(np.round(np.concatenate((self.even, points, *between)), 9))
        self.tau = np.clip(tau, begin, end)
        frames = trajectory.samples(self.tau)
        self.rates = np.stack((frames.dp_d, frames.omega_d))
        self.accelerations = np.stack((frames.ddp_d, frames.domega_d))

    def used(self, most: Array, s: Array | float = 1.0, ds: Array | float = 0.0) -> Array:
        """Return the parts (3, M) of speeds, accelerations, jerks, at a rate of time.

        Args:
            most: (3, 2) limits of these, of the point and of the turning; the larger part counts.
            s, ds: (M,) the rate, [1/s] its change in time.
        """
        s, ds = (np.broadcast_to(x, self.tau.shape)[:, None] for x in (s, ds))
        a = s**2 * self.accelerations + ds * self.rates
        j = s * np.gradient(a, self.tau, axis=1)
        norms = np.linalg.norm((s * self.rates, a, j), axis=3)
        return np.maximum((norms / most[..., None]).max(axis=1), _TINY)


def is_within(trajectory: Trajectory, limits: MotionLimits) -> bool:
    """Return whether a trajectory is within the limits."""
    if trajectory.duration - trajectory.times[0] < _SHORTEST:
        return len(trajectory.times) == 1
    return bool(_Places(trajectory).used(limits.by_derivative).max() <= 1 + _ROUNDING)


def within(trajectory: Trajectory, limits: MotionLimits) -> Trajectory | Dilated:
    """Return a trajectory within the limits: the same one if it is."""
    if len(trajectory.times) == 1:
        return trajectory
    if trajectory.duration - trajectory.times[0] < _SHORTEST:
        return within(trajectory.lasting(_SHORTEST), limits)
    places, most = _Places(trajectory), limits.by_derivative.copy()
    tau, fine, used = places.even, places.tau, places.used(most)
    if used.max() <= 1 + _ROUNDING:
        return trajectory
    powers_of_s = np.array([1.0, 2.0, 3.0])[:, None]
    borne = np.clip((used ** (-1 / powers_of_s)).min(axis=0), _SLOWEST, 1.0)
    place = np.searchsorted(tau, fine, side="right") - 1
    beside = place, np.minimum(place + 1, len(tau) - 1)
    speeds = (np.linalg.norm(places.rates, axis=2) / most[1][:, None]).max(axis=0)
    share, wide = _OF_ACCELERATION / np.maximum(speeds, _TINY), float((most[1] / most[2]).max())
    step = float(tau[1] - tau[0])
    most[2] *= _OF_JERK
    for _ in range(_TRIALS):
        s, change = np.ones(len(tau)), np.full(len(tau), np.inf)
        for neighbour in beside:
            np.minimum.at(s, neighbour, borne)
            np.minimum.at(change, neighbour, share)
        s = _smooth(s, change * step, min(max(int(wide / step), 1), len(tau) - 1))
        at_fine = np.interp(fine, tau, s), np.interp(fine, tau, s * np.gradient(s, tau))
        excess = places.used(most, *at_fine)
        if excess.max() <= 1 + _TOLERANCE:
            break
        slower = (np.maximum(excess, 1.0) ** (-1 / powers_of_s)).min(axis=0)
        borne, share, wide = np.minimum(borne, at_fine[0] * slower), _MILDER * share, wide / _MILDER
    return Dilated(trajectory, tau, s)


def _smooth(s: Array, change: Array, half: int) -> Array:
    """Return a rate of time nowhere above s that changes slowly.

    Args:
        s: (M,).
        change: (M,) by how much s^2 / 2 may change from one to the next.
        half: it is averaged over this many neighbours on both sides.
    """
    window = np.lib.stride_tricks.sliding_window_view
    x = window(np.pad(s, half, mode="edge"), 2 * half + 1).min(axis=1) ** 2 / 2
    way = np.cumsum(change)
    before = np.minimum.accumulate(x - way) + way
    after = np.minimum.accumulate((x + way)[::-1])[::-1] - way
    s = np.sqrt(2 * np.maximum(np.minimum(before, after), x.min()))  # not 0 by rounding
    kernel = np.full(half, 1.0 / half)
    kernel = np.convolve(kernel, kernel)  # 2 half - 1 long
    return np.convolve(np.pad(s, half - 1, mode="edge"), kernel, mode="valid")
