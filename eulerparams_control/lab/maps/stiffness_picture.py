"""The pictures of :class:`StiffnessMap`: apparent stiffness, and deviation of the turn."""

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from eulerparams_control.analysis.format import number
from eulerparams_control.analysis.static_image import STYLE
from eulerparams_control.lab.maps.base import Picture, Table, of_variant
from eulerparams_control.lab.maps.sphere import add_sphere, mark_poles, name_rows, paint
from eulerparams_control.lab.maps.stiffness_map import StiffnessMap

_STIFFNESS = "apparent stiffness / K_o  [1]"
_DEVIATION = "angle between turn and moment  [deg]"
_WHERE = (
    "Over the direction of the tool axis (Mollweide, equal areas), the roll about it random. The "
    "compliance law runs to rest under small moments about the axes of K_o; circles: the poles."
)


def stiffness(kind: StiffnessMap, table: Table) -> Picture:
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


def deviation(kind: StiffnessMap, table: Table) -> Picture:
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
