"""The steady clock by which messages age: of the machine, or of a simulation in its place."""

import time
from collections.abc import Callable

_now: Callable[[], float] = time.monotonic


def steady() -> float:
    """Return the time [s] of the clock that never jumps."""
    return _now()


def set_steady(clock: Callable[[], float] = time.monotonic) -> None:
    """Let ages go by another clock, where a simulation in one process makes the time."""
    global _now
    _now = clock
