"""Pictures over the sphere of tool axes: equal-area, seen so that both poles are inside."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from eulerparams_control.lab.maps.base import Table, Variant
from eulerparams_control.lab.maps.run import FAST
from eulerparams_control.laws.rotations import Array

FAILED = "#d62700"
"""Colour where a run does not settle or diverges; no colour of viridis is like it."""

_CENTRE = math.radians(60)  # longitude in the middle: +x left of it, -x right, both inside
_GRID = (241, 121)
_NAMES = "xyz"


def add_sphere(figure: Figure, place: tuple[int, int, int]) -> Axes:
    """Return axes with a sphere in Mollweide's projection, which keeps areas."""
    axes = figure.add_subplot(*place, projection="mollweide")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(False)
    return axes


def paint(axes: Axes, table: Table, values: Array, norm: Normalize, colours: Colormap) -> QuadMesh:
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
        longitude, latitude, values[nearest], norm=norm, cmap=colours, rasterized=True
    )


def mark_poles(axes: Axes, variant: Variant) -> None:
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


def worst_of(table: Table, name: str) -> tuple[Table, Array]:
    """Return the distinct tool axes, and the largest value at each; NaN where a run is lost."""
    axes = np.stack([table["x"], table["y"], table["z"]], axis=1)
    distinct, index = np.unique(axes, axis=0, return_inverse=True)
    values = np.full(len(distinct), -np.inf)
    np.maximum.at(values, index.ravel(), np.where(table["failure"] > FAST, np.inf, table[name]))
    values[np.isinf(values)] = np.nan
    return dict(zip("xyz", distinct.T, strict=True)), values


def name_rows(axes: Sequence[Axes], names: Sequence[str]) -> None:
    """Name the rows of pictures, left of the first of each."""
    for one, name in zip(axes, names, strict=True):
        one.text(-0.06, 0.5, name, transform=one.transAxes, rotation=90, ha="right", va="center")
