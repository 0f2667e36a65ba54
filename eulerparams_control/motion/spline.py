"""Poses that are passed through: their velocities and accelerations by a spline of SE(3).

From one pose to the next one the way is x, of the position or of the rotation vector in the axes of
the first, and the time T.  Where nothing else is known it is cubic, and the velocities v are such
that the accelerations on both sides of a pose agree (a C2 spline):

    a+ = (6 x / T - 4 v_0 - 2 v_1) / T,  a- = (2 v_0 + 4 v_1 - 6 x / T) / T,  a+ = a-

Beside a frame whose velocity and acceleration are known it has the degree 4.  At an end of
which nothing is known the acceleration is even.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.jit import (
    Array,
    b1,
    f8,
    i8,
    jit,
    matrix,
    new_matrix,
    new_vector,
    types,
    vector,
    void,
)
from eulerparams_control.laws.rotations import (
    body_rates,
    log,
    norm,
    product,
    right_jacobian,
    solve,
    turn,
)
from eulerparams_control.motion.dilation import Dilated, Ramped, is_within, ramped, within
from eulerparams_control.motion.frames import DesiredFrame, distance, stacked
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.trajectories import Trajectory

# A pose is passed no faster than this multiple of the slower mean speed beside it: so the way from
# pose to pose goes beyond its ends by less than half of itself, and a pose that is kept is kept.
_STEEPEST = 3.0

# Poses without times that are so close [s at full speed] are one; with times, those that are so
# close [m, rad] are the same.  The speeds of the tip [m/s, rad/s] where no limits are known.
_SHORTEST, _SAME, _SPEEDS = 1e-6, 1e-9, (0.25, 1.0)

# Each sweep over the poses leaves a quarter of the difference of the accelerations; the change of
# a velocity [of the largest one] that ends them, and their largest number.
_SETTLED, _SWEEPS = 1e-7, 50


_matrices = types.Array(f8, 3, "A", readonly=True)
type Flags = NDArray[np.bool_]
_flags = types.Array(b1, 1, "A", readonly=True)


@jit(
    types.Tuple((f8, new_vector, new_vector))(
        vector, matrix, matrix, _matrices, matrix, matrix, _flags, i8
    )
)
def _segment(
    times: Array, x: Array, r: Array, J: Array, v: Array, a: Array, known: Flags, n: int
) -> tuple[float, Array, Array]:
    """Return the mean speed of segment n, and the accelerations at its ends; see ``_solve``."""
    T = times[n + 1] - times[n]
    d, v_0, v_1, dJ_v = x[n] / T, v[n].copy(), solve(J[n], v[n + 1]), np.zeros(3)
    if r[n].any():
        dJ_v = body_rates(r[n], v_1, dJ_v)[1]
    bend = (12.0 * d - 6.0 * v_0 - 6.0 * v_1) / T
    if known[n]:
        a_0, a_1 = a[n].copy(), a[n] - bend
    elif known[n + 1]:
        a_1 = solve(J[n], a[n + 1] - dJ_v)
        a_0 = a_1 + bend
    else:
        a_0, a_1 = (6.0 * d - 4.0 * v_0 - 2.0 * v_1) / T, (2.0 * v_0 + 4.0 * v_1 - 6.0 * d) / T
    return norm(d), a_0, turn(J[n], a_1) + dJ_v


@jit(void(vector, matrix, matrix, new_matrix, new_matrix, _flags))
def _solve(times: Array, x: Array, r: Array, v: Array, a: Array, known: Flags) -> None:
    """Fill in velocities and accelerations, of the point or of the turning.

    Args:
        times: (N,) [s].
        x: (N - 1, 3) the ways, in the axes of their starts.
        r: (N - 1, 3) rotation vectors from these axes to those of their ends.
        v, a: (N, 3) velocities and accelerations, each in its own axes, which are changed.
        known: (N,) where nothing is changed.
    """
    J = np.empty((len(r), 3, 3))
    for n in range(len(r)):
        J[n] = right_jacobian(r[n])
    N, fastest = len(times), 0.0
    for _ in range(_SWEEPS):
        change = 0.0
        for k in range(N):
            if known[k]:
                continue
            slowest, weight, jump, mean = math.inf, 0.0, np.zeros(3), np.zeros(3)
            is_end = k == 0 or k == N - 1
            for n in range(max(k - 1, 0), min(k + 1, N - 1)):  # the segments beside it
                T, is_bound = times[n + 1] - times[n], known[n] or known[n + 1]
                speed, a_0, a_1 = _segment(times, x, r, J, v, a, known, n)
                slowest = min(slowest, speed)
                if is_end and (N > 2 or is_bound):  # the acceleration is even there
                    jump, weight = a_0 - a_1, 6.0 / T
                    mean = a_0 if k == 0 else a_1
                else:
                    here = a_0 if n == k else -a_1
                    jump, mean = jump + here, mean + (0.5 if n == k else -0.5) * here
                    weight += 6.0 / T if is_bound else 4.0 / T
            now = v[k] + jump / weight
            most, speed = _STEEPEST * slowest, norm(now)
            if speed >= most:  # it is too steep
                now, mean = most / max(speed, 1e-300) * now, np.zeros(3)
            change, fastest = max(change, norm(now - v[k])), max(fastest, norm(now))
            v[k], a[k] = now, mean
        if change <= _SETTLED * fastest:
            break


class Poses(Trajectory):
    """Poses to pass through, some or all of them without velocities.

    Args:
        times: [s] increasing; all 0: they take as long as the limits of the tip say.
        frames: the desired frames.
        known: whether the velocities and accelerations of each count; else it is passed through.

    Raises:
        ConfigurationError: see :class:`Trajectory`, or if one without a time has a velocity.
    """

    def __init__(
        self, times: Sequence[float], frames: Sequence[DesiredFrame], known: Sequence[bool]
    ) -> None:
        self.is_timed = any(times)
        super().__init__(times if self.is_timed else range(len(times)), frames)
        self._known = np.array(known)
        moves = self._known & np.array([frame.moves for frame in self.frames])
        if not self.is_timed and moves.any():
            raise ConfigurationError(
                f"point {np.argmax(moves)} (the first is 0) has a velocity, and no point has a "
                "time_from_start; expected times, or no velocities: then the limits of the tip "
                "say how fast it goes"
            )

    def to_come(self, late: float) -> list[DesiredFrame]:
        """See Trajectory."""
        return super().to_come(late) if self.is_timed else self.frames

    def beginning(self, here: DesiredFrame, late: float) -> DesiredFrame:
        """See Trajectory; between two poses it is as if it rested there."""
        if not self.is_timed:
            return self.frames[0]
        if late < self.times[0]:
            return here
        k = max(min(bisect_right(self.times, late), len(self.times) - 1), 1)
        ends = [frame.at_rest() for frame in self.frames[k - 1 : k + 1]]
        return Trajectory(self.times[k - 1 : k + 1], ends).sample(late)

    def from_frame(self, frame: DesiredFrame, late: float = 0.0) -> Trajectory:
        """See Trajectory: it is at rest at its ends, unless the tip moves when it begins."""
        return self._from(frame, late, _SPEEDS).resting().spline

    def passed(
        self, here: DesiredFrame, late: float, limits: MotionLimits
    ) -> tuple[Trajectory | Dilated | Ramped | None, float]:
        """Return the motion through the poses, and how far [s] it has come.

        It takes the times of the poses if that is within the limits.  Else time gives way, at its
        ends, too: it gets up to speed along its path, and comes to rest there; where the tip moves
        it begins at the first pose, which may be yet to come.  None: it is over before it could
        stop.
        """
        knots = self._from(here, late, limits.speeds)
        if self.is_timed and is_within(exact := knots.resting().spline, limits):
            return exact, late
        if self.is_timed and knots.known[0] and late < self.times[0] and len(knots.times) > 2:
            times, frames, known = knots.times[1:], knots.frames[1:], knots.known[1:]
            knots = _Knots(times, frames, known, (False, knots.rests[1]))
        late = late - float(knots.times[0]) if self.is_timed else 0.0
        motion = within(knots._replace(times=knots.times - knots.times[0]).spline, limits)
        if isinstance(motion, Dilated) and late > 0.0:
            late = motion.time_at(late)
        return ramped(motion, knots.rests, limits), late

    def _from(self, here: DesiredFrame, late: float, speeds: tuple[float, float]) -> "_Knots":
        """Return what is to be passed from where the tip is."""
        times, frames, known = np.array(self.times), self.frames, self._known
        rests = not (known[0] or here.moves)
        if not self.is_timed or late < times[0]:
            times, rests = np.append(max(late, 0.0), times), not here.moves
            frames, known = [here, *frames], np.append(here.moves, known)
        ways = np.array([distance(*pair) for pair in pairwise(frames)]).reshape(-1, 2)
        if self.is_timed:
            left = len(times)  # at the end it waits, where poses are the same
            while left > 1 and not known[left - 1] and ways[left - 2].max() < _SAME:
                left -= 1
            kept = np.arange(left)
        else:
            spans = (ways / speeds).max(axis=1)
            kept = np.append(0, np.flatnonzero(spans > _SHORTEST) + 1)
            times = np.append(0.0, np.cumsum(spans))
        known = known[kept]
        frames = [frames[k] for k in kept]
        return _Knots(times[kept], frames, known, (rests, not known[-1]))


class _Knots(NamedTuple):
    """What a spline is to pass.

    Attributes:
        times: (N,) [s].
        frames: the N frames.
        known: (N,) whether their velocities and accelerations are.
        rests: whether it rests at its start, at its end.
    """

    times: Array
    frames: list[DesiredFrame]
    known: Flags
    rests: tuple[bool, bool]

    def resting(self) -> "_Knots":
        """Return the same with ends at rest that are known."""
        frames, known = self.frames.copy(), self.known.copy()
        for end, rests in zip((0, -1), self.rests, strict=True):
            if rests:
                frames[end], known[end] = frames[end].at_rest(), True
        return self._replace(frames=frames, known=known)

    @property
    def spline(self) -> Trajectory:
        """The spline through the frames."""
        times, known = self.times, self.known
        p, R, dp, omega, ddp, domega = stacked(
            frame if is_known else frame.at_rest()
            for frame, is_known in zip(self.frames, known, strict=True)
        )
        if len(times) > 1:
            x = np.array([log(product(before.T, after)) for before, after in pairwise(R)])
            way = np.diff(p, axis=0)
            _solve(times, way, 0 * x, dp, ddp, known)
            omega, domega = (np.einsum("nji,nj->ni", R, rates) for rates in (omega, domega))
            _solve(times, x, x, omega, domega, known)
            omega, domega = (np.einsum("nij,nj->ni", R, rates) for rates in (omega, domega))
        frames = zip(p, R, dp, omega, ddp, domega, strict=True)
        return Trajectory(times.tolist(), [DesiredFrame(*frame) for frame in frames])
