"""Pictures of maps over the sphere of tool axes; importing this registers them.

Areas are equal, and both poles are inside.
"""

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from eulerparams_control.analysis.labels import number
from eulerparams_control.analysis.static_image import STYLE
from eulerparams_control.lab.maps.base import MapVariant, Picture, Table, of_variant, pictures
from eulerparams_control.lab.maps.pressed_maps import StiffnessMap
from eulerparams_control.lab.maps.run import FAST
from eulerparams_control.lab.maps.turning_maps import OrientationMap, share_failed
from eulerparams_control.laws.rotations import Array

FAILED = "#d62700"
"""Colour where a run does not settle or diverges; no colour of viridis is like it."""

_CENTRE = math.radians(60)  # longitude in the middle: +x left of it, -x right, both inside
_GRID = (241, 121)
_NAMES = "xyz"

_RANGE = LogNorm(1.0, 3.0)
_FAILURES = (
    "Colour: the highest angular speed of the worst of {trials} runs at each direction of the tool "
    "axis (Mollweide, equal areas), over that of a direct turn; red: one of them is not within "
    "{settled:g} deg after {duration:g} s, while turning at any time, or diverges. Below each "
    "sphere the share of all runs that fail so, or by more than {fast:g} times the speed of a "
    "direct turn. Circles: the poles. A free frame (J = I), noise {noise:g} deg, {dt:g} ms a step, "
    "the same errors and noise for each representation."
)

_STIFFNESS = "apparent stiffness / K_o  [1]"
_DEVIATION = "angle between turn and moment  [deg]"
_WHERE = (
    "Over the direction of the tool axis (Mollweide, equal areas), the roll about it random. The "
    "compliance law runs to rest under small moments about the axes of K_o; circles: the poles."
)


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


@pictures.register
def _(kind: OrientationMap, table: Table) -> list[Picture]:
    """Return small multiples: representations by tasks."""
    tasks = [(e, 0.0) for e in kind.errors] + [(0.0, s) for s in kind.speeds]
    columns = len(kind.variants)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.45 * columns + 0.6, 1.02 * len(tasks) + 0.75))
        first = []
        for i, (error, speed) in enumerate(tasks):
            for j, variant in enumerate(kind.variants):
                axes = add_sphere(figure, (len(tasks), columns, i * columns + j + 1))
                rows = of_variant(table, j, error=error, speed=speed)
                mesh = paint(axes, *worst_of(rows, "speed_ratio"), _RANGE, _colours())
                mark_poles(axes, variant)
                axes.set_xlabel(f"{share_failed(rows):.1f} % fail", fontsize=7, labelpad=6)
                if i == 0:
                    axes.set_title(variant.label, fontsize=8, pad=9)
                if j == 0:
                    first.append(axes)
        name_rows(first, [f"error {e:g}°" if e else f"turning {s:g}°/s" for e, s in tasks])
        bottom, top = 0.55 / figure.get_figheight(), 1 - 0.3 / figure.get_figheight()
        figure.subplots_adjust(0.05, bottom + 0.08, 0.995, top, 0.05, 0.28)
        bar = figure.add_axes((0.3, bottom * 0.75, 0.4, 0.09 / figure.get_figheight()))
        _bar(figure, mesh, bar)
    return [Picture("orientation", _failures(kind, table), _orientation_caption(kind), figure)]


def _bar(figure: Figure, mesh: QuadMesh, axes: Axes) -> None:
    bar = figure.colorbar(mesh, cax=axes, orientation="horizontal", extend="max")
    bar.set_ticks([1, 1.5, 2, 3], labels=["1", "1.5", "2", "3"])
    bar.minorticks_off()
    bar.set_label("peak angular speed / that of a direct turn  [1]", fontsize=7, labelpad=1)


def _colours() -> mpl.colors.Colormap:
    return mpl.colormaps["viridis"]


def _failures(kind: OrientationMap, table: Table) -> str:
    """Return who fails how often, the best last."""
    shares = [(share_failed(of_variant(table, i)), v.label) for i, v in enumerate(kind.variants)]
    ordered = sorted(shares, reverse=True)
    return "Runs that fail: " + ", ".join(f"{label} {share:.1f} %" for share, label in ordered)


