"""References besides trajectories: set-points, goals, twists."""

from typing import NamedTuple

from eulerparams_control.laws.jit import Array
from eulerparams_control.motion.frames import DesiredFrame


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

    @property
    def moves(self) -> bool:
        """Whether it has a twist."""
        return self.frames[0].moves

    def sample(self, t: float) -> DesiredFrame:
        """Return the desired frame at t [s]."""
        if t > self.lasting:
            self._held = self._held or self.frames[0].moved(self.lasting).at_rest()
            return self._held
        return self.frames[0].moved(t) if t > 0 else self.frames[0]


class Goal(SetPoint):
    """A pose to go to, from wherever the tip is; a stream of them is followed."""

    def __init__(self, frame: DesiredFrame) -> None:
        super().__init__(frame.at_rest(), 0.0)


class Jog(NamedTuple):
    """A twist of the tip.

    Attributes:
        twist: (6,) [m/s, rad/s] base frame, at the tip.
        lasting: [s] for which it goes on without a successor.
    """

    twist: Array
    lasting: float
