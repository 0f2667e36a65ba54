"""Buffers of messages that were read of a bag and not used yet, one a topic."""

from collections.abc import Callable

import numpy as np

from eulerparams_control.analysis.decode import Rows, joined
from eulerparams_control.bags.reader import RawMessage

type Parse = Callable[[list[RawMessage]], tuple[list[Rows], int]]

LATEST = int(np.iinfo(np.int64).max)
"""A stamp [ns] that none exceeds."""

_BATCH = 8192  # most messages that are decoded at once
_BYTES = 64_000_000  # most bytes that are decoded at once
_BACK = 100_000_000  # [ns] largest step back of a stamp that is no jump: messages overtake
_MOST = 10  # messages of all topics in a part, for each state that it was to have
_ANSWERED = 500_000_000  # [ns] after which the answers to a state are in the bag


class Queue:
    """Messages of a topic that were read, decoded in batches, and not used yet.

    Args:
        parse: returns rows of messages, and how many of them are not valid.

    Attributes:
        invalid: how many messages were not valid.
        repeated: how many had the stamp of another one, but not its values.
        jumped: when the message was sent [ns] at which the stamps jump back; None if they do not.
    """

    def __init__(self, parse: Parse) -> None:
        self._parse = parse
        self._raw: list[RawMessage] = []
        self._bytes = 0
        self._rows: list[Rows] = []
        self._latest = -1
        self.invalid = self.repeated = 0
        self.jumped: int | None = None

    def add(self, message: RawMessage) -> None:
        """Take a message."""
        self._raw.append(message)
        self._bytes += len(message.data)
        if len(self._raw) >= _BATCH or self._bytes >= _BYTES:
            self._decode()

    def _decode(self) -> None:
        found, invalid = self._parse(self._raw)
        self._raw, self._bytes = [], 0
        self.invalid += invalid
        if found:
            new = joined(found).in_order()
            self._rows.append(new)
            self._watch(new)

    def _watch(self, new: Rows) -> None:
        """Note where the stamps jump back: the clock, or the simulator, restarted."""
        before = np.maximum.accumulate(np.concatenate(([self._latest], new.stamp)))
        back = np.flatnonzero(new.stamp < before[:-1] - _BACK)
        if self.jumped is None and len(back):
            self.jumped = int(new.sent[back[0]])
        self._latest = int(before[-1])

    def settle(self) -> None:
        """Decode what was read."""
        if self._raw:
            self._decode()

    def drop_after(self, sent: int) -> None:
        """Forget what was sent at that time [ns] or later."""
        self.settle()
        self._rows = [part.take(part.sent < sent) for part in self._rows]

    def until(self, stamp: int) -> Rows | None:
        """Return the rows up to a stamp; the last of them is kept for the next part."""
        self.settle()
        if not self._rows:
            return None
        everything, repeated = joined(self._rows).by_stamp()
        self.repeated += repeated
        n = int(np.searchsorted(everything.stamp, stamp, side="right"))
        self._rows = [everything.take(np.arange(max(n - 1, 0), len(everything.stamp)))]
        return everything.take(np.arange(n)) if n else None

    @property
    def has_any(self) -> bool:
        """Whether anything valid was read of the topic."""
        return self._latest >= 0

    def nth(self, count: int) -> int:
        """Return the stamp of the row with that number, from 1, or of the last."""
        self.settle()
        stamps = np.unique(np.concatenate([np.zeros(0, np.int64), *(p.stamp for p in self._rows)]))
        return int(stamps[min(count, len(stamps)) - 1]) if len(stamps) else LATEST

    def everything(self) -> Rows | None:
        """Return the rows in the order in which they came, and forget them."""
        self.settle()
        found, self._rows = self._rows, []
        return joined(found) if found else None


class Ends:
    """When a part is complete: its states are there, and the answers to them.

    Args:
        size: states of a part; 0 is all.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._states = self._others = self._states_at = 0
        self._at: int | None = None

    def see(self, log_time: int, is_state: bool) -> bool:
        """Count a message; return whether the part is complete."""
        self._states += is_state
        self._others += not is_state
        full = self._states >= self._size or self._others >= _MOST * self._size
        if self._size and self._at is None and full and self._states > 1:
            self._at, self._states_at = log_time, self._states
        return self._at is not None and log_time > self._at + _ANSWERED

    def count(self) -> int:
        """Return the states of the part that is complete, and begin the next."""
        self._states -= self._states_at
        self._others, self._at = 0, None
        return self._states_at
