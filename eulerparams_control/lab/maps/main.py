"""The executable ``failure_map``: where representations fail or distort, as pictures.

Its page opens offline: each map with its finding and its picture.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
from rich.console import Console

from eulerparams_control.analysis.html import write_html
from eulerparams_control.analysis.static import STYLE, image, svg, write
from eulerparams_control.command_line import say, whole_number
from eulerparams_control.lab.maps.base import Picture
from eulerparams_control.lab.maps.definition import MapDefinition, load_map
from eulerparams_control.lab.maps.sweep import sweep
from eulerparams_control.lab.run.jobs import carry_out, progress, workers
from eulerparams_control.resources import config_names


def write_pictures(folder: Path, pictures: Sequence[Picture]) -> None:
    """Write each picture as SVG and PNG; raises ConfigurationError."""
    for picture in pictures:
        for name in ("svg", "png"):
            write(folder / f"{picture.name}.{name}", image(picture.figure, name))


def main(args: list[str] | None = None) -> int:
    """Run ``failure_map [NAME ...] [--out DIR] [--workers N] [--scheduler ADDRESS]``.

    Returns:
        the exit code: 0, 2 after an error, 130 after an interrupt.
    """
    options = _parse(args)
    run = partial(_list if options.list else _main, options)
    return carry_out(run, "what is finished is kept: run it again to go on")


def _main(options: argparse.Namespace, console: Console) -> int:
    names = options.names or config_names("maps")
    maps = [load_map(name, options.quick, options.samples) for name in names]
    maps.sort(key=lambda each: each.place)
    with workers(options.workers, options.scheduler) as pool:
        finished = [_make(each, options.out, pool, console) for each in maps]
    page = options.out / "index.html"
    write_html(page, "maps.html", maps=finished, svg=svg)
    say(console, f"The page: {page.resolve()}")
    return 0


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="failure_map", description="Where representations fail or distort: a sweep."
    )
    parser.add_argument("names", nargs="*", help="of config/maps, or paths of YAML files")
    parser.add_argument("--out", type=Path, default=Path("out/map"), help="folder of the results")
    parser.add_argument(
        "--workers", type=whole_number(), default=2, help="processes; 0: in this one, without Dask"
    )
    parser.add_argument("--scheduler", default="", help="address of a Dask scheduler: tcp://...")
    parser.add_argument(
        "--samples", type=whole_number(), default=0, help="how fine, in place of the YAML"
    )
    parser.add_argument("--quick", action="store_true", help="coarse, in seconds")
    parser.add_argument("--list", action="store_true", help="list the maps")
    return parser.parse_args(args)


def _list(_options: argparse.Namespace, console: Console) -> int:
    for name in config_names("maps"):
        say(console, f"{name}: {load_map(name).question}")
    return 0


def _make(definition: MapDefinition, out: Path, pool: Executor, console: Console) -> dict[str, Any]:
    """Return a map with its number of simulations and its pictures, for the page."""
    folder = out / definition.name
    started = time.monotonic()
    with progress(console, "simulations") as bars:
        task = bars.add_task(definition.name, total=None)
        table = sweep(
            definition, folder, pool, lambda done, n: bars.update(task, completed=done, total=n)
        )
    with console.status("drawing"), mpl.rc_context(STYLE):
        drawn = definition.kind.pictures(table)
        write_pictures(folder, drawn)
    count, seconds = len(table["variant"]), time.monotonic() - started
    say(console, f"  {definition.name}: {count} simulations, {seconds:.1f} s")
    for picture in drawn:
        say(console, f"  {picture.title}")
    return {"definition": definition, "simulations": count, "pictures": drawn}


if __name__ == "__main__":
    sys.exit(main())
