"""The user of the arm: sends motions while the faults come, and again when they are over."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from eulerparams_control.lab.campaign.draws import CHUNKS, GOALS, NOTHING, POSES, STREAM, WAY_POINTS
from eulerparams_control.lab.campaign.plan import FAULTY, SMOOTH, Pose, SequencePlan
from eulerparams_control.lab.campaign.streams import REFERENCE, Sent, Stream
from eulerparams_control.lab.faults import ClockJump, Fault
from eulerparams_control.laws.rotations import Array, angle_between
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.robot import Robot

BEGINNING = 0.4
"""[s] of a sequence at which the times of its faults begin, and its first motion."""

_LEAST = 0.5  # [s] until the faults are over, at least
_CALM = 2.4  # the same where there are none, so that there is a motion

# [s] after the last fault: the user waits, and sends the arm to its last pose within, and then
# lets it come to rest.
_PAUSE, _LEAST_MOTION, _REST = 0.8, 1.0, 0.8

# [s] more, where the arm is slowed down near a singularity and not within [m], [deg] of its goal.
_LONGER = 3.0
_THERE = 0.001, 0.2

# [m/s], [rad/s] of the last motion at most, on average; where it is to be smooth, with peaks, and
# steps of a slow stream, that the limits of the tip allow.
_SPEED = {FAULTY: (0.15, 0.75), SMOOTH: (0.08, 0.35)}


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
        least = _CALM if plan.is_calm else _LEAST
        self.quiet = BEGINNING + max([least, *(fault.end for fault in faults)])
        self.faults, self.has_begun = tuple(faults), False
        self._is_sent_again, self._lasting = False, _LEAST_MOTION
        self._random = plan.random(4)
        self._streams: list[Stream] = []
        if plan.motion not in (WAY_POINTS, NOTHING):
            self._stream(self._motion.from_frame(DesiredFrame(*self._home)), BEGINNING)

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

    def motions(self, t: float, q: Array) -> Iterator[Sent]:
        """Yield what is sent at t [s], the arm being at q (n,)."""
        if self._plan.motion == WAY_POINTS and t >= BEGINNING and not self.has_begun:
            self.has_begun = True
            yield Sent(REFERENCE, self._motion, note="a motion is sent")
        if BEGINNING <= t < self.quiet and self._streams:
            yield from self._streams[0].due(t)
        if t >= self._again and not self._is_sent_again:
            self._is_sent_again = True
            last = self._last_motion(q)
            if self._plan.motion in (STREAM, CHUNKS, POSES, GOALS):
                self._stream(last.from_frame(DesiredFrame(*self.pose(q))), self._again)
            else:
                yield Sent(REFERENCE, last, note="the last motion is sent")
        yield from (sent for stream in self._streams[1:] for sent in stream.due(t))

    def _last_motion(self, q: Array) -> Trajectory:
        """Return the motion from q (n,) to the last pose, and note how long it lasts."""
        distance, angle = self.tip_error(q)
        speed, turning = _SPEED[self._plan.kind]
        by_angle = math.radians(angle) / turning
        self._lasting = max(_LEAST_MOTION, distance / speed, by_angle)
        return Trajectory([self._lasting], [DesiredFrame(*self._last)])

    def _stream(self, motion: Trajectory, start: float) -> None:
        """Send a motion piece by piece from ``start`` [s] on."""
        plan, draw = self._plan, self._plan.stream
        if self._streams:  # the last one is to lead the arm to its end
            has_other_clock = any(isinstance(fault, ClockJump) for fault in self.faults)
            draw = replace(draw, noise=0.0, skew=None if has_other_clock else draw.skew)
        tick = 1.0 / plan.robot.rate
        self._streams.append(Stream(draw, plan.motion, motion, start, tick, self._random))

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
