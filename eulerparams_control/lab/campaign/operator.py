"""The user of the arm: sends motions while the faults come, and again when they are over."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from eulerparams_control.lab.campaign.plan import STREAM, WAY_POINTS, Pose, SequencePlan
from eulerparams_control.lab.faults import Fault
from eulerparams_control.laws.rotations import Array, angle_between
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.robot import Robot

BEGINNING = 0.4
"""[s] of a sequence at which the times of its faults begin, and its first motion."""

_LEAST = 0.5  # [s] until the faults are over, at least
_STREAM_RATE = 50.0  # [Hz] of set-points

# [s] after the last fault: the user waits, and sends the arm to its last pose within, and then
# lets it come to rest.
_PAUSE, _LEAST_MOTION, _REST = 0.8, 1.0, 0.8

# [s] more, where the arm is slowed down near a singularity and not within [m], [deg] of its goal.
_LONGER = 3.0
_THERE = 0.001, 0.2

_SPEED, _TURNING = 0.15, 0.75  # [m/s], [rad/s] of the last motion at most, on average


class User:
    """Leads the arm through a sequence.

    Args:
        plan: the sequence.
        model: of the arm.
        faults: of the sequence.
        home: (n,) where the arm is at first.

    Attributes:
        faults: as given.
        quiet: [s] from when on no fault acts; it may come later than planned.
        has_begun: whether anything was sent.
    """

    def __init__(
        self, plan: SequencePlan, model: Robot, faults: Sequence[Fault], home: Array
    ) -> None:
        self._plan, self._model = plan, model
        self._home = self.pose(home)
        self._motion = plan.way_points(self._home)
        self._last = plan.last_pose(self._home)
        self.quiet = BEGINNING + max([_LEAST, *(fault.end for fault in faults)])
        self.faults, self.has_begun = tuple(faults), False
        self._is_sent_again, self._lasting = False, _LEAST_MOTION
        self._streamed = -1
        self._line: Trajectory | None = None

    @property
    def _again(self) -> float:
        return self.quiet + _PAUSE

    @property
    def end(self) -> float:
        """When the sequence ends [s]; later where the arm is far from where it is sent."""
        return self._again + self._lasting + _REST

    def pose(self, q: Array) -> Pose:
        """Return the pose of the tip at q (n,)."""
        state = self._model.state(q, np.zeros_like(q))
        return state.p_e, state.R_e

    def motions(self, t: float, q: Array) -> Iterator[tuple[Trajectory, str]]:
        """Yield what is sent at t [s], the arm being at q (n,), and what to note of it."""
        start = BEGINNING
        is_stream = self._plan.motion == STREAM
        if self._plan.motion == WAY_POINTS and t >= start and not self.has_begun:
            self.has_begun = True
            yield self._motion, "a motion is sent"
        if is_stream and start <= t < self.quiet:
            yield from self._set_point(t, self._motion.from_frame(DesiredFrame(*self._home)), start)
        if t >= self._again and not self._is_sent_again:
            self._is_sent_again = True
            distance, angle = self.tip_error(q)
            by_angle = math.radians(angle) / _TURNING
            self._lasting = max(_LEAST_MOTION, distance / _SPEED, by_angle)
            last = Trajectory([self._lasting], [DesiredFrame(*self._last)])
            self._line = last.from_frame(DesiredFrame(*self.pose(q)))
            yield from [] if is_stream else [(last, "the last motion is sent")]
        if is_stream and self._line is not None:
            yield from self._set_point(t, self._line, self._again)

    def _set_point(
        self, t: float, motion: Trajectory, start: float
    ) -> Iterator[tuple[Trajectory, str]]:
        """Yield the set-point of a motion that began at ``start`` [s], if one is due."""
        number = int(round((t - start) * 1e6) * _STREAM_RATE / 1e6)
        note = "" if number == self._streamed + 1 else "a stream begins"
        if number != self._streamed:
            self._streamed = number
            yield Trajectory([0.0], [motion.sample(t - start)]), note

    def push(self, t: float) -> tuple[float, ...] | None:
        """Return the wrench (6,) on the tool at t [s]."""
        return self._plan.push if BEGINNING <= t < self.quiet else None

    def is_done(self, t: float, q: Array) -> bool:
        """Whether the arm, at q (n,), has had its time at t [s]; a while more if it is slow."""
        return t > self.end + _LONGER or (t > self.end and self._is_there(q))

    def _is_there(self, q: Array) -> bool:
        distance, angle = self.tip_error(q)
        return distance < _THERE[0] and angle < _THERE[1]

    def tip_error(self, q: Array) -> tuple[float, float]:
        """Return how far [m], [deg] the tip is at q (n,) from where it was sent at last."""
        p, R = self.pose(q)
        p_d, R_d = self._last
        return float(np.linalg.norm(p - p_d)), float(np.degrees(angle_between(R, R_d)))
