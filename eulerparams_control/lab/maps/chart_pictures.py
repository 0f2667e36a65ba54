"""Pictures of maps as charts; importing this registers them."""

import math
from collections.abc import Callable

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from eulerparams_control.analysis.labels import colour
from eulerparams_control.analysis.static_image import STYLE
from eulerparams_control.lab.maps.arm_map import ArmMap
from eulerparams_control.lab.maps.base import Picture, Table, of_variant, pictures
from eulerparams_control.lab.maps.gain_map import GainMap
from eulerparams_control.lab.maps.pressed_maps import DeflectionMap
from eulerparams_control.lab.maps.sphere_pictures import FAILED
from eulerparams_control.lab.maps.turning_maps import ErrorMap
from eulerparams_control.laws.rotations import Array

_CLOSED: dict[str, tuple[str, Callable[[Array], Array]]] = {
    "euler_parameters": ("arcsin(m)", np.arcsin),
    "rotation_vector": ("m", lambda m: m),
    "angle_axis": ("arcsin(2 m) / 2, up to m = 1/2", lambda m: np.arcsin(2 * m) / 2),
}
"""Turn [rad] over m, the moment over the stiffness; NaN where there is no equilibrium."""


@pictures.register
def _(kind: ArmMap, table: Table) -> list[Picture]:
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
    return [Picture("arm", _arm_finding(kind, table), _arm_caption(kind, table), figure)]


def reached(rows: Table) -> Table:
    """Return the rows in which the arm reaches start and end, and neither run diverged."""
    chosen = (rows["reached"] > 0) & (rows["failure"] < 3) & (rows["free_failure"] < 3)
    return {name: column[chosen] for name, column in rows.items()}


def difference(rows: Table) -> float:
    """Return the median relative difference of the detours of arm and free frame."""
    rows = reached(rows)
    return float(np.median(np.abs(rows["detour"] / rows["free_detour"] - 1)))


def _arm_finding(kind: ArmMap, table: Table) -> str:
    found = []
    for i, variant in enumerate(kind.variants):
        rows = reached(of_variant(table, i))
        found.append(f"{variant.label} up to {rows['speed_ratio'].max():.2f} times")
    return (
        f"On the {kind.robot} the peak speed is, over a direct turn: {', '.join(found)}; its "
        f"detour differs from the free frame's by {100 * difference(table):.2g} % in the median"
    )


def _arm_caption(kind: ArmMap, table: Table) -> str:
    count = int((of_variant(table, 0)["reached"] > 0).sum())
    return (
        f"The same turns by {kind.error:g} deg through inverse kinematics and exact inverse "
        f"dynamics (33) of the {kind.robot}, the tip staying where it is: {count} of "
        f"{kind.samples} directions that it reaches away from its own singularities."
    )


@pictures.register
def _(kind: DeflectionMap, table: Table) -> list[Picture]:
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
    return [
        Picture("deflection", _deflection_finding(kind, table), _deflection_caption(kind), figure)
    ]


def _by_size(rows: Table) -> tuple[Array, Array]:
    """Return the sizes (M,) and the turns (M, trials) [deg]; NaN where it does not come to rest."""
    sizes = np.unique(rows["moment"])
    return sizes, np.array([rows["turn"][rows["moment"] == size] for size in sizes])


def _deflection_finding(kind: DeflectionMap, table: Table) -> str:
    spread = []
    for i, variant in enumerate(kind.variants):
        _, turns = _by_size(of_variant(table, i))
        widest = float(np.nanmax(turns.max(axis=1) - turns.min(axis=1)))
        spread.append(f"{variant.label} {widest:.3g}°")
    return "The same moment turns by angles that differ with the orientation by: " + ", ".join(
        spread
    )


def _deflection_caption(kind: DeflectionMap) -> str:
    return (
        f"Line: the median of {kind.trials} orientations and axes; band: from the least to the "
        "largest; dashed: in closed form. The moment of Euler parameters saturates at k, at 90 "
        "deg; that of angle/axis at k/2, at 45 deg, beyond which the frame turns over."
    )


@pictures.register
def _(kind: ErrorMap, table: Table) -> list[Picture]:
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
    return [Picture("error", _error_finding(kind, table), _error_caption(kind), figure)]


def _lost(rows: Table) -> float:
    """Return the share [%] of runs that did not settle or diverged."""
    return 100 * float(np.mean(rows["failure"] >= 2))


def largest_direct(rows: Table) -> float:
    """Return the error [deg] up to which all settle without a detour of more than a tenth."""
    bad = rows["error"][(rows["failure"] >= 2) | (rows["detour"] > 1.1)]
    return float(bad.min()) if len(bad) else 180.0


def _error_finding(kind: ErrorMap, table: Table) -> str:
    found = [
        f"{variant.label} {largest_direct(of_variant(table, i)):.0f}°"
        for i, variant in enumerate(kind.variants)
    ]
    return "Errors are undone on a direct way up to: " + ", ".join(found)


def _error_caption(kind: ErrorMap) -> str:
    law = "kinematic" if kind.law == "clik" else "dynamic"
    return (
        "Distance from the middle: the size of the error, 0 to 180 deg, the white circle is 90 "
        "deg; direction: its axis in the x-y plane of the end effector. Colour: the length of the "
        f"way over that of a direct turn, under {law} control; red: it does not settle within "
        f"{kind.duration:g} s, or diverges."
    )


@pictures.register
def _(kind: GainMap, table: Table) -> list[Picture]:
    """Return the highest speed over distance and gain, one scale for all."""
    count = len(kind.variants)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.6 * count + 1.0, 2.0), layout="constrained")
        grid = figure.subplots(1, count, sharex=True, sharey=True, squeeze=False)
        for i, (axes, variant) in enumerate(zip(grid.flat, kind.variants, strict=True)):
            x, y, ratio, error = _gain_grid(of_variant(table, i))
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
    return [Picture("gain", _gain_finding(kind, table), _gain_caption(kind), figure)]


def _gain_grid(rows: Table) -> tuple[Array, ...]:
    """Return distances, gains, peak speed over that desired and worst error [deg]."""
    x, y = np.unique(rows["closest"]), np.unique(rows["gain"])
    order = np.lexsort((rows["closest"], rows["gain"]))
    shape = (len(y), len(x))
    return x, y, rows["speed_ratio"][order].reshape(shape), rows["worst_deg"][order].reshape(shape)


def failing_distance(rows: Table, settled: float) -> float:
    """Return the largest distance [deg] at which some gain errs by more than settled; 0 if none."""
    failing = rows["closest"][rows["worst_deg"] > settled]
    return float(failing.max()) if len(failing) else 0.0


def _gain_finding(kind: GainMap, table: Table) -> str:
    found = []
    for i, variant in enumerate(kind.variants):
        distance = failing_distance(of_variant(table, i), kind.settled)
        found.append(f"{variant.label} {f'within {distance:.2g}°' if distance else 'nowhere'}")
    return f"Errors above {kind.settled:g}° near the pole: " + ", ".join(found)


def _gain_caption(kind: GainMap) -> str:
    law = "kinematic" if kind.law == "clik" else "dynamic"
    return (
        f"A desired frame turns at {kind.speed:g} deg/s past the pole, from zero error, under "
        f"{law} control with {1e3 * kind.dt:g} ms a step and {kind.noise:g} deg of noise. White: "
        f"an error of {kind.settled:g} deg. What has no pole of its own passes that of XYZ."
    )
