"""Time: the steady clock by which messages age, and which time counts for a controller.

Where time is real a state ages by when it came, on the steady clock.  Where time is simulated,
in lock-step say, only its stamp counts.  :class:`Clock` alone knows which.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

_now: Callable[[], float] = time.monotonic


def steady() -> float:
    """Return the time [s] of the clock that never jumps."""
    return _now()


def set_steady(clock: Callable[[], float] = time.monotonic) -> None:
    """Let ages go by another clock, where a simulation in one process makes the time."""
    global _now
    _now = clock


class Instant(NamedTuple):
    """When a state was.

    Attributes:
        stamp: [ns].
        receipt: when it came, steady clock [s]; None where time is simulated.
    """

    stamp: int
    receipt: float | None

    @property
    def seconds(self) -> float:
        """The time [s] that counts."""
        return self.stamp / 1e9 if self.receipt is None else self.receipt

    def since(self, other: "Instant") -> float:
        """Return the time [s] that has passed since another instant."""
        if self.receipt is None or other.receipt is None:
            return (self.stamp - other.stamp) / 1e9
        return self.receipt - other.receipt


class Clock:
    """The time of the states of an arm.

    Attributes:
        last: the instant of the state that was taken last; None before the first.
    """

    def __init__(self) -> None:
        self.last: Instant | None = None

    @property
    def is_simulated(self) -> bool:
        """Whether the stamps count."""
        return self.last is None or self.last.receipt is None

    def step(self, at: Instant) -> tuple[float, float]:
        """Return how far the stamps went on, and how long no state came [s]; 0 if not known."""
        last = self.last
        if last is None:
            return 0.0, 0.0
        dt = (at.stamp - last.stamp) / 1e9
        if last.receipt is None or at.receipt is None:
            return dt, 0.0
        return dt, at.receipt - last.receipt

    def time(self, receipt: float | None) -> float:
        """Return the time [s] of something that came at ``receipt`` [s]."""
        return Instant(0 if self.last is None else self.last.stamp, receipt).seconds

    def now(self) -> float:
        """Return the time [s] of the last state; 0 before the first."""
        return 0.0 if self.last is None else self.last.seconds

    def late(self, start: int | None) -> float:
        """Return how long ago [s] the stamp ``start`` [ns] was; 0 for the next state."""
        if start is None or self.last is None:
            return 0.0
        return (self.last.stamp - start) / 1e9
