"""Pictures of maps over the sphere of tool axes.

Areas are equal, and both poles are inside.
"""

import math
from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from eulerparams_control.lab.maps.base import MapKind, MapVariant, Table
from eulerparams_control.laws.rotations import Array

FAILED = "#d62700"
"""Colour where a run does not settle or diverges; no colour of viridis is like it."""

WHERE = "the tool axis (Mollweide, equal areas)"

_CENTRE = math.radians(60)  # longitude in the middle: +x left of it, -x right, both inside
_GRID = (241, 121)
_NAMES = "xyz"

Cell = tuple[Table, Array, str]
"""Tool axes with the values at them, and what is written below their sphere."""


def spheres(
    kind: MapKind,
    rows: Mapping[str, Sequence[Cell]],
    norm: Normalize,
    colours: str,
    label: str,
    ticks: Sequence[float],
    extend: str = "neither",
) -> Figure:
    """Return small multiples, representations by rows, with one scale for all.

    Args:
        kind: of the map.
        rows: by their name, a cell for each representation.
        norm: of the scale.
        colours: name of the colour map.
        label: of the scale.
        ticks: of the scale.
        extend: at which of its ends the scale goes on.
    """
    count = len(kind.variants)
    figure = Figure(figsize=(1.45 * count + 0.6, 1.0 * len(rows) + 0.85))
    for i, (name, cells) in enumerate(rows.items()):
        for j, (variant, (table, values, below)) in enumerate(
            zip(kind.variants, cells, strict=True)
        ):
            place = i * count + j + 1
            axes = figure.add_subplot(len(rows), count, place, projection="mollweide")
            axes.set(xticks=[], yticks=[])
            axes.grid(False)
            mesh = paint(axes, table, values, norm, colours)
            mark_poles(axes, variant)
            axes.set_xlabel(below, fontsize=7, labelpad=6)
            if i == 0:
                axes.set_title(variant.label, fontsize=8, pad=9)
            if j == 0:
                axes.text(-0.06, 0.5, name, transform=axes.transAxes, rotation=90, ha="right",
                          va="center")  # fmt: skip
    height = figure.get_figheight()
    figure.subplots_adjust(0.05, 0.7 / height, 0.995, 1 - 0.3 / height, 0.05, 0.28)
    strip = figure.add_axes((0.3, 0.4 / height, 0.4, 0.09 / height))
    bar = figure.colorbar(mesh, cax=strip, orientation="horizontal", extend=extend)
    bar.ax.xaxis.set_major_locator(FixedLocator(ticks))
    bar.ax.xaxis.set_minor_locator(NullLocator())
    bar.ax.xaxis.set_major_formatter(FuncFormatter(_tick))
    bar.set_label(label, fontsize=7, labelpad=1)
    return figure


def _tick(value: float, _: int) -> str:
    return f"1/{1 / value:g}" if 0 < value < 1 else f"{value:g}"


def paint(axes: Axes, table: Table, values: Array, norm: Normalize, colours: str) -> QuadMesh:
    """Colour each point of the sphere like the nearest tool axis; NaN has failed."""
    longitude = np.linspace(-math.pi, math.pi, _GRID[0])
    latitude = np.linspace(-math.pi / 2, math.pi / 2, _GRID[1])
    lon, lat = np.meshgrid(
        (longitude[1:] + longitude[:-1]) / 2 + _CENTRE, (latitude[1:] + latitude[:-1]) / 2
    )
    points = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
    known = np.stack([table["x"], table["y"], table["z"]])
    nearest = (points.reshape(-1, 3) @ known).argmax(axis=1).reshape(lon.shape)
    axes.set_facecolor(FAILED)
    return axes.pcolormesh(
        longitude,
        latitude,
        values[nearest],
        norm=norm,
        cmap=mpl.colormaps[colours],
        rasterized=True,
    )


def mark_poles(axes: Axes, variant: MapVariant) -> None:
    """Mark and name the tool axes at which the Euler angles of a variant are singular."""
    if variant.pole_axis is None:
        return
    for sign in (1, -1):
        v = sign * np.eye(3)[variant.pole_axis]
        longitude = (math.atan2(v[1], v[0]) - _CENTRE + math.pi) % (2 * math.pi) - math.pi
        latitude = math.asin(v[2])
        if variant.pole_axis == 2:
            longitude = 0.0
        axes.plot(longitude, latitude, "o", ms=7, mfc="none", mec="white", mew=2.2, clip_on=False)
        axes.plot(longitude, latitude, "o", ms=7, mfc="none", mec="black", mew=0.9, clip_on=False)
        axes.annotate(
            f"{'+' if sign > 0 else '-'}{_NAMES[variant.pole_axis]}",
            (longitude, latitude),
            (0, -sign * 10 if variant.pole_axis == 2 else -10),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=7,
            color="black",
            path_effects=[withStroke(linewidth=1.8, foreground="white")],
        )
