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
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws._old.compiled import (
    Array,
    Input,
    Row,
    Rows,
    entry,
    formula,
    from_rows,
    kernel,
    layout,
)
from eulerparams_control.laws._old.linear import Mat, Vec, cross, norm, solve
from eulerparams_control.laws._old.rotations import (
    R_angle_axis,
    body_rates,
    exp,
    log,
    right_jacobian,
)
from eulerparams_control.motion.frames import DesiredFrame, put_frame, read_frame, with_an_angle

# Points of one trajectory: more would be a message of megabytes.
MAX_POINTS = 20000


@kernel
def quintic[X: (float, Vec)](
    x_0: X, v_0: X, a_0: X, x_1: X, v_1: X, a_1: X, T: float
) -> tuple[X, X, X, X, X, X]:
    """Return the coefficients, constant first, from values, rates, accelerations T [s] apart."""
    h = x_1 - x_0 - T * v_0 - 0.5 * T * T * a_0
    v = T * (v_1 - v_0 - T * a_0)
    a = 0.5 * T * T * (a_1 - a_0)
    return (
        x_0,
        v_0,
        0.5 * a_0,
        (10.0 * h - 4.0 * v + a) / (T * T * T),
        (-15.0 * h + 7.0 * v - 2.0 * a) / (T * T * T * T),
        (6.0 * h - 3.0 * v + a) / (T * T * T * T * T),
    )


@kernel
def polynomial[X: (float, Vec)](c: tuple[X, X, X, X, X, X], t: float) -> tuple[X, X, X]:
    """Return value, rate and acceleration at t [s] from the coefficients of ``quintic``."""
    return (
        c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5])))),
        c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * (4.0 * c[4] + t * (5.0 * c[5])))),
        2.0 * c[2] + t * (6.0 * c[3] + t * (12.0 * c[4] + t * (20.0 * c[5]))),
    )


@formula
def turned(R_0: Mat, p: Vec, dp: Vec, ddp: Vec, x: Vec, dx: Vec, ddx: Vec) -> DesiredFrame:
    """Return the frame at p, and at R = R_0 exp(x), with their derivatives."""
    x = with_an_angle(x)
    R = R_0 @ exp(x)
    omega, domega = body_rates(x, dx, ddx)  # in the desired frame
    return DesiredFrame(p, R, dp, R @ omega, ddp, R @ domega)


@formula
def rotation_vector_at_end(start: DesiredFrame, end: DesiredFrame) -> tuple[Vec, Vec, Vec]:
    """Return x, dx, ddx at the end of a segment: the inverse of ``turned``."""
    x = log(start.R_d.T @ end.R_d)
    J_r = right_jacobian(x)
    dx = solve(J_r, end.R_d.T @ end.omega_d)
    _, dJ_dx = body_rates(x, dx, 0.0 * dx)
    return x, dx, solve(J_r, end.R_d.T @ end.domega_d - dJ_dx)


class Segment(NamedTuple):
    """The motion from a frame to the next one: coefficients of ``quintic`` for p_d and x."""

    start: DesiredFrame
    p: tuple[Vec, Vec, Vec, Vec, Vec, Vec]
    x: tuple[Vec, Vec, Vec, Vec, Vec, Vec]


_segment_width, _read_segment, _put_segment = layout(Segment)[:3]


@formula
def between(start: DesiredFrame, end: DesiredFrame, T: float) -> Segment:
    """Return the motion between two frames that are T [s] apart."""
    R = start.R_d.T
    p = quintic(start.p_d, start.dp_d, start.ddp_d, end.p_d, end.dp_d, end.ddp_d, T)
    x_1, dx_1, ddx_1 = rotation_vector_at_end(start, end)
    x = quintic(0.0 * x_1, R @ start.omega_d, R @ start.domega_d, x_1, dx_1, ddx_1, T)
    return Segment(start, p, x)


@entry
def _connect(times: Row, frames: Rows, segments: Rows) -> None:
    """Fill the segments (N, ...) that begin at frames (N, 24); the last is the last frame."""
    for k in range(len(times)):
        start = read_frame(frames[k], 0)
        put_frame(segments[k], 0, start)
        if k + 1 < len(times):
            end, T = read_frame(frames[k + 1], 0), times[k + 1] - times[k]
            _put_segment(segments[k], 0, between(start, end, T))


@kernel
def sampled(times: Array, segments: Array, t: float) -> DesiredFrame:
    """Return the frame at t [s] of a motion of segments (N, ...) that begin at times (N,) [s]."""
    k, last = int(np.searchsorted(times, t, side="right")) - 1, len(times) - 1
    if k < 0 or t > times[last]:
        frame, rest = read_frame(segments[max(k, 0)], 0), Vec(0.0, 0.0, 0.0)
        return DesiredFrame(frame.p_d, frame.R_d, rest, rest, rest, rest)
    if k == last:
        return read_frame(segments[k], 0)
    segment, t = _read_segment(segments[k], 0), t - times[k]
    return turned(segment.start.R_d, *polynomial(segment.p, t), *polynomial(segment.x, t))


@entry
def _sample(times: Row, segments: Rows, t: float, row: Row) -> None:
    put_frame(row, 0, sampled(times, segments, t))


@entry
def _samples(times: Row, segments: Rows, t: Input, rows: Rows) -> None:
    for n in range(len(t)):
        put_frame(rows[n], 0, sampled(times, segments, t[n]))


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

    @property
    def slowest(self) -> float:
        """The least rate of its time: it goes as it is."""
        return 1.0

    def sample(self, t: float) -> DesiredFrame:
        """Return the desired frame at t [s]; at rest before the first and after the last."""
        row = np.empty(24)
        _sample(*self.segments, t, row)
        return DesiredFrame.of(row)

    def samples(self, t: Array) -> DesiredFrame:
        """Return the desired frames at t (M,) [s] as one, its fields stacked: see ``sample``."""
        rows = np.empty((len(t), 24))
        _samples(*self.segments, t, rows)
        return from_rows(DesiredFrame, rows)

    @cached_property
    def segments(self) -> tuple[Array, Array]:
        """Its times (N,) [s], and the :class:`Segment` that begins at each, as rows."""
        fields = [field for frame in self.frames for field in frame]
        times, rows = np.array(self.times), np.zeros((len(self.times), _segment_width))
        _connect(times, np.concatenate(fields, axis=None).reshape(-1, 24), rows)
        return times, rows

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


@formula
def perpendicular(n: Vec) -> Vec:
    """Return a unit vector perpendicular to the unit vector n."""
    x, y, z = abs(n.x), abs(n.y), abs(n.z)
    if x <= y and x <= z:
        u = Vec(0.0, n.z, -n.y)
    else:
        u = Vec(-n.z, 0.0, n.x) if y <= z else Vec(n.y, -n.x, 0.0)
    return u / norm(u)
