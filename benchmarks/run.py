"""`make bench`: the ratios of speed, each measured side by side in one run, and their history."""

import argparse
import os
import platform
import subprocess
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from bench_analyze import analyze
from bench_node import nodes, recorder, start
from bench_simulation import bridge, in_process, lockstep, soak
from bench_tick import cold_ticks, growth, ticks
from rows import Row, append, read, write_page
from timing import burning

from eulerparams_control.analysis.labels import number

BENCHES: dict[str, Callable[[bool], Iterator[Row]]] = {
    **{"tick": ticks, "cold": cold_ticks, "growth": growth, "node": nodes},
    **{"start": start, "lockstep": lockstep, "in_process": in_process},
    **{"bridge": bridge, "recorder": recorder, "analyze": analyze},
}
HERE = Path(__file__).parent


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=BENCHES, default=list(BENCHES), metavar="NAME",
                        help=f"of {', '.join(BENCHES)}")  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--loaded", type=int, default=0, metavar="N",
                        help="measure again while N processes burn the cores")  # fmt: skip
    parser.add_argument("--soak", type=float, metavar="MINUTES",
                        help="instead: all controllers with one bridge, for long")  # fmt: skip
    parser.add_argument("--history", type=Path, default=HERE / "history.jsonl", help="to append to")
    parser.add_argument("--page", type=Path, default=Path("out/bench.html"), help="to write")
    return parser.parse_args()


def git(*words: str) -> str:
    command = ["git", "-C", str(HERE), *words]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


def about() -> dict[str, str]:
    """Return the commit, the date and the machine with its load before the run."""
    changed = git("status", "--porcelain", "-uno", "../eulerparams_control", "../sim_bridge")
    info = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    cores = [text.partition(": ")[2] for text in info if text.partition("\t")[0] == "model name"]
    return {
        "commit": git("rev-parse", "--short", "HEAD") + "+" * bool(changed),
        "date": time.strftime("%Y-%m-%d %H:%M"),
        "machine": f"{os.cpu_count()} cores, {cores[0] if cores else platform.machine()}, "
        f"load {os.getloadavg()[0]:.1f}",
    }


def measured(bench: Callable[[], Iterator[Row]]) -> Iterator[Row]:
    """Yield rows and print them, with a word of what made an end to them before the last."""
    try:
        for row in bench():
            met = {None: "", True: "met", False: "not met"}[row.is_met]
            what = f"{row.what}, {row.of}".removesuffix(", ")
            print(f"{number(row.ratio):>7} {row.goal:7} {met:8} {what} ({row.figure})", flush=True)
            yield row
    except Exception as error:  # the others go on
        print(f"        failed: {error!r}", flush=True)


def main() -> None:
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # or each process compiles all its modules
    options, begun = parse(), about()
    chosen = {name: partial(BENCHES[name], options.quick) for name in options.only}
    if options.soak:
        chosen = {"soak": partial(soak, options.soak)}
    found: dict[int, list[Row]] = {load: [] for load in sorted({0, options.loaded})}
    print(f"Commit {begun['commit']}, {begun['machine']}.  Ratio, goal, what (measured):")
    for name, bench in chosen.items():
        for load, rows in found.items():
            print(f"--- {name}" + f", while {load} others burn the cores" * (load > 0), flush=True)
            with burning(load):
                rows += measured(bench)
    for load, rows in found.items():
        append(options.history, rows, **begun, quick=options.quick, loaded=load)
    write_page(options.page, read(options.history))
    print(f"history: {options.history}, page: {options.page}")


if __name__ == "__main__":
    main()
