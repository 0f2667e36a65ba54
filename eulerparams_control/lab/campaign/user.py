"""The user of the arm: sends motions while the faults come, and again when they are over."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eulerparams_control.lab.campaign.plan import (
    CHUNKS,
    FAULTY,
    GOALS,
    NOTHING,
    POSES,
    SMOOTH,
    STREAM,
    TWISTS,
    WAY_POINTS,
    Pose,
    SequencePlan,
    StreamDraw,
)
from eulerparams_control.lab.faults.base import Fault
from eulerparams_control.lab.faults.kinds import ClockJump
from eulerparams_control.laws.rotations import Array, angle_between, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.robot import Robot

REFERENCE, TARGET_POSE, TARGET_TWIST = "reference", "target_pose", "target_twist"
TOPIC = {POSES: TARGET_POSE, GOALS: TARGET_POSE, TWISTS: TARGET_TWIST}
"""On which topic the pieces of a motion go; else ``REFERENCE``."""

_TURN = 5.0  # [rad/m] of the noise

_SPACING = 0.1  # [s] between the points of a chunk

# So much of a period early is in time: the rounding of sums of times.
_ROUNDING = 1e-6

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


class Sent(NamedTuple):
    """A message of the user.

    Attributes:
        topic: on which.
        motion: a pose is its only frame, a twist that of its only frame.
        stamp: [s] of the sequence; None: at receipt.
        note: what is said of it, "" if nothing.
    """

    topic: str
    motion: Trajectory
    stamp: float | None = None
    note: str = ""


class Stream:
    """Sends a motion piece by piece.

    Args:
        draw: how.
        kind: of the motion, one of ``SMOOTH_MOTIONS``.
        motion: what.
        start: [s] of the sequence at which it begins.
        tick: [s] between two looks at what is due: no more comes at once than in that time.
        random: of the jitter and the noise.
    """

    def __init__(
        self,
        draw: StreamDraw,
        kind: str,
        motion: Trajectory,
        start: float,
        tick: float,
        random: np.random.Generator,
    ) -> None:
        self._draw, self._kind, self._motion, self._start = draw, kind, motion, start
        self._random = random
        self._most = max(1, round(draw.rate * tick))
        self._sent, self._due = 0, 0.0  # how many, and when the next one is due [periods]

    def due(self, t: float) -> Iterator[Sent]:
        """Yield what is to be sent at t [s]; a goal only where it is another one."""
        passed = round((t - self._start) * 1e6) * self._draw.rate / 1e6
        times = []
        while self._due <= passed + _ROUNDING:
            times.append(self._due)
            self._sent += 1
            jitter = self._draw.jitter
            late = jitter * self._random.uniform(-1.0, 1.0) if jitter else 0.0
            self._due = self._sent + late
        for before in reversed(range(min(len(times), self._most))):
            note = "a stream begins" if self._sent == len(times) and not before else ""
            yield self._piece(t - before / self._draw.rate, note)

    def _piece(self, t: float, note: str) -> Sent:
        draw, kind, topic = self._draw, self._kind, TOPIC.get(self._kind, REFERENCE)
        stamp = None if draw.skew is None else t + draw.skew
        since = t - self._start
        if kind == CHUNKS:
            times = np.arange(_SPACING, draw.ahead + _SPACING, _SPACING)
            frames = [self._spoilt(self._motion.sample(since + ahead)) for ahead in times]
            return Sent(topic, Trajectory(times.tolist(), frames), stamp, note)
        if kind == GOALS:
            since = next((time for time in self._motion.times if time > since), np.inf)
        frame = self._spoilt(self._motion.sample(since))
        return Sent(topic, Trajectory([0.0], [frame]), stamp, note)

    def _spoilt(self, frame: DesiredFrame) -> DesiredFrame:
        """Return a frame as it is sent: with noise, and perhaps without its twist."""
        noise = self._draw.noise
        if noise:
            step, turn = noise * self._random.standard_normal((2, 3))
            frame = frame._replace(p_d=frame.p_d + step, R_d=exp(_TURN * turn) @ frame.R_d)
        keeps = self._draw.twists or self._kind == TWISTS
        return frame if keeps else frame.at_rest()


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
