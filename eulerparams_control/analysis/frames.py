"""Frames over time as arrays: the desired or the compliant frame at N instants."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion import frames as formulas
from eulerparams_control.motion.frames import AT_ORIGIN, DesiredFrame, Placement


@dataclass(frozen=True)
class Frames:
    """A frame at N instants, base frame; NaN where there is none.

    Attributes:
        p: (N, 3) [m] its origin.
        R: (N, 3, 3) its orientation.
        dp, omega: (N, 3) [m/s], [rad/s].
        ddp, domega: (N, 3) [m/s^2], [rad/s^2].
    """

    p: Array = field(repr=False)
    R: Array = field(repr=False)
    dp: Array = field(repr=False)
    omega: Array = field(repr=False)
    ddp: Array = field(repr=False)
    domega: Array = field(repr=False)

    @classmethod
    def nowhere(cls, count: int) -> "Frames":
        """Return as many instants at which there is no frame."""
        vectors = (np.full((count, 3), np.nan) for _ in range(5))
        p, *others = vectors
        return cls(p, np.full((count, 3, 3), np.nan), *others)

    @classmethod
    def of(cls, frames: Sequence[DesiredFrame | None]) -> "Frames":
        """Return frames, or None where there is none, as arrays."""
        found = cls.nowhere(len(frames))
        for index, frame in enumerate(frames):
            if frame is not None:
                for column, value in zip(found.columns, frame, strict=True):
                    column[index] = value
        return found

    @property
    def columns(self) -> tuple[Array, ...]:
        """Its arrays, in the order of the fields of ``DesiredFrame``."""
        return tuple(getattr(self, entry.name) for entry in fields(self))

    def __len__(self) -> int:
        return len(self.p)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) whether there is a frame."""
        return ~np.isnan(self.R[:, 0, 0])

    def frame(self, index: int) -> DesiredFrame:
        """Return the frame at one instant."""
        return DesiredFrame(*(column[index] for column in self.columns))

    def take(self, index: NDArray[np.intp]) -> "Frames":
        """Return the frames at the given places; none where a place is negative."""
        taken = Frames(*(column[index] for column in self.columns))
        for column in taken.columns:
            column[index < 0] = np.nan
        return taken

    def at(self, own: NDArray[Any], t: NDArray[Any]) -> "Frames":
        """Return the frames at instants t (M,), those that are among ``own`` (N,), sorted."""
        if not len(own):
            return Frames.nowhere(len(t))
        index = np.minimum(np.searchsorted(own, t), len(own) - 1)
        return self.take(np.where(own[index] == t, index, -1))

    def carrying(self, point: Placement) -> "Frames":
        """Return what these frames carry rigidly at ``point``: see ``DesiredFrame.carrying``."""
        if point is AT_ORIGIN:
            return self
        return Frames(*formulas.carried(DesiredFrame(*self.columns), point))


def moved(frames: Frames, dt: Array, lasting: float) -> Frames:
    """Return streamed frames dt (N,) [s] after their start, as ``SetPoint.sample`` gives them.

    They go on at their acceleration for ``lasting`` [s], and are held then.
    """
    end = formulas.moved(DesiredFrame(*frames.columns), np.clip(dt, 0.0, lasting))
    held = (dt > lasting)[:, None]
    return Frames(end.p_d, end.R_d, *(np.where(held, 0.0, rate) for rate in end[2:]))
