"""A motion that is sent piece by piece: when each piece is due, and what it says."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from eulerparams_control.lab.campaign.draws import CHUNKS, GOALS, POSES, TWISTS, StreamDraw
from eulerparams_control.laws.rotations import exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory

REFERENCE, TARGET_POSE, TARGET_TWIST = "reference", "target_pose", "target_twist"
TOPIC = {POSES: TARGET_POSE, GOALS: TARGET_POSE, TWISTS: TARGET_TWIST}
"""On which topic the pieces of a motion go; else ``REFERENCE``."""

_TURN = 5.0  # [rad/m] of the noise

_SPACING = 0.1  # [s] between the points of a chunk

# So much of a period early is in time: the rounding of sums of times.
_ROUNDING = 1e-6


class Sent(NamedTuple):
    """What a user sends.

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

