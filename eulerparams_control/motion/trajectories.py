"""Desired motion: the desired frame at any time, from way-points, circles or messages.

A trajectory is a row of frames with their derivatives.  Between two of them the
position is a polynomial of degree 5 and so is the rotation vector x of R = R_0 exp(x):
both pass the frames with their velocities and accelerations, so the desired frame is
consistent, continuous to acceleration, and exact at every time.

Notation: ``p_d`` (3,) [m], ``R_d`` (3, 3), ``dp_d, omega_d`` [m/s, rad/s], ``ddp_d,
domega_d`` [m/s^2, rad/s^2], all in the base frame, of the tip.
"""

import bisect
import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.rotations import (
    Array,
    R_angle_axis,
    body_rates,
    cross,
    exp,
    log,
    quaternion,
    right_jacobian,
    rotation_vector,
)
from eulerparams_control.motion.frames import DesiredFrame, with_an_angle

# Points of one trajectory: more would be a message of megabytes.
MAX_POINTS = 20000


def prepare() -> None:
    """Compile what is planned with, now: nothing is compiled while an arm moves."""
    for formula in (body_rates, exp, quaternion, rotation_vector):
        formula.prepare()


class _Segment:
    """Motion between two frames ``duration`` seconds apart."""

    def __init__(self, start: DesiredFrame, end: DesiredFrame, duration: float) -> None:
        self.R_0 = start.R_d
        begin = (np.zeros(3), start.R_d.T @ start.omega_d, start.R_d.T @ start.domega_d)
        self.coefficients = np.hstack(
            [
                quintic(
                    (start.p_d, start.dp_d, start.ddp_d), (end.p_d, end.dp_d, end.ddp_d), duration
                ),
                quintic(begin, rotation_vector_at_end(start, end), duration),
            ]
        )

    def sample(self, t: float) -> DesiredFrame:
        row, drow, ddrow = powers(t) @ self.coefficients
        x = with_an_angle(row[3:])
        R_d = self.R_0 @ exp(x)
        omega, domega = body_rates(x, drow[3:], ddrow[3:])  # in the desired frame
        return DesiredFrame(row[:3], R_d, drow[:3], R_d @ omega, ddrow[:3], R_d @ domega)


def rotation_vector_at_end(start: DesiredFrame, end: DesiredFrame) -> tuple[Array, Array, Array]:
    """Return x, dx, ddx at the end of a segment: the inverse of ``_Segment.sample``."""
    x = log(start.R_d.T @ end.R_d)
    if not (end.omega_d.any() or end.domega_d.any()):
        return x, np.zeros(3), np.zeros(3)
    J_r = right_jacobian(x)
    dx = np.linalg.solve(J_r, end.R_d.T @ end.omega_d)
    _, dJ_dx = body_rates(x, dx, np.zeros(3))
    return x, dx, np.linalg.solve(J_r, end.R_d.T @ end.domega_d - dJ_dx)


def quintic(
    start: tuple[Array, Array, Array], end: tuple[Array, Array, Array], T: float | Array
) -> Array:
    """Return the coefficients (6, ..., 3), constant first, of values, rates and accelerations."""
    x_0, v_0, a_0 = start
    x_1, v_1, a_1 = end
    h = x_1 - x_0 - v_0 * T - a_0 * T**2 / 2
    v = v_1 - v_0 - a_0 * T
    a = a_1 - a_0
    return np.array(
        [
            x_0,
            v_0,
            a_0 / 2,
            (10 * h - 4 * v * T + a * T**2 / 2) / T**3,
            (-15 * h + 7 * v * T - a * T**2) / T**4,
            (6 * h - 3 * v * T + a * T**2 / 2) / T**5,
        ]
    )


def powers(t: float) -> Array:
    """Return the matrix (3, 6) that makes value, rate and acceleration of coefficients."""
    t2 = t * t
    t3 = t2 * t
    return np.array(
        [
            [1.0, t, t2, t3, t2 * t2, t2 * t3],
            [0.0, 1.0, 2 * t, 3 * t2, 4 * t3, 5 * t2 * t2],
            [0.0, 0.0, 2.0, 6 * t, 12 * t2, 20 * t3],
        ]
    )


def _powers_of(t: Array) -> Array:
    """Return the matrices (M, 3, 6) of ``powers`` for t (M,)."""
    powers = np.zeros((len(t), 3, 6))
    for n in range(6):
        powers[:, 0, n] = t**n
        powers[:, 1, n] = n * t ** max(n - 1, 0)
        powers[:, 2, n] = n * (n - 1) * t ** max(n - 2, 0)
    return powers


