"""A trajectory that is too fast goes slower along its own path: time gives way, not geometry.

Its time runs at the rate s(tau) <= 1, which is smooth, and 1 where the trajectory is slow enough:

    dp = s dp_d,  ddp = s^2 ddp_d + s s' dp_d        s' = ds / dtau

and likewise for the rotation.  s follows from the speed, acceleration and jerk along the
trajectory: the least of its surroundings, averaged, so that it changes slowly.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws._old.compiled import Array, Row, Rows, entry
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

# No part of a limit.
_TINY = 1e-12

# Rounding, and how far [of the limits] a slowed trajectory may be from its limits.
_ROUNDING, _TOLERANCE, _TRIALS = 1e-6, 0.01, 12

# Part of the jerk that it gets: between the places it is larger than the differences say.
_OF_JERK = 0.95

# Number of places at which a ramp is checked.
_PLACES = 33

# Shortest trajectory [s]; a shorter one is stretched to it first.
_SHORTEST = 1e-3

# The slowest rate.
_SLOWEST = 1e-3

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
    for v, a, j in zip(
        (frame.dp_d, frame.omega_d), limits.accelerations, limits.jerks, strict=True
    ):
        speed = math.sqrt(v @ v)
        T = max(T, min(1.5 * speed / a, math.sqrt(1.5 * speed * length / a)))
        T = max(T, min(math.sqrt(6 * speed / j), (6 * speed * length / j) ** (1 / 3)))
    return T


def _longer(motion: Ramped, begin: float, T: float, limits: MotionLimits) -> float:
    """Return the factor by which a ramp of T [s] that begins at a time [s] is to be longer."""
    if T == 0.0:
        return 0.0
    times = np.linspace(begin, begin + T, _PLACES)
    rates = np.array([motion.sample(t).row[18:] for t in times.tolist()]).reshape(-1, 2, 3)
    a = np.linalg.norm(rates, axis=2) / limits.accelerations
    j = np.linalg.norm(np.diff(rates, axis=0), axis=2) / (T / (_PLACES - 1)) / limits.jerks
    return max(float(a.max()), math.sqrt(float(j.max())))


class _Places(NamedTuple):
    """What a trajectory needs of its limits, place by place.

    Attributes:
        tau: (K,) [s] places at even distances, at which the rate of its time is chosen.
        fine: (M,) [s] all places.
        rates, accelerations: (2, M, 3) of the point and of the turning.
        used: (3, M) how much of its speed, acceleration, jerk it takes.
    """

    tau: Array
    fine: Array
    rates: Array
    accelerations: Array
    used: Array


def _places(trajectory: Trajectory, limits: MotionLimits) -> _Places:
    begin, end = trajectory.times[0], trajectory.times[-1]
    count = int(min(max((end - begin) * _RATE, _FEWEST), _MOST))
    tau, points = np.linspace(begin, end, count + 1), np.array(trajectory.times)
    parts = _PARTS if len(points) < _MANY else (0.5,)
    between = (points[:-1] + np.diff(points) * part for part in parts)
    fine = np.unique(np.round(np.concatenate((tau, points, *between)), 9))
    fine = np.clip(fine, begin, end)
    frames = trajectory.samples(fine)
    rates = np.stack((frames.dp_d, frames.omega_d))
    accelerations = np.stack((frames.ddp_d, frames.domega_d))
    steady = np.ones(len(fine)), np.zeros(len(fine))
    return _Places(
        tau, fine, rates, accelerations, _used(fine, *steady, rates, accelerations, limits)
    )


def is_within(trajectory: Trajectory, limits: MotionLimits) -> bool:
    """Return whether a trajectory is within the limits."""
    if trajectory.duration - trajectory.times[0] < _SHORTEST:
        return len(trajectory.times) == 1
    return bool(_places(trajectory, limits).used.max() <= 1 + _ROUNDING)


def within(trajectory: Trajectory, limits: MotionLimits) -> Trajectory | Dilated:
    """Return a trajectory within the limits: the same one if it is."""
    if len(trajectory.times) == 1:
        return trajectory
    if trajectory.duration - trajectory.times[0] < _SHORTEST:
        return within(trajectory.lasting(_SHORTEST), limits)
    tau, fine, rates, accelerations, used = _places(trajectory, limits)
    if used.max() <= 1 + _ROUNDING:
        return trajectory
    powers_of_s = np.array([1.0, 2.0, 3.0])[:, None]
    borne = np.clip((used ** (-1 / powers_of_s)).min(axis=0), _SLOWEST, 1.0)
    place = np.searchsorted(tau, fine, side="right") - 1
    beside = place, np.minimum(place + 1, len(tau) - 1)
    most_a, most_j = np.array(limits.accelerations), np.array(limits.jerks)
    speeds = (np.linalg.norm(rates, axis=2) / most_a[:, None]).max(axis=0)
    share, wide = _OF_ACCELERATION / np.maximum(speeds, _TINY), float((most_a / most_j).max())
    step = float(tau[1] - tau[0])
    aim = replace(
        limits,
        linear_jerk=_OF_JERK * limits.linear_jerk,
        angular_jerk=_OF_JERK * limits.angular_jerk,
    )
    for _ in range(_TRIALS):
        s, change = np.ones(len(tau)), np.full(len(tau), np.inf)
        for neighbour in beside:
            np.minimum.at(s, neighbour, borne)
            np.minimum.at(change, neighbour, share)
        s = _smooth(s, change * step, min(max(int(wide / step), 1), len(tau) - 1))
        at_fine = np.interp(fine, tau, s), np.interp(fine, tau, s * np.gradient(s, tau))
        excess = _used(fine, *at_fine, rates, accelerations, aim)
        if excess.max() <= 1 + _TOLERANCE:
            break
        slower = (np.maximum(excess, 1.0) ** (-1 / powers_of_s)).min(axis=0)
        borne, share, wide = np.minimum(borne, at_fine[0] * slower), _MILDER * share, wide / _MILDER
    return Dilated(trajectory, tau, s)


def _used(
    tau: Array, s: Array, ds: Array, rates: Array, accelerations: Array, limits: MotionLimits
) -> Array:
    """Return how much of its limits a trajectory takes at a rate s (M,) of its time.

    Args:
        tau: (M,) [s].
        s, ds: (M,), [1/s] its change in time.
        rates, accelerations: (2, M, 3) of the point and of the turning, in tau.
        limits: of the tip.

    Returns:
        (3, M) the larger part of the two, of speeds, accelerations, jerks.
    """
    v = s[:, None] * rates
    a = s[:, None] ** 2 * accelerations + ds[:, None] * rates
    j = s[:, None] * np.gradient(a, tau, axis=1)
    norms = np.array([np.linalg.norm(one, axis=2) for one in (v, a, j)])
    return np.maximum((norms / limits.row.reshape(3, 2, 1)).max(axis=1), _TINY)


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
