"""The page of the maps, which opens offline: each map with its finding and its picture."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

from eulerparams_control.analysis.page_assets import style
from eulerparams_control.analysis.static_image import image, svg, write
from eulerparams_control.lab.maps.base import Picture
from eulerparams_control.lab.maps.definition import MapDefinition

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