def _segments(frames: DesiredFrame, index: NDArray[np.intp], T: Array) -> tuple[Array, Array]:
    """Return R_0 (K, 3, 3) and the coefficients (K, 6, 6) of K segments, as ``_Segment`` has them.

    Args:
        frames: stacked.
        index: (K,) of the frame at which each segment begins.
        T: (K,) [s] that it takes.
    """
    start, end = (DesiredFrame(*(field[k] for field in frames)) for k in (index, index + 1))
    R_0, R_1, none = start.R_d, end.R_d, np.zeros((len(index), 3))
    x = rotation_vector(quaternion(R_0.mT @ R_1))
    units = (np.broadcast_to(axis, x.shape) for axis in np.eye(3))
    J_r = np.stack([body_rates(x, unit, none)[0] for unit in units], axis=2)
    dx = np.linalg.solve(J_r, np.matvec(R_1.mT, end.omega_d)[:, :, None])[:, :, 0]
    dJ_dx = body_rates(x, dx, none)[1]
    ddx = np.linalg.solve(J_r, (np.matvec(R_1.mT, end.domega_d) - dJ_dx)[:, :, None])[:, :, 0]
    begin = none, np.matvec(R_0.mT, start.omega_d), np.matvec(R_0.mT, start.domega_d)
    duration = T[:, None]
    p = quintic((start.p_d, start.dp_d, start.ddp_d), (end.p_d, end.dp_d, end.ddp_d), duration)
    both = np.concatenate((p, quintic(begin, (x, dx, ddx), duration)), axis=2)
    return R_0, np.moveaxis(both, 0, 1)


class Trajectory:
    """A motion through frames at given times; it holds the last one afterwards.

    Args:
        times: [s] strictly increasing, from the start of the trajectory.
        frames: the desired frames at these times.  Two neighbours differ by less than
            half a turn: the rotation between them is about the equivalent axis.

    Raises:
        ConfigurationError: if there is none, the numbers differ, or times do not increase.
    """

    def __init__(self, times: Sequence[float], frames: Sequence[DesiredFrame]) -> None:
        if not frames or len(times) != len(frames):
            raise ConfigurationError(
                f"a trajectory needs as many times as frames, at least one; got {len(times)} "
                f"times and {len(frames)} frames"
            )
        if not np.all(np.diff(times) > 0):
            raise ConfigurationError("the times of a trajectory must increase from point to point")
        self.times = [float(t) for t in times]
        self.frames = list(frames)
        self._segments: dict[int, _Segment] = {}

    @property
    def duration(self) -> float:
        """Time [s] of the last frame."""
        return self.times[-1]

    def sample(self, t: float) -> DesiredFrame:
        """Return the desired frame at t [s]; at rest before the first and after the last."""
        if t < self.times[0]:
            return self.frames[0].at_rest()
        if t == self.times[-1]:
            return self.frames[-1]
        if t > self.times[-1]:
            return self.frames[-1].at_rest()
        index = bisect.bisect_right(self.times, t) - 1
        if index not in self._segments:
            self._segments = {index: self._segment(index)}
        return self._segments[index].sample(t - self.times[index])

    def samples(self, t: Array) -> DesiredFrame:
        """Return the desired frames at t (M,) [s] as one, its fields stacked: see ``sample``."""
        frames, times, last = self._stacked, np.array(self.times), len(self.times) - 1
        at = np.searchsorted(times, t, side="right") - 1
        found = DesiredFrame(*(field[np.maximum(at, 0)] for field in frames))
        rests = (at < 0) | (t > times[-1])
        for field in found[2:]:
            field[rests] = 0.0
        inside = np.flatnonzero((at >= 0) & (at < last))
        if len(inside):
            used, which = np.unique(at[inside], return_inverse=True)
            R_0, coefficients = _segments(frames, used, np.diff(times)[used])
            rows = _powers_of(t[inside] - times[at[inside]]) @ coefficients[which]
            value, rate, acceleration = np.moveaxis(rows, 1, 0)
            R_d = R_0[which] @ exp(value[:, 3:])
            omega, domega = body_rates(value[:, 3:], rate[:, 3:], acceleration[:, 3:])
            part = (value[:, :3], R_d, rate[:, :3], np.matvec(R_d, omega), acceleration[:, :3])
            for field, values in zip(found, (*part, np.matvec(R_d, domega)), strict=True):
                field[inside] = values
        return found

    @cached_property
    def _stacked(self) -> DesiredFrame:
        """The frames as one, each field stacked."""
        return DesiredFrame(*(np.array(field) for field in zip(*self.frames, strict=True)))

    def lasting(self, duration: float) -> "Trajectory":
        """Return the same way in ``duration`` [s], at rest at its points."""
        begin, end = self.times[0], self.times[-1]
        times = [begin + duration * (t - begin) / (end - begin) for t in self.times]
        return Trajectory(times, [frame.at_rest() for frame in self.frames])

    def _segment(self, index: int) -> _Segment:
        duration = self.times[index + 1] - self.times[index]
        return _Segment(self.frames[index], self.frames[index + 1], duration)

    def from_frame(self, frame: DesiredFrame) -> "Trajectory":
        """Return the trajectory that starts with ``frame`` at 0 if its first time is later."""
        if self.times[0] <= 0:
            return self
        return Trajectory([0.0, *self.times], [frame, *self.frames])


