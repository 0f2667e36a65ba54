"""The motion that a controller follows: a trajectory, a streamed set-point, or a held frame."""

from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory


class SetPoint:
    """One streamed frame: extrapolated at its acceleration for a while, then held.

    Args:
        frame: the desired frame at time 0.
        lasting: [s] for which it goes on without a successor.
    """

    def __init__(self, frame: DesiredFrame, lasting: float) -> None:
        self.frames = [frame]
        self.lasting = lasting
        self._held: DesiredFrame | None = None

    def has_ended(self, t: float) -> bool:
        """Whether it was to move, but is held at t [s], as no successor came."""
        frame = self.frames[0]
        return t > self.lasting and bool(frame.dp_d.any() or frame.omega_d.any())

    def sample(self, t: float) -> DesiredFrame:
        """Return the desired frame at t [s]."""
        if t > self.lasting:
            self._held = self._held or self.frames[0].moved(self.lasting).at_rest()
            return self._held
        return self.frames[0].moved(t) if t > 0 else self.frames[0]


class DesiredMotion:
    """The motion that a controller follows: a trajectory, a set-point, or a held frame.

    Its state is explicit: the motion and the time at which it started, the motion that is to
    replace it with its start (None: at the next sample), and the frame sampled last.
    """

    def __init__(self, held: DesiredFrame) -> None:
        self.hold(held)

    def hold(self, frame: DesiredFrame) -> None:
        """Hold the pose of ``frame`` from now on."""
        self._motion: Trajectory | SetPoint | None = None
        self._start = self._late = 0
        self._next: tuple[Trajectory | SetPoint, int | None] | None = None
        self.last = frame.at_rest()

    @property
    def is_holding(self) -> bool:
        """Whether no motion was given since it began to hold."""
        return self._motion is None and self._next is None

    @property
    def began(self) -> int | None:
        """Time [ns] at which the trajectory that is followed began; None if there is none."""
        return self._start if isinstance(self._motion, Trajectory) else None

    def has_stopped(self, t: int) -> bool:
        """Whether set-points that moved have stopped coming, so that the last is held."""
        if not isinstance(self._motion, SetPoint):
            return False
        return self._motion.has_ended((t - self._start - self._late) / 1e9)

    def wait(self, dt: int) -> None:
        """Let the present motion be later by dt [ns] than it was to be."""
        self._late += dt

    def follow(self, motion: Trajectory | SetPoint, start: int | None) -> None:
        """Follow a motion from the time ``start`` [ns], or from the next sample if None.

        Until then the present motion goes on.
        """
        self._next = (motion, start)

    def sample(self, t: int) -> DesiredFrame:
        """Return the desired frame at the time t [ns]."""
        if self._motion is not None:
            self.last = self._motion.sample((t - self._start - self._late) / 1e9)
        if self._next is not None and (self._next[1] is None or t >= self._next[1]):
            (motion, start), self._next = self._next, None
            if isinstance(motion, Trajectory):
                motion = motion.from_frame(self.last)
            self._motion = motion
            self._start, self._late = t if start is None else start, 0
            self.last = self._motion.sample((t - self._start) / 1e9)
        return self.last
