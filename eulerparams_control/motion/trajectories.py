"""Desired motion: the desired frame at any time, from way-points, circles or messages.

A trajectory is a row of frames with their derivatives.  Between two of them the
position is a polynomial of degree 5 and so is the rotation vector x of R = R_0 exp(x):
both pass the frames with their velocities and accelerations, so the desired frame is
consistent, continuous to acceleration, and exact at every time.

Notation: ``p_d`` (3,) [m], ``R_d`` (3, 3), ``dp_d, omega_d`` [m/s, rad/s], ``ddp_d,
domega_d`` [m/s^2, rad/s^2], all in the base frame, of the tip.
"""

import math
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.jit import (
    Array,
    f8,
    jit,
    matrix,
    new_matrix,
    new_vector,
    types,
    vector,
)
from eulerparams_control.laws.rotations import (
    R_angle_axis,
    body_rates,
    cross,
    exp,
    log,
    norm,
    product,
    right_jacobian,
    solve,
    turn,
    turn_back,
)
from eulerparams_control.motion.frames import (
    DesiredFrame,
    finite,
    six_arrays,
    stacked,
    with_an_angle,
)

# Points of one trajectory: more would be a message of megabytes.
MAX_POINTS = 20000

_matrices = types.Array(f8, 3, "A", readonly=True)
_stacks = types.Tuple((new_matrix, f8[:, :, ::1], *(new_matrix,) * 4))


def quintic(start: Iterable[Array], end: Iterable[Array], T: Array) -> Array:
    """Return the coefficients (..., 6, n), constant first, of polynomials of degree 5.

    Args:
        start, end: values, rates and accelerations (..., n) there.
        T: (..., 1) [s] between them.
    """
    (x_0, v_0, a_0), (x_1, v_1, a_1) = start, end
    h = x_1 - x_0 - T * v_0 - T**2 / 2 * a_0
    v = T * (v_1 - v_0 - T * a_0)
    a = T**2 / 2 * (a_1 - a_0)
    c_3, c_4, c_5 = 10 * h - 4 * v + a, -15 * h + 7 * v - 2 * a, 6 * h - 3 * v + a
    return np.stack((x_0, v_0, a_0 / 2, c_3 / T**3, c_4 / T**4, c_5 / T**5), axis=-2)


@jit(types.UniTuple(new_vector, 3)(matrix, f8))
def polynomial(c: Array, t: float) -> tuple[Array, Array, Array]:
    """Return value, rate and acceleration (n,) at t [s] from coefficients (6, n) of ``quintic``."""
    n = c.shape[1]
    x, dx, ddx = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        for k in range(5, -1, -1):  # Horner's scheme
            ddx[i] = ddx[i] * t + 2.0 * dx[i]
            dx[i] = dx[i] * t + x[i]
            x[i] = x[i] * t + c[k, i]
    return x, dx, ddx


@jit(types.Tuple((new_matrix, new_vector, new_vector))(matrix, vector, vector, vector))
def turned(R_0: Array, x: Array, dx: Array, ddx: Array) -> tuple[Array, Array, Array]:
    """Return R = R_0 exp(x), omega and domega."""
    x = with_an_angle(x)
    R = product(R_0, exp(x))
    omega, domega = body_rates(x, dx, ddx)  # in the turned frame
    return R, turn(R, omega), turn(R, domega)


@jit(types.UniTuple(new_vector, 3)(matrix, matrix, vector, vector))
def rotation_vector_at_end(
    R_0: Array, R: Array, omega: Array, domega: Array
) -> tuple[Array, Array, Array]:
    """Return x, dx, ddx of R = R_0 exp(x): the inverse of ``turned``."""
    x = log(product(R_0.T, R))
    J_r = right_jacobian(x)
    dx = solve(J_r, turn_back(R, omega))
    _, dJ_dx = body_rates(x, dx, np.zeros(3))
    return x, dx, solve(J_r, turn_back(R, domega) - dJ_dx)


@jit(six_arrays(vector, _matrices, _matrices, _matrices, f8))
def sampled(times: Array, R_0: Array, c_p: Array, c_x: Array, t: float) -> tuple[Array, ...]:
    """Return the frame at t [s] of a motion of N segments; at rest before and after it.

    Args:
        times: (N,) [s] at which they begin; the last one is of no duration.
        R_0: (N, 3, 3) orientations there.
        c_p, c_x: (N, 6, 3) coefficients of ``quintic`` for the position and for x.
        t: [s].
    """
    last = len(times) - 1
    k = min(max(int(np.searchsorted(times, t, side="right")) - 1, 0), last)
    tau = min(max(t, times[0]), times[last]) - times[k]
    p, dp, ddp = polynomial(c_p[k], tau)
    x, dx, ddx = polynomial(c_x[k], tau)
    R, omega, domega = turned(R_0[k], x, dx, ddx)
    if t < times[0] or t > times[last]:
        return p, R, np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    return p, R, dp, omega, ddp, domega


@jit(_stacks(vector, _matrices, _matrices, _matrices, vector))
def samples(times: Array, R_0: Array, c_p: Array, c_x: Array, t: Array) -> tuple[Array, ...]:
    """Return the frames at t (M,) [s], stacked: see ``sampled``."""
    M = len(t)
    p, dp, ddp = np.empty((M, 3)), np.empty((M, 3)), np.empty((M, 3))
    R, omega, domega = np.empty((M, 3, 3)), np.empty((M, 3)), np.empty((M, 3))
    for n in range(M):
        p[n], R[n], dp[n], omega[n], ddp[n], domega[n] = sampled(times, R_0, c_p, c_x, t[n])
    return p, R, dp, omega, ddp, domega


