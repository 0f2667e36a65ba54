"""The sweep of a map with two worker processes against one.

Both clusters are warm before the clock starts: Python and its imports, some seconds a worker, are
not in the times.  The two are timed in turn and the best of each counts, because other programs
that use the cores can only slow them down; the load of the machine is shown with the ratio.
"""

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

from eulerparams_control.lab.maps.definition import load_map
from eulerparams_control.lab.maps.engine import Engine, engine
from eulerparams_control.lab.maps.sweep import batches_of

ROUNDS = 4
SAMPLES = 24
FEWEST = 1.7


def run(rounds: int = ROUNDS) -> Iterator[tuple[str, str, str]]:
    """Yield what `make bench` shows: what, against what, the ratio."""
    kind = replace(load_map("failure").kind, samples=SAMPLES, trials=1)
    with ExitStack() as stack:
        engines = {workers: stack.enter_context(engine(workers)) for workers in (1, 2)}
        for each in engines.values():
            _seconds(each, replace(kind, samples=4))  # warm
        times: dict[int, list[float]] = {workers: [] for workers in engines}
        for _ in range(rounds):
            for workers, each in engines.items():
                times[workers].append(_seconds(each, kind))
    best = {workers: min(values) for workers, values in times.items()}
    load = os.getloadavg()[0]
    yield (
        f"map of {len(kind.cells())} simulations, one worker",
        f"two workers: {best[2]:.1f} s (load of {os.cpu_count()} cores: {load:.1f})",
        f"{best[1] / best[2]:.2f} (at least {FEWEST})",
    )


def _seconds(each: Engine, kind) -> float:
    batches = dict(enumerate(batches_of(kind)))
    begin = time.perf_counter()
    count = sum(len(rows) for _, rows in each(kind, batches))
    assert count == len(kind.cells())
    return time.perf_counter() - begin


if __name__ == "__main__":
    for row in run():
        print(*row, sep=" | ")
