"""The executable ``failure_map``: where representations fail or distort, as pictures."""

import argparse
import signal
import sys
import time
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from eulerparams_control.command_line import make_console, say, whole_number
from eulerparams_control.errors import EulerParamsError
from eulerparams_control.lab.maps.base import pictures
from eulerparams_control.lab.maps.definition import MapDefinition, load_map
from eulerparams_control.lab.maps.engine import Engine, engine
from eulerparams_control.lab.maps.page import Finished, write_page, write_pictures
from eulerparams_control.lab.maps.sweep import sweep
from eulerparams_control.resources import config_names


def main(args: list[str] | None = None) -> int:
    """Run ``failure_map [NAME ...] [--out DIR] [--workers N] [--scheduler ADDRESS]``.

    Returns:
        the exit code: 0, 2 after an error, 130 after an interrupt.
    """
    options = _parse(args)
    console = make_console()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the workers, as Ctrl-C does
    try:
        if options.list:
            return _list(console)
        names = options.names or config_names("maps")
        maps = [load_map(name, options.quick, options.samples) for name in names]
        maps.sort(key=lambda each: each.place)
        with engine(options.workers, options.scheduler) as run:
            finished = [_make(each, options.out, run, console) for each in maps]
        page = options.out / "index.html"
        write_page(page, finished)
    except EulerParamsError as error:
        say(console, f"error: {error}", "red")
        return 2
    except KeyboardInterrupt:
        say(console, "stopped; what is finished is kept: run it again to go on", "red")
        return 130
    say(console, f"The page: {page.resolve()}")
    return 0


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="failure_map", description="Where representations fail or distort: a sweep."
    )
    parser.add_argument("names", nargs="*", help="of config/maps, or paths of YAML files")
    parser.add_argument("--out", type=Path, default=Path("out/map"), help="folder of the results")
    parser.add_argument(
        "--workers",
        type=whole_number(),
        default=2,
        help="processes; 0: in this one, without Dask",
    )
    parser.add_argument("--scheduler", default="", help="address of a Dask scheduler: tcp://...")
    parser.add_argument(
        "--samples", type=whole_number(), default=0, help="how fine, in place of the YAML"
    )
    parser.add_argument("--quick", action="store_true", help="coarse, in seconds")
    parser.add_argument("--list", action="store_true", help="list the maps")
    return parser.parse_args(args)


def _list(console: Console) -> int:
    for name in config_names("maps"):
        say(console, f"{name}: {load_map(name).question}")
    return 0


def _make(definition: MapDefinition, out: Path, run: Engine, console: Console) -> Finished:
    """Return a map with its pictures, after its sweep."""
    folder = out / definition.name
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("simulations"),
        TimeElapsedColumn(),
    )
    started = time.monotonic()
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(definition.name, total=None)
        table = sweep(
            definition,
            folder,
            run,
            lambda done, total: progress.update(task, completed=done, total=total),
        )
    with console.status("drawing"):
        drawn = pictures(definition.kind, table)
        write_pictures(folder, drawn)
    count, seconds = len(table["variant"]), time.monotonic() - started
    say(console, f"  {definition.name}: {count} simulations, {seconds:.1f} s")
    for picture in drawn:
        say(console, f"  {picture.title}")
    return Finished(definition, count, drawn)


if __name__ == "__main__":
    sys.exit(main())