class Trajectory:
    """A motion through frames at given times; it holds the last one afterwards.

    Args:
        times: [s] strictly increasing, from the start of the trajectory.
        frames: the desired frames at these times.  Two neighbours differ by less than
            half a turn: the rotation between them is about the equivalent axis.

    Attributes:
        slowest: the least rate of its time: it goes as it is.

    Raises:
        ConfigurationError: if there is none, the numbers differ, or times do not increase.
    """

    slowest = 1.0

    def __init__(self, times: Sequence[float], frames: Sequence[DesiredFrame]) -> None:
        if not frames or len(times) != len(frames):
            raise ConfigurationError(
                f"a trajectory needs as many times as frames, at least one; got {len(times)} "
                f"times and {len(frames)} frames"
            )
        self.times = [float(t) for t in times]
        for k, (before, t) in enumerate(pairwise(self.times), start=1):
            if not t > before:
                raise ConfigurationError(
                    "the times of a trajectory must increase from point to point: that of point "
                    f"{k} (the first is 0) is {t:g} s after {before:g} s"
                )
        self.frames = list(frames)

    @property
    def duration(self) -> float:
        """Time [s] of the last frame."""
        return self.times[-1]

    def sample(self, t: float) -> DesiredFrame:
        """Return the desired frame at t [s]; at rest before the first and after the last.

        Raises:
            SingularityError: if its rotation is not finite.
        """
        return finite(DesiredFrame(*sampled(*self._segments, t)))

    def samples(self, t: Array) -> DesiredFrame:
        """Return the desired frames at t (M,) [s] as one, its fields stacked: see ``sample``."""
        return DesiredFrame(*samples(*self._segments, t))

    @cached_property
    def _segments(self) -> tuple[Array, Array, Array, Array]:
        """The motion between its frames, as :func:`sampled` takes it."""
        following = [*self.frames[1:], self.frames[-1]]  # the last one leads nowhere
        start, end = stacked(self.frames), stacked(following)
        T = np.append(np.diff(self.times), 1.0)[:, None]
        dx_0 = np.einsum("nji,nj->ni", start.R_d, start.omega_d)  # at the start J_r is 1
        ddx_0 = np.einsum("nji,nj->ni", start.R_d, start.domega_d)
        ends = [
            rotation_vector_at_end(here.R_d, there.R_d, there.omega_d, there.domega_d)
            for here, there in zip(self.frames, following, strict=True)
        ]
        c_p = quintic(start[::2], end[::2], T)  # p_d, dp_d, ddp_d
        c_x = quintic((np.zeros_like(dx_0), dx_0, ddx_0), np.array(ends).swapaxes(0, 1), T)
        return np.array(self.times), start.R_d, c_p, c_x

    def lasting(self, duration: float) -> "Trajectory":
        """Return the same way in ``duration`` [s], at rest at its points."""
        begin, end = self.times[0], self.times[-1]
        times = [begin + duration * (t - begin) / (end - begin) for t in self.times]
        return Trajectory(times, [frame.at_rest() for frame in self.frames])

    def from_frame(self, frame: DesiredFrame, late: float = 0.0) -> "Trajectory":
        """Return the trajectory that starts with ``frame`` if its first time is later.

        Args:
            frame: where the tip is.
            late: for how long [s] the trajectory has been going on.
        """
        if self.times[0] <= 0:
            return self
        return Trajectory([0.0, *self.times], [frame, *self.frames])

    def to_come(self, late: float) -> list[DesiredFrame]:
        """Return the frames that are not over after ``late`` [s]."""
        return self.frames[min(bisect_left(self.times, late), len(self.times) - 1) :]

    def beginning(self, here: DesiredFrame, late: float) -> DesiredFrame:
        """Return where it leads at once from a frame, ``late`` [s] after its start."""
        return self.from_frame(here, late).sample(late)


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
        u = perpendicular(n)
        arm = self.radius * (R_angle_axis(phi, n) @ u)  # from the centre to the tip
        tangent = cross(n, arm)
        A = R_angle_axis(phi, n) @ R_angle_axis(self.tilt, u) @ R_angle_axis(-phi, n)
        C = R_angle_axis(-self.tilt, u) @ R_0
        lag = n - A @ n
        omega = dphi * lag
        return DesiredFrame(
            p_d=p_0 + arm - self.radius * u,
            R_d=A @ C,
            dp_d=dphi * tangent,
            omega_d=omega,
            ddp_d=ddphi * tangent - dphi**2 * arm,
            domega_d=ddphi * lag - dphi * cross(omega, A @ n),
        )


def _ramp(s: float, speed: float, ramp: float) -> tuple[float, float, float]:
    """Return phase, rate and acceleration where the rate grows smoothly from 0 to speed."""
    phi = speed * ramp * (2.5 * s**4 - 3 * s**5 + s**6)
    return phi, speed * (10 * s**3 - 15 * s**4 + 6 * s**5), speed / ramp * 30 * (s * (1 - s)) ** 2


@jit(new_vector(vector))
def perpendicular(n: Array) -> Array:
    """Return a unit vector perpendicular to the unit vector n (3,)."""
    axis = np.zeros(3)
    axis[np.argmin(np.abs(n))] = 1.0
    u = cross(n, axis)
    return u / norm(u)