def _orientation_caption(kind: OrientationMap) -> str:
    return _FAILURES.format(
        trials=kind.trials,
        fast=kind.fast,
        settled=kind.settled,
        duration=kind.duration,
        noise=kind.noise,
        dt=1e3 * kind.dt,
    )


@pictures.register
def _(kind: StiffnessMap, table: Table) -> list[Picture]:
    """Return the apparent stiffness, or the deviation."""
    return [_stiffness(kind, table) if kind.shown == "stiffness" else _deviation(kind, table)]


def _stiffness(kind: StiffnessMap, table: Table) -> Picture:
    """Return the largest and the smallest apparent stiffness; (58): k/(1-s) and k/(1+s)."""
    figure = _figure(
        kind,
        table,
        {"k_max": "largest", "k_min": "smallest"},
        LogNorm(1 / 16, 16),
        "PuOr",
        _STIFFNESS,
        [1 / 16, 1 / 4, 1 / 2, 1, 2, 4, 16],
    )
    ranges = []
    for i, variant in enumerate(kind.variants):
        rows = of_variant(table, i)
        low, high = np.nanmin(rows["k_min"]), np.nanmax(rows["k_max"])
        ranges.append(f"{variant.label} {number(low)} to {number(high)}")
    title = "Apparent over chosen rotational stiffness: " + ", ".join(ranges)
    caption = f"{_WHERE} With Euler angles it is k/(1+s), k and k/(1-s) by (58), s = |sin beta|."
    return Picture("stiffness", title, caption, figure)


def _deviation(kind: StiffnessMap, table: Table) -> Picture:
    """Return the angle between the turn and the axis of the moment, an axis of K_o (65)."""
    figure = _figure(
        kind,
        table,
        {"deviation": "worst axis"},
        Normalize(0, 90),
        "viridis",
        _DEVIATION,
        [0, 15, 30, 45, 60, 75, 90],
    )
    worst = [
        f"{variant.label} {np.nanmax(of_variant(table, i)['deviation']):.1f}°"
        for i, variant in enumerate(kind.variants)
    ]
    title = "A moment about an axis of K_o turns about another one, at worst by: "
    caption = (
        f"{_WHERE} K_o = {', '.join(f'{k:g}' for k in kind.K_o)} Nm/rad. With geometric "
        "consistency (65) the turn is about the axis of the moment."
    )
    return Picture("deviation", title + ", ".join(worst), caption, figure)


def _figure(
    kind: StiffnessMap,
    table: Table,
    shown: dict[str, str],
    norm: Normalize,
    colours: str,
    label: str,
    ticks: list[float],
) -> Figure:
    """Return small multiples: representations by columns of the table, one scale for all."""
    count = len(kind.variants)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.45 * count + 0.6, 1.0 * len(shown) + 0.85))
        first = []
        for i, name in enumerate(shown):
            for j, variant in enumerate(kind.variants):
                axes = add_sphere(figure, (len(shown), count, i * count + j + 1))
                rows = of_variant(table, j)
                mesh = paint(axes, rows, rows[name], norm, mpl.colormaps[colours])
                mark_poles(axes, variant)
                low, high = np.nanmin(rows[name]), np.nanmax(rows[name])
                axes.set_xlabel(f"{low:.2f} to {high:.2f}", fontsize=7, labelpad=6)
                if i == 0:
                    axes.set_title(variant.label, fontsize=8, pad=9)
                if j == 0:
                    first.append(axes)
        name_rows(first, list(shown.values()))
        height = figure.get_figheight()
        figure.subplots_adjust(0.05, 0.7 / height, 0.995, 1 - 0.3 / height, 0.05, 0.28)
        bar = figure.colorbar(
            mesh, cax=figure.add_axes((0.3, 0.4 / height, 0.4, 0.09 / height)),
            orientation="horizontal", extend="both" if isinstance(norm, LogNorm) else "neither",
        )  # fmt: skip
        bar.ax.xaxis.set_major_locator(FixedLocator(ticks))
        bar.ax.xaxis.set_minor_locator(NullLocator())
        bar.ax.xaxis.set_major_formatter(FuncFormatter(_tick))
        bar.set_label(label, fontsize=7, labelpad=1)
    return figure


def _tick(value: float, _: int) -> str:
    return f"1/{1 / value:g}" if 0 < value < 1 else f"{value:g}"
