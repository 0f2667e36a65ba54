"""The references of a bag that were sent and have not begun yet."""

import numpy as np

from eulerparams_control.analysis.decode import Rows, joined
from eulerparams_control.analysis.desired import RecordedReferences
from eulerparams_control.analysis.frames import Frames
from eulerparams_control.analysis.parsing import Parsers


class SentReferences:
    """References that are read part by part, and kept until they begin.

    Args:
        parsers: know their trajectories, and which of them began.
    """

    def __init__(self, parsers: Parsers) -> None:
        self._parsers = parsers
        self._pending: Rows | None = None

    def add(self, new: Rows | None) -> None:
        """Take those that were sent since."""
        parts = [part for part in (self._pending, new) if part is not None]
        self._pending = joined(parts).in_order() if parts else None

    def all(self) -> RecordedReferences:
        """Return them in the order in which they were sent."""
        found = self._pending
        if found is None:
            nothing = np.zeros(0, dtype=np.int64)
            return RecordedReferences(nothing, nothing, Frames.nowhere(0), {})
        for news, start in self._parsers.began.items():
            before = int(np.searchsorted(found.sent, news, side="right"))
            if before:
                found.stamp[before - 1] = start
        self._parsers.began.clear()
        trajectories = {
            k: self._parsers.trajectories[sent]
            for k, sent in enumerate(found.sent.tolist())
            if sent in self._parsers.trajectories
        }
        return RecordedReferences(found.sent, found.stamp, Frames(*found.values), trajectories)

    def forget(self, done: int) -> None:
        """Leave out the first of them."""
        if self._pending is None:
            return
        for sent in self._pending.sent[:done].tolist():
            self._parsers.trajectories.pop(sent, None)
        left = self._pending.take(np.arange(done, len(self._pending.sent)))
        self._pending = left if len(left.sent) else None
