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
    right_jacobian,
)
from eulerparams_control.laws.rotations_batch import body_rates_of, exps, turn
from eulerparams_control.motion.frames import DesiredFrame, with_an_angle

# Points of one trajectory: more would be a message of megabytes.
MAX_POINTS = 20000


class _Segment:
    """Motion between two frames ``duration`` seconds apart."""

    def __init__(self, start: DesiredFrame, end: DesiredFrame, duration: float) -> None:
        self.R_0 = start.R_d
        begin = (np.zeros(3), start.R_d.T @ start.omega_d, start.R_d.T @ start.domega_d)
        self.coefficients = np.hstack(
            [
                _quintic(
                    (start.p_d, start.dp_d, start.ddp_d), (end.p_d, end.dp_d, end.ddp_d), duration
                ),
                _quintic(begin, _rotation_vector_at_end(start, end), duration),
            ]
        )

    def sample(self, t: float) -> DesiredFrame:
        row, drow, ddrow = _powers(t) @ self.coefficients
        x = with_an_angle(row[3:])
        R_d = self.R_0 @ exp(x)
        omega, domega = body_rates(x, drow[3:], ddrow[3:])  # in the desired frame
        return DesiredFrame(row[:3], R_d, drow[:3], R_d @ omega, ddrow[:3], R_d @ domega)

    def samples(self, t: Array) -> DesiredFrame:
        """Return the frames at the times t (M,) [s] as one, its fields stacked."""
        rows, drows, ddrows = np.moveaxis(_powers_of(t) @ self.coefficients, 1, 0)
        x = rows[:, 3:]
        R_d = self.R_0 @ exps(x)
        omega, domega = body_rates_of(x, drows[:, 3:], ddrows[:, 3:])
        return DesiredFrame(
            rows[:, :3], R_d, drows[:, :3], turn(R_d, omega), ddrows[:, :3], turn(R_d, domega)
        )


def _rotation_vector_at_end(
    start: DesiredFrame, end: DesiredFrame
) -> tuple[Array, Array, Array]:
    """Return x, dx, ddx at the end of a segment: the inverse of ``_Segment.sample``."""
    x = log(start.R_d.T @ end.R_d)
    J_r = right_jacobian(x)
    dx = np.linalg.solve(J_r, end.R_d.T @ end.omega_d)
    _, dJ_dx = body_rates(x, dx, np.zeros(3))
    return x, dx, np.linalg.solve(J_r, end.R_d.T @ end.domega_d - dJ_dx)


def _quintic(
    start: tuple[Array, Array, Array], end: tuple[Array, Array, Array], T: float
) -> Array:
    """Return the coefficients (6, 3), constant first, of value, rate and acceleration given."""
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


def _powers(t: float) -> Array:
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
    """Return the matrices (M, 3, 6) of ``_powers`` for t (M,)."""
    powers = np.zeros((len(t), 3, 6))
    for n in range(6):
        powers[:, 0, n] = t**n
        powers[:, 1, n] = n * t ** max(n - 1, 0)
        powers[:, 2, n] = n * (n - 1) * t ** max(n - 2, 0)
    return powers


def _repeated(frame: DesiredFrame, count: int) -> DesiredFrame:
    """Return a frame ``count`` times, its fields stacked."""
    return DesiredFrame(*(np.repeat(value[None], count, axis=0) for value in frame))


def _write(frames: DesiredFrame, here: NDArray[np.bool_], part: DesiredFrame) -> None:
    """Put some frames into others, both stacked."""
    for field, values in zip(frames, part, strict=True):
        field[here] = values


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
        found = _repeated(self.frames[0].at_rest(), len(t))
        last = len(self.times) - 1
        at = np.searchsorted(self.times, t, side="right") - 1
        for index in np.unique(at[at >= 0]).tolist():
            here = at == index
            if index < last:
                part = self._segment(index).samples(t[here] - self.times[index])
            else:
                part = _repeated(self.frames[-1].at_rest(), int(here.sum()))
            _write(found, here, part)
        end = t == self.times[-1]
        _write(found, end, _repeated(self.frames[-1], int(end.sum())))
        return found

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
