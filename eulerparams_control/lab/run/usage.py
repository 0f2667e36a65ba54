"""Processor time and memory of the processes of nodes, sampled from the kernel into a file."""

import csv
import os
import time
from contextlib import suppress
from pathlib import Path

from eulerparams_control.analysis.quantities.real_time import BESIDE, NodeSample
from eulerparams_control.lab.run.processes import Nodes

_EVERY, _MEMORY_EVERY = 0.2, 1.0  # [s] between two samples; memory takes longer to look at
_TICK = os.sysconf("SC_CLK_TCK")
_PRIVATE = ("Private_Clean:", "Private_Dirty:")


def usage_of(pid: int) -> tuple[float, float, float]:
    """Return RSS, USS [MiB] and CPU [s] of a process; raises OSError if it has ended."""
    process = Path("/proc", str(pid))
    sizes = [line.split() for line in (process / "smaps_rollup").read_text().splitlines()[1:]]
    rss = sum(int(size[1]) for size in sizes if size[0] == "Rss:")
    uss = sum(int(size[1]) for size in sizes if size[0] in _PRIVATE)
    # behind the name, which may have blanks, the fields from the third one on
    fields = (process / "stat").read_text().rpartition(")")[2].split()
    return rss / 1024, uss / 1024, (int(fields[11]) + int(fields[12])) / _TICK


def waited_of(pid: int) -> dict[int, float]:
    """Return how long [s] each thread of a process was ready but had no processor."""
    waited = {}
    for task in Path("/proc", str(pid), "task").iterdir():
        with suppress(OSError):  # a thread that has just ended
            waited[int(task.name)] = int((task / "schedstat").read_text().split()[1]) / 1e9
    return waited


class UsageLog:
    """Samples the processes of nodes.

    Args:
        nodes: whose processes.
        path: of the file, to which it adds.
    """

    def __init__(self, nodes: Nodes, path: Path) -> None:
        self._nodes, self._path = nodes, path
        self._waited: dict[int, dict[int, float]] = {}
        self._looked = self._looked_at_memory = float("-inf")

    def look(self) -> bool:
        """Take a sample if it is time to; return whether memory was looked at."""
        now = time.monotonic()
        if now - self._looked < _EVERY:
            return False
        self._looked, with_memory = now, now - self._looked_at_memory >= _MEMORY_EVERY
        self._looked_at_memory = now if with_memory else self._looked_at_memory
        t, samples = time.time_ns(), []
        for name, process in self._nodes.processes.items():
            with suppress(OSError):  # it has ended, which the next check will find
                pid = process.pid
                used = usage_of(pid) if with_memory else ()
                waited = 0.0 if name in BESIDE else self._wait(pid)
                samples.append(NodeSample(t, name, pid, waited, *used))
        with open(self._path, "a", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(samples)
        return with_memory

    def _wait(self, pid: int) -> float:
        """Return the longest wait [s] of a thread since the last sample."""
        before, now = self._waited.get(pid, {}), waited_of(pid)
        self._waited[pid] = now
        return max((now[k] - before[k] for k in now.keys() & before.keys()), default=0.0)
