"""What a process takes, as the kernel says: memory, processor, and how long it waited for one."""

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_TICK = os.sysconf("SC_CLK_TCK")
_PRIVATE = ("Private_Clean:", "Private_Dirty:")


@dataclass(frozen=True)
class Usage:
    """What a process has taken so far.

    Attributes:
        rss: [MiB] of memory that it has mapped and touched, shared or not.
        uss: [MiB] of that, what is its own.
        cpu: [s] of processor.
    """

    rss: float
    uss: float
    cpu: float


def usage_of(pid: int) -> Usage:
    """Return what a process has taken; raises OSError if it has ended."""
    process = Path("/proc", str(pid))
    sizes = [line.split() for line in (process / "smaps_rollup").read_text().splitlines()[1:]]
    rss = sum(int(size[1]) for size in sizes if size[0] == "Rss:")
    uss = sum(int(size[1]) for size in sizes if size[0] in _PRIVATE)
    # behind the name, which may have blanks, the fields from the third one on
    fields = (process / "stat").read_text().rpartition(")")[2].split()
    return Usage(rss / 1024, uss / 1024, (int(fields[11]) + int(fields[12])) / _TICK)


def waited_of(pid: int) -> dict[int, float]:
    """Return how long [s] each thread of a process was ready, but had no processor."""
    waited = {}
    for task in Path("/proc", str(pid), "task").iterdir():
        with suppress(OSError):  # a thread that has just ended
            waited[int(task.name)] = int((task / "schedstat").read_text().split()[1]) / 1e9
    return waited
