"""What was read of a bag and is not looked at yet, topic by topic."""

from collections.abc import Callable

import numpy as np

from eulerparams_control.analysis.rows import Rows, joined
from eulerparams_control.bags.reader import RawMessage

type Parse = Callable[[list[RawMessage]], tuple[list[Rows], int]]

LATEST = int(np.iinfo(np.int64).max)
"""A stamp [ns] that none exceeds."""

_BATCH = 8192  # messages that are decoded at once
_ANSWERED = 500_000_000  # [ns] after which the answers to a state are in the bag


class Queue:
    """What was read of a topic, decoded in batches, and not given out yet.

    Args:
        parse: returns rows of messages, and how many of them are not valid.

    Attributes:
        invalid: how many messages were not valid.
    """

    def __init__(self, parse: Parse) -> None:
        self._parse = parse
        self._raw: list[RawMessage] = []
        self._rows: list[Rows] = []
        self.invalid = 0

    def add(self, message: RawMessage) -> None:
        """Take a message."""
        self._raw.append(message)
        if len(self._raw) >= _BATCH:
            self._decode()

    def _decode(self) -> None:
        found, invalid = self._parse(self._raw)
        self._rows += found
        self.invalid += invalid
        self._raw = []

    def until(self, stamp: int) -> Rows | None:
        """Return the rows up to a stamp; the last of them is kept for the next part."""
        if self._raw:
            self._decode()
        if not self._rows:
            return None
        everything = joined(self._rows).by_stamp()
        n = int(np.searchsorted(everything.stamp, stamp, side="right"))
        self._rows = [everything.take(np.arange(max(n - 1, 0), len(everything.stamp)))]
        return everything.take(np.arange(n)) if n else None

    def nth(self, count: int) -> int:
        """Return the stamp of the row with that number, from 1, or of the last."""
        if self._raw:
            self._decode()
        found = [part.stamp for part in self._rows] or [np.array([LATEST])]
        stamps = np.unique(np.concatenate(found))
        return int(stamps[min(count, len(stamps)) - 1])

    def everything(self) -> Rows | None:
        """Return the rows in the order in which they came, and forget them."""
        if self._raw:
            self._decode()
        found, self._rows = self._rows, []
        return joined(found) if found else None


class Ends:
    """When a part is complete: its states are there, and the answers to them.

    Args:
        size: states of a part; 0 is all.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._seen = 0
        self._at: int | None = None

    def see(self, log_time: int) -> None:
        """Count a state."""
        self._seen += 1
        if self._size and self._seen == self._size:
            self._at = log_time

    def reached(self, log_time: int) -> bool:
        """Return whether the part is complete."""
        return self._at is not None and log_time > self._at + _ANSWERED

    def count(self) -> int:
        """Return the states of the part that is complete, and begin the next."""
        self._seen -= self._size
        self._at = None
        return self._size
