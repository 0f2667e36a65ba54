"""The picture of :class:`GainMap`: what a sampled law does of a pole that is passed closely."""

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from eulerparams_control.analysis.static_image import STYLE
from eulerparams_control.lab.maps.base import Picture, Table, of_variant
from eulerparams_control.lab.maps.gain_map import GainMap
from eulerparams_control.laws.rotations import Array


def picture(kind: GainMap, table: Table) -> Picture:
    """Return the highest speed over distance and gain, one scale for all."""
    count = len(kind.variants)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.6 * count + 1.0, 2.0), layout="constrained")
        grid = figure.subplots(1, count, sharex=True, sharey=True, squeeze=False)
        for i, (axes, variant) in enumerate(zip(grid.flat, kind.variants, strict=True)):
            x, y, ratio, error = _grid(of_variant(table, i))
            mesh = axes.pcolormesh(
                x,
                y,
                ratio,
                norm=LogNorm(1, 100),
                cmap="viridis",
                rasterized=True,
                shading="nearest",
            )
            if (error > kind.settled).any() and (error <= kind.settled).any():
                axes.contour(x, y, error, levels=[kind.settled], colors="white", linewidths=1.0)
            axes.set(xscale="log", yscale="log")
            axes.grid(False)
            axes.set_title(variant.label, fontsize=8, pad=3)
        grid[0, 0].set_ylabel("rate of the error [1/s]")
        figure.supxlabel("closest distance to the pole [deg]", fontsize=8)
        bar = figure.colorbar(mesh, ax=grid.ravel().tolist(), extend="max", aspect=25, pad=0.01)
        bar.set_label("peak / desired speed [1]", fontsize=7)
    return Picture("gain", _finding(kind, table), _caption(kind), figure)


def _grid(rows: Table) -> tuple[Array, ...]:
    """Return distances, gains, peak speed over that desired and worst error [deg]."""
    x, y = np.unique(rows["closest"]), np.unique(rows["gain"])
    order = np.lexsort((rows["closest"], rows["gain"]))
    shape = (len(y), len(x))
    return x, y, rows["speed_ratio"][order].reshape(shape), rows["worst_deg"][order].reshape(shape)


def failing_distance(rows: Table, settled: float) -> float:
    """Return the largest distance [deg] at which some gain errs by more than settled; 0 if none."""
    failing = rows["closest"][rows["worst_deg"] > settled]
    return float(failing.max()) if len(failing) else 0.0


def _finding(kind: GainMap, table: Table) -> str:
    found = []
    for i, variant in enumerate(kind.variants):
        distance = failing_distance(of_variant(table, i), kind.settled)
        found.append(f"{variant.label} {f'within {distance:.2g}°' if distance else 'nowhere'}")
    return f"Errors above {kind.settled:g}° near the pole: " + ", ".join(found)


def _caption(kind: GainMap) -> str:
    law = "kinematic" if kind.law == "clik" else "dynamic"
    return (
        f"A desired frame turns at {kind.speed:g} deg/s past the pole, from zero error, under "
        f"{law} control with {1e3 * kind.dt:g} ms a step and {kind.noise:g} deg of noise. White: "
        f"an error of {kind.settled:g} deg. What has no pole of its own passes that of XYZ."
    )
