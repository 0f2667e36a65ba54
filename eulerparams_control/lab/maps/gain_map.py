"""Kind "gain": how close to a pole, and with which gain, a sampled law still follows."""

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import LogNorm

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.maps.base import MapVariant, Picture, Row, Table, multiples
from eulerparams_control.lab.maps.sampling import passing
from eulerparams_control.lab.maps.turning import TurningMap
from eulerparams_control.laws.rotations import exp
from eulerparams_control.motion.frames import DesiredFrame
from sim_bridge.environment.keys import number, numbers


@dataclass(frozen=True, kw_only=True)
class GainMap(TurningMap):
    """A desired frame turns past a pole; the tip follows it from zero error.

    ``samples`` counts the distances; the gains are half as many, ``rate`` is not used.  Both are
    spaced evenly in their logarithms.

    Attributes:
        speed: [deg/s] of the desired frame.
        arc: [deg] that it turns; the pole is beside its middle.
        closest: [deg] smallest and largest distance to the pole.
        gains: [1/s] smallest and largest.
    """

    kind = "gain"

    speed: float = number(default=60.0, above=0.0)
    arc: float = number(default=40.0, least=0.0)
    closest: tuple[float, ...] = numbers(default=(0.03, 30.0))
    gains: tuple[float, ...] = numbers(default=(10.0, 1000.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, ends in (("closest", self.closest), ("gains", self.gains)):
            if len(ends) != 2 or not 0 < ends[0] < ends[1]:
                raise ConfigurationError(f"{name} is {list(ends)}; expected a smaller and a larger")

    def cells(self) -> list[Row]:
        """Return variants x distances x gains."""
        distances = _spaced(self.closest, self.samples)
        gains = _spaced(self.gains, max(2, self.samples // 2))
        return [
            {"variant": v, "place": i * len(gains) + j, "closest": distance, "gain": gain}
            for v in range(len(self.variants))
            for i, distance in enumerate(distances)
            for j, gain in enumerate(gains)
        ]

    def simulate(self, cell: Row) -> dict[str, float]:
        """Return the highest speed over that of the desired frame, and the worst error."""
        random, variant = self.random(cell), self.variant(cell)
        speed, arc = math.radians(self.speed), math.radians(self.arc)
        roll = random.uniform(-math.pi, math.pi)
        R_m, n = passing(_pole(variant), math.radians(float(cell["closest"])), roll)

        def desired(t: float) -> DesiredFrame:
            R_d = exp((speed * t - arc / 2) * n) @ R_m
            return DesiredFrame(np.zeros(3), R_d, omega_d=speed * n)

        law = self.motion_law(variant, float(cell["gain"]))
        return self.follow(law, desired, (speed, arc), arc / speed, random)

    def pictures(self, table: Table) -> list[Picture]:
        """Return the highest speed over distance and gain, one scale for all."""
        figure, grid = multiples(self, (1.6, 2.0), 1.0, sharex=True, sharey=True)
        found = []
        for axes, (variant, rows) in zip(grid, self.parts(table), strict=True):
            x, y = np.unique(rows["closest"]), np.unique(rows["gain"])
            order = np.lexsort((rows["closest"], rows["gain"]))
            ratio, error = (rows[name][order].reshape(len(y), len(x))
                            for name in ("speed_ratio", "worst_deg"))  # fmt: skip
            mesh = axes.pcolormesh(
                x, y, ratio, norm=LogNorm(1, 100), cmap="viridis", rasterized=True,
                shading="nearest",
            )  # fmt: skip
            if (error > self.settled).any() and (error <= self.settled).any():
                axes.contour(x, y, error, levels=[self.settled], colors="white", linewidths=1.0)
            axes.set(xscale="log", yscale="log")
            axes.grid(False)
            distance = failing_distance(rows, self.settled)
            found.append(f"{variant.label} {f'within {distance:.2g}°' if distance else 'nowhere'}")
        grid[0].set_ylabel("rate of the error [1/s]")
        figure.supxlabel("closest distance to the pole [deg]", fontsize=8)
        bar = figure.colorbar(mesh, ax=grid, extend="max", aspect=25, pad=0.01)
        bar.set_label("peak / desired speed [1]", fontsize=7)
        caption = (
            f"A desired frame turns at {self.speed:g} deg/s past the pole, from zero error, under "
            f"{self.law_name} control with {1e3 * self.dt:g} ms a step and {self.noise:g} deg of "
            f"noise. White: an error of {self.settled:g} deg. What has no pole of its own passes "
            "that of XYZ."
        )
        title = f"Errors above {self.settled:g}° near the pole: {', '.join(found)}"
        return [Picture("gain", title, caption, figure)]


def failing_distance(rows: Table, settled: float) -> float:
    """Return the largest distance [deg] at which some gain errs by more than settled; 0 if none."""
    failing = rows["closest"][rows["worst_deg"] > settled]
    return float(failing.max()) if len(failing) else 0.0


def _spaced(ends: tuple[float, ...], count: int) -> list[float]:
    """Return numbers from end to end, evenly spaced in their logarithms."""
    values: list[float] = np.geomspace(ends[0], ends[1], count).tolist()
    return values


def _pole(variant: MapVariant) -> int:
    """Return the base axis to pass; of what has no pole there, x as for XYZ."""
    return 0 if variant.pole_axis is None else variant.pole_axis
