"""Which states were answered by a command of the same stamp, how soon, and which were not."""

import math
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

_LEAST, _DECADES, _PER_DECADE = 1e-6, 8, 232  # from 1 us to 100 s; 10^(1/232) is 1.01

PATIENCE = 6.0
"""[s] after which a state without a command is missed; by then all reports of its time are in."""


class Histogram:
    """Counts of times [s]; a percentile is right within one hundredth of it."""

    def __init__(self) -> None:
        self._counts = np.zeros(_DECADES * _PER_DECADE + 1, dtype=np.int64)
        self.largest = 0.0

    def __len__(self) -> int:
        return int(self._counts.sum())

    def add(self, seconds: float) -> None:
        """Count one time [s]."""
        place = math.log10(max(seconds, _LEAST) / _LEAST) * _PER_DECADE
        self._counts[min(int(place), len(self._counts) - 1)] += 1
        self.largest = max(self.largest, seconds)

    def merge(self, other: "Histogram") -> None:
        """Count all that another one has counted."""
        self._counts += other._counts
        self.largest = max(self.largest, other.largest)

    def percentile(self, p: float) -> float:
        """Return the time [s] below which p percent are; NaN if there are none."""
        total = len(self)
        if not total:
            return math.nan
        wanted = max(1, math.ceil(total * p / 100))
        place = int(np.searchsorted(np.cumsum(self._counts), wanted))
        return float(_LEAST * 10 ** ((place + 0.5) / _PER_DECADE))


@dataclass(frozen=True)
class Missed:
    """A state that was not answered.

    Attributes:
        stamp: [ns] its own.
        sent: [s] when it was published.
    """

    stamp: int
    sent: float


class Ledger:
    """The states and commands of one robot.

    Attributes:
        latencies: from a state's publication to the receipt of its command, since ``turn``.
        states, commands: how many, since ``turn``.
        strays: commands that answer no state that was seen, or one that was answered.
    """

    def __init__(self) -> None:
        self._open: OrderedDict[int, float] = OrderedDict()
        self._early: OrderedDict[int, float] = OrderedDict()
        self.strays = 0
        self.turn()

    def turn(self) -> None:
        """Begin a new page."""
        self.latencies, self.states, self.commands = Histogram(), 0, 0

    def state(self, stamp: int, sent: float) -> None:
        """Write down a state stamped so [ns] that was published at ``sent`` [s]."""
        self.states += 1
        received = self._early.pop(stamp, None)
        if received is None:
            self._open[stamp] = sent
        else:
            self.latencies.add(received - sent)

    def command(self, stamp: int, received: float) -> None:
        """Write down a command stamped so [ns] that was received at ``received`` [s].

        It may be read before its state, which came on another way.
        """
        sent = self._open.pop(stamp, None)
        self.commands += 1
        if sent is None:
            self._early[stamp] = received
        else:
            self.latencies.add(received - sent)

    def missed(self, now: float) -> list[Missed]:
        """Return the states that have waited too long at ``now`` [s], and forget them."""
        self.strays += len(_outdated(self._early, now))
        return [Missed(stamp, sent) for stamp, sent in _outdated(self._open, now)]

    def forget(self) -> None:
        """Wait for no answer any more: the clock was set, or a node restarted."""
        self._open.clear()
        self._early.clear()


def _outdated(waiting: OrderedDict[int, float], now: float) -> list[tuple[int, float]]:
    """Take out and return what has waited for longer than the patience at ``now`` [s]."""
    found = []
    while waiting and now - next(iter(waiting.values())) >= PATIENCE:
        found.append(waiting.popitem(last=False))
    return found
