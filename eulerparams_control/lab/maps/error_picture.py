"""The picture of :class:`ErrorMap`: how far round a law goes, over the error to be undone."""

import math

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from eulerparams_control.analysis.static_image import STYLE
from eulerparams_control.lab.maps.base import Picture, Table, of_variant
from eulerparams_control.lab.maps.error_map import ErrorMap
from eulerparams_control.lab.maps.sphere import FAILED


def picture(kind: ErrorMap, table: Table) -> Picture:
    """Return a disc for each representation: radius the size of the error, angle its axis."""
    count = len(kind.variants)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.45 * count + 0.8, 2.0), layout="constrained")
        grid = figure.subplots(1, count, subplot_kw={"projection": "polar"}, squeeze=False)
        for i, (axes, variant) in enumerate(zip(grid.flat, kind.variants, strict=True)):
            rows = of_variant(table, i)
            n = kind.samples
            phi = np.linspace(0, 2 * math.pi, n + 1) - math.pi / n
            size = np.linspace(0, 180, n + 1)
            ratio = rows["detour"].copy()
            ratio[rows["failure"] >= 2] = np.nan
            order = np.lexsort((rows["azimuth"], rows["error"]))
            axes.set_facecolor(FAILED)
            mesh = axes.pcolormesh(
                phi, size, ratio[order].reshape(n, n), norm=LogNorm(1, 3), cmap="viridis",
                rasterized=True,
            )  # fmt: skip
            axes.grid(False)
            axes.set_xticks([0, math.pi / 2], labels=["x", "y"])
            axes.set_yticks([])
            axes.plot(np.linspace(0, 2 * math.pi, 181), np.full(181, 90.0), color="w", lw=0.7)
            axes.set_ylim(0, 180)
            axes.tick_params(pad=-3)
            axes.set_title(variant.label, fontsize=8, pad=3)
            axes.set_xlabel(f"{_lost(rows):.1f} % never settle", fontsize=7)
        bar = figure.colorbar(mesh, ax=grid.ravel().tolist(), extend="max", aspect=25, pad=0.01)
        bar.set_ticks([1, 1.5, 2, 3], labels=["1", "1.5", "2", "3"])
        bar.minorticks_off()
        bar.set_label("travel / direct turn [1]", fontsize=7)
    return Picture("error", _finding(kind, table), _caption(kind), figure)


def _lost(rows: Table) -> float:
    """Return the share [%] of runs that did not settle or diverged."""
    return 100 * float(np.mean(rows["failure"] >= 2))


def largest_direct(rows: Table) -> float:
    """Return the error [deg] up to which all settle without a detour of more than a tenth."""
    bad = rows["error"][(rows["failure"] >= 2) | (rows["detour"] > 1.1)]
    return float(bad.min()) if len(bad) else 180.0


def _finding(kind: ErrorMap, table: Table) -> str:
    found = [
        f"{variant.label} {largest_direct(of_variant(table, i)):.0f}°"
        for i, variant in enumerate(kind.variants)
    ]
    return "Errors are undone on a direct way up to: " + ", ".join(found)


def _caption(kind: ErrorMap) -> str:
    law = "kinematic" if kind.law == "clik" else "dynamic"
    return (
        "Distance from the middle: the size of the error, 0 to 180 deg, the white circle is 90 "
        "deg; direction: its axis in the x-y plane of the end effector. Colour: the length of the "
        f"way over that of a direct turn, under {law} control; red: it does not settle within "
        f"{kind.duration:g} s, or diverges."
    )