def way_points(times: Sequence[float], poses: Sequence[tuple[Array, Array]]) -> Trajectory:
    """Return the motion that rests at each pose (p (3,), R (3, 3)) at its time [s]."""
    return Trajectory(times, [DesiredFrame(p, R) for p, R in poses])


class Circle(NamedTuple):
    """A circle of the tip that begins at a pose, with a conical motion of the tool.

    Attributes:
        radius: [m].
        normal: (3,) axis of the circle, base frame; need not be of unit length.
        period: [s] of one turn.
        turns: how many.
        tilt: [rad] half angle of the cone on which the tool axis turns, once a turn.
        ramp: [s] to get up to speed and down again; 0 starts at speed.
    """

    radius: float
    normal: Array
    period: float
    turns: float = 1.0
    tilt: float = 0.0
    ramp: float = 1.0

    def trajectory(self, p_0: Array, R_0: Array, points_per_turn: int = 60) -> Trajectory:
        """Return the circle from the pose p_0 (3,), R_0 (3, 3).

        Raises:
            ConfigurationError: if period or turns are not positive, or the ramp is too long.
        """
        duration = self.turns * self.period + self.ramp
        if not (self.period > 0 and self.turns > 0 and 0 <= self.ramp <= self.turns * self.period):
            raise ConfigurationError(
                f"circle: period {self.period} s, {self.turns} turns, ramp {self.ramp} s; expected "
                "positive period and turns, and a ramp from 0 to period * turns"
            )
        if not np.linalg.norm(self.normal) > 0:
            raise ConfigurationError("circle: the normal is zero; expected a direction")
        step = min(self.period / points_per_turn, self.ramp / 10 or self.period)
        count = max(2, math.ceil(duration / step) + 1)
        if count > MAX_POINTS:
            raise ConfigurationError(
                f"circle: it takes {count} points; at most {MAX_POINTS} are sent: choose fewer "
                "turns or a longer ramp"
            )
        times = np.linspace(0.0, duration, count)
        return Trajectory(times.tolist(), [self._frame(t, p_0, R_0) for t in times])

    def _phase(self, t: float) -> tuple[float, float, float]:
        """Return the angle on the circle [rad] with its first and second derivative."""
        speed, ramp = 2 * math.pi / self.period, self.ramp
        end = self.turns * self.period + ramp
        if ramp > 0 and t < ramp:
            return _ramp(t / ramp, speed, ramp)
        if ramp > 0 and t > end - ramp:
            phi, dphi, ddphi = _ramp((end - t) / ramp, speed, ramp)
            return 2 * math.pi * self.turns - phi, dphi, -ddphi
        return speed * (t - ramp / 2), speed, 0.0

    def _frame(self, t: float, p_0: Array, R_0: Array) -> DesiredFrame:
        phi, dphi, ddphi = self._phase(t)
        n = self.normal / np.linalg.norm(self.normal)
        u = _perpendicular(n)
        arm = self.radius * (R_angle_axis(phi, n) @ u)  # from the centre to the tip
        turn = cross(n, arm)
        A = R_angle_axis(phi, n) @ R_angle_axis(self.tilt, u) @ R_angle_axis(-phi, n)
        C = R_angle_axis(-self.tilt, u) @ R_0
        lag = n - A @ n
        omega = dphi * lag
        return DesiredFrame(
            p_d=p_0 + arm - self.radius * u,
            R_d=A @ C,
            dp_d=dphi * turn,
            omega_d=omega,
            ddp_d=ddphi * turn - dphi**2 * arm,
            domega_d=ddphi * lag - dphi * cross(omega, A @ n),
        )


def _ramp(s: float, speed: float, ramp: float) -> tuple[float, float, float]:
    """Return phase, rate and acceleration where the rate grows smoothly from 0 to speed."""
    phi = speed * ramp * (2.5 * s**4 - 3 * s**5 + s**6)
    return phi, speed * (10 * s**3 - 15 * s**4 + 6 * s**5), speed / ramp * 30 * (s * (1 - s)) ** 2


def _perpendicular(n: Array) -> Array:
    """Return a unit vector (3,) perpendicular to the unit vector n."""
    u = cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
    return u / np.linalg.norm(u)
