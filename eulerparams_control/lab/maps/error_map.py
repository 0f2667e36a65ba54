"""Kind "error": over size and axis of the error, is it undone on a direct way?"""

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import LogNorm

from eulerparams_control.lab.maps.base import Picture, Row, Table, multiples
from eulerparams_control.lab.maps.sampling import away, with_tool_axis
from eulerparams_control.lab.maps.spheres import FAILED
from eulerparams_control.lab.maps.turning import UNSETTLED, FreeTip, TurningMap
from sim_bridge.environment.keys import number, vector


@dataclass(frozen=True, kw_only=True)
class ErrorMap(TurningMap):
    """A free frame turns back by errors theta r with r in the x-y plane of the end effector.

    ``samples`` counts the sizes of the error from 0 to 180 deg; there are as many axes.

    Attributes:
        tool_axis: of the desired orientation.
        roll: [deg] of the tool about it.
    """

    kind = "error"

    tool_axis: tuple[float, ...] = vector(default=(0.5, 0.6, 0.62))
    roll: float = number(default=40.0, least=0.0)

    def cells(self) -> list[Row]:
        """Return variants x axes x sizes."""
        n = self.samples
        return [
            {
                "variant": v,
                "place": i * n + j,
                "azimuth": 360.0 * i / n,
                "error": 180.0 * (j + 0.5) / n,
            }
            for v in range(len(self.variants))
            for i in range(n)
            for j in range(n)
        ]

    def simulate(self, cell: Row) -> dict[str, float]:
        """Return speed, detour, settle time and failure of the turn."""
        z = np.array(self.tool_axis)
        R_d = with_tool_axis(z / math.sqrt(z @ z), math.radians(self.roll))
        phi, theta = math.radians(float(cell["azimuth"])), math.radians(float(cell["error"]))
        error = theta * np.array([math.cos(phi), math.sin(phi), 0.0])
        tip = FreeTip(away(R_d, error))
        return self.settle(self.variant(cell), tip, R_d, theta, self.random(cell))

    def pictures(self, table: Table) -> list[Picture]:
        """Return a disc for each representation: radius the size of the error, angle its axis."""
        n = self.samples
        phi = np.linspace(0, 2 * math.pi, n + 1) - math.pi / n
        size = np.linspace(0, 180, n + 1)
        figure, grid = multiples(self, (1.45, 2.0), 0.8, subplot_kw={"projection": "polar"})
        for axes, (_, rows) in zip(grid, self.parts(table), strict=True):
            lost = rows["failure"] >= UNSETTLED
            ratio = np.where(lost, np.nan, rows["detour"])
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
            axes.set_xlabel(f"{100 * float(np.mean(lost)):.1f} % never settle", fontsize=7)
        bar = figure.colorbar(mesh, ax=grid, extend="max", aspect=25, pad=0.01)
        bar.set_ticks([1, 1.5, 2, 3], labels=["1", "1.5", "2", "3"])
        bar.minorticks_off()
        bar.set_label("travel / direct turn [1]", fontsize=7)
        found = ", ".join(f"{v.label} {largest_direct(rows):.0f}°" for v, rows in self.parts(table))
        caption = (
            "Distance from the middle: the size of the error, 0 to 180 deg, the white circle is 90 "
            "deg; direction: its axis in the x-y plane of the end effector. Colour: the length of "
            f"the way over that of a direct turn, under {self.law_name} control; red: it does not "
            f"settle within {self.duration:g} s, or diverges."
        )
        title = f"Errors are undone on a direct way up to: {found}"
        return [Picture("error", title, caption, figure)]


def largest_direct(rows: Table) -> float:
    """Return the error [deg] up to which all settle without a detour of more than a tenth."""
    bad = rows["error"][(rows["failure"] >= UNSETTLED) | (rows["detour"] > 1.1)]
    return float(bad.min()) if len(bad) else 180.0
