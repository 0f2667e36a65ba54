"""Kind "orientation": over the tool axis, do errors vanish, and are turns followed?"""

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import LogNorm

from eulerparams_control.lab.maps.base import Picture, Row, Table, count, of_variant
from eulerparams_control.lab.maps.sampling import away, directions, random_axis, with_tool_axis
from eulerparams_control.lab.maps.spheres import WHERE, spheres
from eulerparams_control.lab.maps.turning import FAST, FreeTip, TurningMap
from eulerparams_control.laws.rotations import Array, exp
from eulerparams_control.motion.frames import DesiredFrame
from sim_bridge.environment.keys import numbers


@dataclass(frozen=True, kw_only=True)
class OrientationMap(TurningMap):
    """A free frame turns back to R_d by an error about a random axis, or follows a turn past R_d.

    ``samples`` counts the directions of the tool axis, evenly over the sphere; the roll about it
    is random.

    Attributes:
        trials: at each direction, each with another axis and roll.
        errors: [deg] of a frame at rest.
        speeds: [deg/s] of a desired frame that turns for the whole run, R_d in the
            middle of its way; an error above ``settled`` is a failure at any time.
    """

    kind = "orientation"

    trials: int = count(default=4)
    errors: tuple[float, ...] = numbers(default=(30.0, 90.0, 150.0))
    speeds: tuple[float, ...] = numbers(default=(60.0,))

    @property
    def _tasks(self) -> list[tuple[float, float]]:
        """Errors and speeds."""
        return [(e, 0.0) for e in self.errors] + [(0.0, s) for s in self.speeds]

    def cells(self) -> list[Row]:
        """Return variants x (errors, speeds) x directions x trials."""
        places = [
            {"place": d * self.trials + trial, "x": x, "y": y, "z": z}
            for d, (x, y, z) in enumerate(directions(self.samples).tolist())
            for trial in range(self.trials)
        ]
        return [
            {"variant": v, "error": e, "speed": s, **place}
            for v in range(len(self.variants))
            for e, s in self._tasks
            for place in places
        ]

    def simulate(self, cell: Row) -> dict[str, float]:
        """Return speed, detour, settle time and failure of the turn."""
        random = self.random(cell)
        z = np.array([cell["x"], cell["y"], cell["z"]], dtype=float)
        R_d = with_tool_axis(z, random.uniform(-math.pi, math.pi))
        r = random_axis(random)
        if cell["speed"]:
            omega_d, half = math.radians(float(cell["speed"])) * r, self.duration / 2

            def desired(t: float) -> DesiredFrame:
                return DesiredFrame(np.zeros(3), exp((t - half) * omega_d) @ R_d, omega_d=omega_d)

            speed, law = math.sqrt(omega_d @ omega_d), self.motion_law(self.variant(cell))
            turn = speed, speed * self.duration
            return self.follow(law, desired, turn, self.duration, random)
        theta = math.radians(float(cell["error"]))
        tip = FreeTip(away(R_d, theta * r))
        return self.settle(self.variant(cell), tip, R_d, theta, random)

    def pictures(self, table: Table) -> list[Picture]:
        """Return the peak speeds of the worst runs, and the share of those that fail."""
        rows = {}
        for error, speed in self._tasks:
            name = f"error {error:g}°" if error else f"turning {speed:g}°/s"
            each = [
                of_variant(table, i, error=error, speed=speed) for i in range(len(self.variants))
            ]
            rows[name] = [
                (*worst_of(part, "speed_ratio"), f"{share_failed(part):.1f} % fail")
                for part in each
            ]
        scale, ticks = "peak angular speed / that of a direct turn  [1]", (1, 1.5, 2, 3)
        figure = spheres(self, rows, LogNorm(1.0, 3.0), "viridis", scale, ticks, "max")
        shares = sorted(
            ((share_failed(part), v.label) for v, part in self.parts(table)), reverse=True
        )
        found = ", ".join(f"{label} {share:.1f} %" for share, label in shares)  # the best last
        caption = (
            f"Colour: the highest angular speed of the worst of {self.trials} runs at each "
            f"direction of {WHERE}, over that of a direct turn; red: one of them is not within "
            f"{self.settled:g} deg after {self.duration:g} s, while turning at any time, or "
            "diverges. Below each sphere the share of all runs that fail so, or by more than "
            f"{self.fast:g} times the speed of a direct turn. Circles: the poles. A free frame "
            f"(J = I), noise {self.noise:g} deg, {1e3 * self.dt:g} ms a step, the same errors and "
            "noise for each representation."
        )
        return [Picture("orientation", f"Runs that fail: {found}", caption, figure)]


def share_failed(rows: Table) -> float:
    """Return the share [%] of runs that failed."""
    return 100 * float(np.mean(rows["failure"] > 0)) if len(rows["failure"]) else math.nan


def worst_of(table: Table, name: str) -> tuple[Table, Array]:
    """Return the distinct tool axes, and the largest value at each; NaN where a run is lost."""
    axes = np.stack([table["x"], table["y"], table["z"]], axis=1)
    distinct, index = np.unique(axes, axis=0, return_inverse=True)
    values = np.full(len(distinct), -np.inf)
    np.maximum.at(values, index.ravel(), np.where(table["failure"] > FAST, np.inf, table[name]))
    values[np.isinf(values)] = np.nan
    return dict(zip("xyz", distinct.T, strict=True)), values
