"""Time things side by side: in turn, many times, so that noise meets all alike."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from rows import Row

type Call = Callable[[], object]
type Pair = tuple[str, str, Call, Call]
"""Against what, which, and the two that are compared; see :class:`Row`."""

_OTHER_WORK = np.ones(500_000)  # more than the caches of a core

_BURN = "import os\nbegun = os.getppid()\nwhile os.getppid() == begun: pass"


def side_by_side(calls: Sequence[Call], repeat: int, loops: int, cold: bool) -> list[float]:
    """Return the median time [s] of each call, in blocks in turn.

    Each is timed by itself: a block that lasts longer is interrupted more often by other
    processes.  Before a cold one there is a millisecond of other work and of sleep.
    """
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(repeat):
        for call, mine in zip(calls, times, strict=True):
            for _ in range(loops):
                if cold:
                    _OTHER_WORK.sum()
                    time.sleep(1e-3)
                begin = time.perf_counter()
                call()
                mine.append(time.perf_counter() - begin)
    return [float(np.median(mine)) for mine in times]


def compared(pairs: Sequence[Pair], repeat: int, loops: int = 20, cold=False) -> Iterator[Row]:
    """Yield the ratios of times of pairs; what is in several of them is measured once."""
    calls = list(dict.fromkeys(call for pair in pairs for call in pair[2:]))
    times = dict(zip(calls, side_by_side(calls, repeat, loops, cold), strict=True))
    for what, of, own, bare in pairs:
        yield Row.of_times(what, of, times[own], times[bare])


@contextmanager
def burning(count: int) -> Iterator[None]:
    """Let so many processes burn processor time meanwhile."""
    burners = [subprocess.Popen([sys.executable, "-c", _BURN]) for _ in range(count)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


def cpu_time(pid: int) -> float:
    """Return the processor time [s] that a process has taken: its clock, as Linux numbers it."""
    return time.clock_gettime((~pid << 3) | 2)
