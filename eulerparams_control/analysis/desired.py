"""The desired frame at the stamps of a recording, from the references in it.

A reference counts from when the controller said that it began, else from the first tick that was
sent after it, as ``motion.Shaper`` does it in the controller.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.frames import Frames, moved
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory

Stamps = NDArray[np.int64]

NO_START = -1
"""Start of a motion that begins at receipt."""


@dataclass(frozen=True)
class RecordedReferences:
    """K references in the order in which they were sent.

    Attributes:
        sent: (K,) [ns].
        start: (K,) [ns] when they begin; ``NO_START`` is at the first tick after they were sent.
        frames: their first frames; a set-point has no other.
        trajectories: those that are no set-points, by number.
    """

    sent: Stamps
    start: Stamps
    frames: Frames = field(repr=False)
    trajectories: Mapping[int, Trajectory] = field(repr=False)


@dataclass(frozen=True)
class _Motion:
    """The motion that is followed since a stamp: a trajectory, or a set-point."""

    start: int
    trajectory: Trajectory | None
    frame: Frames

    def at(self, stamps: Stamps, lasting: float) -> Frames:
        t = (stamps - self.start) / 1e9
        if self.trajectory is not None:
            with np.errstate(over="ignore", invalid="ignore"):  # its rotation may be non-finite
                return Frames(*self.trajectory.samples(t))
        return moved(self.frame.take(np.zeros(len(t), dtype=np.intp)), t, lasting)


class DesiredFrames:
    """The desired frames along a recording, one block of it after the other.

    Args:
        lasting: [s] for which a set-point goes on without a successor.
        held: pose at a stamp, that the controller holds until the first reference begins.

    Attributes:
        knows_trajectories: whether any motion that began was one, no set-point.
    """

    def __init__(self, lasting: float, held: Callable[[int], DesiredFrame]) -> None:
        self._lasting = lasting
        self._held = held
        self._motion: _Motion | None = None
        self.knows_trajectories = False

    def follow(
        self, references: RecordedReferences, ticks: Stamps, sent: Stamps, at: Stamps | None = None
    ) -> tuple[Frames, int]:
        """Return the frames at M stamps, and how many references are done with.

        Those that are not, which have not begun yet, are to be given again with the next block.

        Args:
            references: not given before, or not done with.
            ticks, sent: (N,) [ns] of the ticks of the controller, increasing.
            at: (M,) [ns] at which the frames are wanted, the ticks among them; None: the ticks.
        """
        N = len(ticks)
        sent = np.maximum.accumulate(sent) if N else sent
        received = np.searchsorted(sent, references.sent)  # the tick that finds it
        begins = np.maximum(received, np.searchsorted(ticks, references.start))
        replaced = np.append(received[1:], N)  # by the next one, before it began
        begun = np.flatnonzero(begins < replaced)
        done = int(np.searchsorted(received, N))
        if done and begins[done - 1] >= N:
            done -= 1
        stamps = ticks if at is None else at
        places = np.append(np.searchsorted(stamps, ticks), len(stamps))  # of the ticks
        received, begins = places[received], places[np.minimum(begins, N)]
        found = Frames.nowhere(len(stamps))
        going = self._motion
        if going is None and len(references.sent):
            self._hold(found, received, begins[begun], stamps)
        self._fill(found, going, references, begun, begins, stamps)
        return found, done

    def _hold(
        self, found: Frames, received: NDArray[np.intp], begins: NDArray[np.intp], stamps: Stamps
    ) -> None:
        """Write the pose that is held from the receipt of the first reference until one begins."""
        first = int(received[0])
        if first == len(found):
            return
        held = Frames.of([self._held(int(stamps[first]))])
        self._motion = _Motion(int(stamps[first]), None, held)
        here = slice(first, int(begins[0]) if len(begins) else len(found))
        _put(found, here, self._motion.at(stamps[here], self._lasting))

    def _fill(
        self,
        found: Frames,
        going: _Motion | None,
        references: RecordedReferences,
        begun: NDArray[np.intp],
        begins: NDArray[np.intp],
        stamps: Stamps,
    ) -> None:
        if going is not None:
            first = int(begins[begun[0]]) if len(begun) else len(stamps)
            _put(found, slice(0, first), going.at(stamps[:first], self._lasting))
        starts = np.where(
            references.start[begun] == NO_START, stamps[begins[begun]], references.start[begun]
        )
        ends = np.append(begins[begun][1:], len(stamps))
        self._streamed(found, references, begun, starts, begins[begun], ends, stamps)
        for place, k in enumerate(begun.tolist()):
            here = slice(int(begins[k]), int(ends[place]))
            trajectory = references.trajectories.get(k)
            frame = references.frames.take(np.array([k]))
            self.knows_trajectories |= trajectory is not None
            if trajectory is not None and self._motion is not None:
                last = self._motion.at(stamps[here][:1], self._lasting).frame(0)
                trajectory = trajectory.from_frame(last)
            self._motion = _Motion(int(starts[place]), trajectory, frame)
            if trajectory is not None:
                _put(found, here, self._motion.at(stamps[here], self._lasting))

    def _streamed(
        self,
        found: Frames,
        references: RecordedReferences,
        begun: NDArray[np.intp],
        starts: Stamps,
        begins: NDArray[np.intp],
        ends: NDArray[np.intp],
        stamps: Stamps,
    ) -> None:
        """Write the set-points, all at once: there may be one for each tick."""
        streamed = np.array([k not in references.trajectories for k in begun.tolist()], dtype=bool)
        places = np.flatnonzero(streamed)
        which = np.repeat(places, (ends - begins)[streamed])
        if not len(which):
            return
        ticks = np.concatenate([np.arange(begins[i], ends[i]) for i in places.tolist()])
        dt = (stamps[ticks] - starts[which]) / 1e9
        frames = moved(references.frames.take(begun[which]), dt, self._lasting)
        _put(found, ticks, frames)


def _put(found: Frames, here: slice | NDArray[np.intp], frames: Frames) -> None:
    for column, values in zip(found.columns, frames.columns, strict=True):
        column[here] = values
