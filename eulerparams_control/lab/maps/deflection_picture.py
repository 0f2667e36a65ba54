"""The picture of :class:`DeflectionMap`: the turn over the moment."""

from collections.abc import Callable

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from eulerparams_control.analysis.labels import colour
from eulerparams_control.analysis.static_image import STYLE
from eulerparams_control.lab.maps.base import Picture, Table, of_variant
from eulerparams_control.lab.maps.deflection_map import DeflectionMap
from eulerparams_control.laws.rotations import Array

_CLOSED: dict[str, tuple[str, Callable[[Array], Array]]] = {
    "euler_parameters": ("arcsin(m)", np.arcsin),
    "rotation_vector": ("m", lambda m: m),
    "angle_axis": ("arcsin(2 m) / 2, up to m = 1/2", lambda m: np.arcsin(2 * m) / 2),
}
"""Turn [rad] over m, the moment over the stiffness; NaN where there is no equilibrium."""


def picture(kind: DeflectionMap, table: Table) -> Picture:
    """Return the turn of each representation, the middle of all trials and their range."""
    count = len(kind.variants)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.35 * count + 0.5, 1.9), layout="constrained")
        grid = figure.subplots(1, count, sharex=True, sharey=True, squeeze=False)
        for i, (axes, variant) in enumerate(zip(grid.flat, kind.variants, strict=True)):
            rows = of_variant(table, i)
            m, turns = _by_size(rows)
            axes.fill_between(m, turns.min(1), turns.max(1), color=colour(0), alpha=0.25, lw=0)
            axes.plot(m, np.median(turns, axis=1), color=colour(0), lw=1.3)
            if variant.orientation in _CLOSED:
                fine = np.linspace(0, 1, 200)
                with np.errstate(invalid="ignore"):
                    theory = np.degrees(_CLOSED[variant.orientation][1](fine))
                axes.plot(fine, theory, color="black", lw=0.8, ls=(0, (4, 2)))
                axes.text(0.04, 0.93, _CLOSED[variant.orientation][0], fontsize=6.5,
                          va="top", transform=axes.transAxes)  # fmt: skip
            axes.set_title(variant.label, fontsize=8, pad=3)
        grid[0, 0].set(ylabel="turn [deg]", xlim=(0, 1), ylim=(0, 100))
        grid[0, 0].set(xticks=[0, 0.5, 1], yticks=[0, 30, 60, 90])
        figure.supxlabel("moment / stiffness [rad]", fontsize=8)
    return Picture("deflection", _finding(kind, table), _caption(kind), figure)


def _by_size(rows: Table) -> tuple[Array, Array]:
    """Return the sizes (M,) and the turns (M, trials) [deg]; NaN where it does not come to rest."""
    sizes = np.unique(rows["moment"])
    return sizes, np.array([rows["turn"][rows["moment"] == size] for size in sizes])


def _finding(kind: DeflectionMap, table: Table) -> str:
    spread = []
    for i, variant in enumerate(kind.variants):
        _, turns = _by_size(of_variant(table, i))
        widest = float(np.nanmax(turns.max(axis=1) - turns.min(axis=1)))
        spread.append(f"{variant.label} {widest:.3g}°")
    return "The same moment turns by angles that differ with the orientation by: " + ", ".join(
        spread
    )


def _caption(kind: DeflectionMap) -> str:
    return (
        f"Line: the median of {kind.trials} orientations and axes; band: from the least to the "
        "largest; dashed: in closed form. The moment of Euler parameters saturates at k, at 90 "
        "deg; that of angle/axis at k/2, at 45 deg, beyond which the frame turns over."
    )
