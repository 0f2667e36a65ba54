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
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws._old.compiled import Array, Row, Rows, entry, kernel
from eulerparams_control.laws._old.linear import Vec, norm
from eulerparams_control.laws._old.rotations import body_rates
from eulerparams_control.motion.dilation import Dilated, Ramped, is_within, ramped, within
from eulerparams_control.motion.frames import DesiredFrame, apart, read_frame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.trajectories import Trajectory, rotation_vector_at_end

# A pose is passed no faster than this multiple of the slower mean speed beside it: so the way from
# pose to pose goes beyond its ends by less than half of itself, and a pose that is kept is kept.
_STEEPEST = 3.0

# Poses without times that are so close [s at full speed] are one; with times, those that are so
# close [m, rad] are the same.  The speeds of the tip [m/s, rad/s] where no limits are known.
_SHORTEST, _SAME, _SPEEDS = 1e-6, 1e-9, (0.25, 1.0)

# Each sweep over the poses leaves a quarter of the difference of the accelerations; the change of
# a velocity [of the largest one] that ends them, and their largest number.
_SETTLED, _SWEEPS = 1e-7, 50


@kernel
def _segment(
    start: DesiredFrame, end: DesiredFrame, T: float, part: int, knows_start: bool, knows_end: bool
) -> tuple[float, Vec, Vec]:
    """Return the mean speed of a segment, and the accelerations at its ends, base frame.

    Args:
        start, end: the frames at its ends.
        T: [s] between them.
        part: 0 the point, 1 the turning.
        knows_start, knows_end: whether velocity and acceleration there are known.
    """
    if part == 0:
        x, v_0, v_1, known_0, known_1 = (
            end.p_d - start.p_d, start.dp_d, end.dp_d, start.ddp_d, end.ddp_d
        )  # fmt: skip
    else:
        x, v_1, known_1 = rotation_vector_at_end(start, end)
        v_0, known_0 = start.R_d.T @ start.omega_d, start.R_d.T @ start.domega_d
    d = (1.0 / T) * x
    a_0, a_1 = (6.0 * d - 4.0 * v_0 - 2.0 * v_1) / T, (2.0 * v_0 + 4.0 * v_1 - 6.0 * d) / T
    bend = (12.0 * d - 6.0 * v_0 - 6.0 * v_1) / T
    if knows_start:
        a_0, a_1 = known_0, known_0 - bend
    if knows_end:
        a_0, a_1 = known_1 + bend, known_1
    if part == 1:
        a_0, a_1 = start.R_d @ a_0, end.R_d @ body_rates(x, v_1, a_1)[1]
    return norm(d), a_0, a_1


@entry
def _solve(times: Row, frames: Rows, known: Row, part: int) -> None:
    """Fill in velocities and accelerations, of the point (part 0) or the turning (part 1).

    Args:
        times: (N,) [s].
        frames: (N, 24).
        known: (N,) where it is not 0 nothing is changed.
        part: 0 or 1.
    """
    N, v, a = len(times), 12 + 3 * part, 18 + 3 * part
    fastest = 0.0
    for _ in range(_SWEEPS):
        change = 0.0
        for k in range(N):
            if known[k] != 0.0:
                continue
            slowest, weight, jump, mean = math.inf, 0.0, Vec(0.0, 0.0, 0.0), Vec(0.0, 0.0, 0.0)
            is_end = k == 0 or k == N - 1
            for n in range(max(k - 1, 0), min(k + 1, N - 1)):  # the segments beside it
                T, knows = times[n + 1] - times[n], (known[n] != 0.0, known[n + 1] != 0.0)
                start, end = read_frame(frames[n], 0), read_frame(frames[n + 1], 0)
                speed, a_0, a_1 = _segment(start, end, T, part, knows[0], knows[1])
                slowest = min(slowest, speed)
                if is_end and (N > 2 or knows[0] or knows[1]):  # the acceleration is even there
                    jump, weight = a_0 - a_1, 6.0 / T
                    mean = a_0 if k == 0 else a_1
                else:
                    here = a_0 if n == k else -a_1
                    jump, mean = jump + here, mean + (0.5 if n == k else -0.5) * here
                    weight += 6.0 / T if knows[0] or knows[1] else 4.0 / T
            was = Vec(frames[k, v], frames[k, v + 1], frames[k, v + 2])
            now = was + (1.0 / weight) * jump
            most = _STEEPEST * slowest
            is_steep = norm(now) >= most
            if is_steep:
                now = (most / max(norm(now), 1e-300)) * now
                mean = Vec(0.0, 0.0, 0.0)
            frames[k, v], frames[k, v + 1], frames[k, v + 2] = now.x, now.y, now.z
            frames[k, a], frames[k, a + 1], frames[k, a + 2] = mean.x, mean.y, mean.z
            change, fastest = max(change, norm(now - was)), max(fastest, norm(now))
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
        self._rows = np.concatenate([part for frame in frames for part in frame], axis=None)
        self._rows = self._rows.reshape(-1, 24)
        moves = self._known & self._rows[:, 12:18].any(axis=1)
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
            times, rows, known = knots.times[1:], knots.rows[1:], knots.known[1:]
            knots = _Knots(times, rows, known, (False, knots.rests[1]))
        late = late - float(knots.times[0]) if self.is_timed else 0.0
        motion = within(knots._replace(times=knots.times - knots.times[0]).spline, limits)
        if isinstance(motion, Dilated) and late > 0.0:
            late = motion.time_at(late)
        return ramped(motion, knots.rests, limits), late

    def _from(self, here: DesiredFrame, late: float, speeds: tuple[float, float]) -> "_Knots":
        """Return what is to be passed from where the tip is."""
        moves = bool(here.dp_d.any() or here.omega_d.any())
        times, rows, known = np.array(self.times), self._rows, self._known
        rests = not (known[0] or moves)
        if not self.is_timed or late < times[0]:
            times, rests = np.append(max(late, 0.0), times), not moves
            rows, known = np.vstack((here.row, rows)), np.append(moves, known)
        ways = apart.rows(np.hstack((rows[:-1], rows[1:])))[:, :2]
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
        return _Knots(times[kept], rows[kept], known, (rests, not known[-1]))


class _Knots(NamedTuple):
    """What a spline is to pass.

    Attributes:
        times: (N,) [s].
        rows: (N, 24) frames.
        known: (N,) whether their velocities and accelerations are.
        rests: whether it rests at its start, at its end.
    """

    times: Array
    rows: Array
    known: Array
    rests: tuple[bool, bool]

    def resting(self) -> "_Knots":
        """Return the same with ends at rest that are known."""
        rows, known = self.rows.copy(), self.known.copy()
        for end, rests in zip((0, -1), self.rests, strict=True):
            if rests:
                rows[end, 12:], known[end] = 0.0, True
        return self._replace(rows=rows, known=known)

    @property
    def spline(self) -> Trajectory:
        """The spline through the frames."""
        rows = self.rows.copy()
        rows[np.logical_not(self.known), 12:] = 0.0
        if len(rows) > 1:
            for part in (0, 1):
                _solve(self.times, rows, self.known.astype(float), part)
        return Trajectory(self.times.tolist(), [DesiredFrame.of(row) for row in rows])
