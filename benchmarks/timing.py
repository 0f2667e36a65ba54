"""Time things side by side: in turn, many times, so that noise meets all alike."""

import time
from collections.abc import Callable

import numpy as np

Calls = dict[str, Callable[[], object]]


def side_by_side(calls: Calls, repeat: int = 200, loops: int = 20) -> dict[str, float]:
    """Return the median time [s] of each call, measured in turn in one run."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeat):
        for name, call in calls.items():
            begin = time.perf_counter()
            for _ in range(loops):
                call()
            times[name].append((time.perf_counter() - begin) / loops)
    return {name: float(np.median(values)) for name, values in times.items()}
