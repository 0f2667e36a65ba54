"""The executable ``failure_map``: where representations fail or distort, as pictures.

Its page opens offline: each map with its finding and its picture.
"""

import argparse
import signal
import sys
import time
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from eulerparams_control.analysis.page_assets import style
from eulerparams_control.analysis.static_image import image, svg, write
from eulerparams_control.command_line import make_console, say, whole_number
from eulerparams_control.errors import EulerParamsError
from eulerparams_control.lab.maps.base import Picture, pictures
from eulerparams_control.lab.maps.definition import MapDefinition, load_map
from eulerparams_control.lab.maps.engine import Engine, engine
from eulerparams_control.lab.maps.sweep import sweep
from eulerparams_control.resources import config_names

_LOOK = """
section { margin-top: 40px; }
.picture { background: #ffffff; border-radius: 4px; padding: 8px; overflow-x: auto; }
.picture svg { display: block; max-width: 100%; height: auto; min-width: 640px; margin: 0 auto; }
"""


class Finished(NamedTuple):
    """A map that is finished.

    Attributes:
        definition: of the map.
        simulations: how many it has.
        pictures: of it.
    """

    definition: MapDefinition
    simulations: int
    pictures: Sequence[Picture]


def write_pictures(folder: Path, pictures: Sequence[Picture]) -> None:
    """Write each picture as SVG and PNG; raises ConfigurationError."""
    for picture in pictures:
        for name in ("svg", "png"):
            write(folder / f"{picture.name}.{name}", image(picture.figure, name))


def write_page(path: Path, maps: Sequence[Finished]) -> None:
    """Write the page of some maps; raises ConfigurationError."""
    total = sum(finished.simulations for finished in maps)
    parts = "\n".join(map(_part, maps))
    text = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Maps of representations</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>{style()}{_LOOK}</style></head><body>
<h1>Where representations of orientation fail or distort</h1>
<p class="claim">{total} simulations of the laws as the nodes run them; the numbers are in
map.parquet beside each picture.</p>
{parts}
</body></html>
"""
    write(path, text.encode("utf-8"))


def _part(finished: Finished) -> str:
    definition = finished.definition
    figures = "\n".join(
        f"""<figure><h3>{escape(picture.title)}</h3><div class="picture">{svg(picture.figure)}</div>
<figcaption>{escape(picture.caption)} {finished.simulations} simulations. Files:
<a href="{definition.name}/{picture.name}.svg">SVG</a>,
<a href="{definition.name}/{picture.name}.png">PNG</a>,
<a href="{definition.name}/map.parquet">numbers</a>.</figcaption></figure>"""
        for picture in finished.pictures
    )
    return f"""<section><h2>{escape(definition.title)}</h2>
<p class="claim">{escape(definition.question)}</p>
{figures}</section>"""


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
        "--workers", type=whole_number(), default=2, help="processes; 0: in this one, without Dask"
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
