"""The picture of :class:`ArmMap`: what an arm does, against what a free frame does."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from eulerparams_control.analysis.labels import colour
from eulerparams_control.analysis.static_image import STYLE
from eulerparams_control.lab.maps.arm_map import ArmMap
from eulerparams_control.lab.maps.base import Picture, Table, of_variant


def picture(kind: ArmMap, table: Table) -> Picture:
    """Return peak speed and detour of the arm over those of the free frame."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.2, 2.5), layout="constrained")
        grid = figure.subplots(1, 2)
        names = {"speed_ratio": "peak speed / direct turn", "detour": "travel / direct turn"}
        for axes, (name, label) in zip(grid, names.items(), strict=True):
            top = 1.0
            for i, variant in enumerate(kind.variants):
                rows = reached(of_variant(table, i))
                top = max(top, *rows[name], *rows[f"free_{name}"])
                axes.plot(rows[f"free_{name}"], rows[name], "x+.1"[i % 4], color=colour(i), ms=4,
                          mew=0.8, label=variant.label, zorder=2 + i)  # fmt: skip
            axes.plot([0.8, top], [0.8, top], color="0.5", lw=0.6, zorder=1)
            axes.set(xlabel=f"free frame: {label}", ylabel=f"{kind.robot}: {label}")
            axes.set(xscale="log", yscale="log")
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_formatter("{x:g}")
                axis.set_minor_formatter("{x:g}")
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return Picture("arm", _finding(kind, table), _caption(kind, table), figure)


def reached(rows: Table) -> Table:
    """Return the rows in which the arm reaches start and end, and neither run diverged."""
    chosen = (rows["reached"] > 0) & (rows["failure"] < 3) & (rows["free_failure"] < 3)
    return {name: column[chosen] for name, column in rows.items()}


def difference(rows: Table) -> float:
    """Return the median relative difference of the detours of arm and free frame."""
    rows = reached(rows)
    return float(np.median(np.abs(rows["detour"] / rows["free_detour"] - 1)))


def _finding(kind: ArmMap, table: Table) -> str:
    found = []
    for i, variant in enumerate(kind.variants):
        rows = reached(of_variant(table, i))
        found.append(f"{variant.label} up to {rows['speed_ratio'].max():.2f} times")
    return (
        f"On the {kind.robot} the peak speed is, over a direct turn: {', '.join(found)}; its "
        f"detour differs from the free frame's by {100 * difference(table):.2g} % in the median"
    )


def _caption(kind: ArmMap, table: Table) -> str:
    count = int((of_variant(table, 0)["reached"] > 0).sum())
    return (
        f"The same turns by {kind.error:g} deg through inverse kinematics and exact inverse "
        f"dynamics (33) of the {kind.robot}, the tip staying where it is: {count} of "
        f"{kind.samples} directions that it reaches away from its own singularities."
    )
