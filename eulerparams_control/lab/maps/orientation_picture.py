"""The picture of :class:`OrientationMap`: peak speed over the sphere, failures marked."""

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from eulerparams_control.analysis.static_image import STYLE
from eulerparams_control.lab.maps.base import Picture, Table, of_variant
from eulerparams_control.lab.maps.orientation_map import OrientationMap
from eulerparams_control.lab.maps.sphere import (
    add_sphere,
    mark_poles,
    name_rows,
    paint,
    worst_of,
)
from eulerparams_control.lab.maps.turning import share_failed

_RANGE = LogNorm(1.0, 3.0)
_CAPTION = (
    "Colour: the highest angular speed of the worst of {trials} runs at each direction of the tool "
    "axis (Mollweide, equal areas), over that of a direct turn; red: one of them is not within "
    "{settled:g} deg after {duration:g} s, while turning at any time, or diverges. Below each "
    "sphere the share of all runs that fail so, or by more than {fast:g} times the speed of a "
    "direct turn. Circles: the poles. A free frame (J = I), noise {noise:g} deg, {dt:g} ms a step, "
    "the same errors and noise for each representation."
)


def picture(kind: OrientationMap, table: Table) -> Picture:
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
    return Picture("orientation", _finding(kind, table), _caption(kind), figure)


def _bar(figure: Figure, mesh: QuadMesh, axes: Axes) -> None:
    bar = figure.colorbar(mesh, cax=axes, orientation="horizontal", extend="max")
    bar.set_ticks([1, 1.5, 2, 3], labels=["1", "1.5", "2", "3"])
    bar.minorticks_off()
    bar.set_label("peak angular speed / that of a direct turn  [1]", fontsize=7, labelpad=1)


def _colours() -> mpl.colors.Colormap:
    return mpl.colormaps["viridis"]


def _finding(kind: OrientationMap, table: Table) -> str:
    """Return who fails how often, the best last."""
    shares = [(share_failed(of_variant(table, i)), v.label) for i, v in enumerate(kind.variants)]
    ordered = sorted(shares, reverse=True)
    return "Runs that fail: " + ", ".join(f"{label} {share:.1f} %" for share, label in ordered)


def _caption(kind: OrientationMap) -> str:
    return _CAPTION.format(
        trials=kind.trials,
        fast=kind.fast,
        settled=kind.settled,
        duration=kind.duration,
        noise=kind.noise,
        dt=1e3 * kind.dt,
    )
