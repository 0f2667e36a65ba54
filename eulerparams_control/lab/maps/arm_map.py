"""Kind "arm": the same turns by a free frame and by a real arm: does the failure transfer?"""

import math
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eulerparams_control.analysis.labels import colour
from eulerparams_control.errors import EulerParamsError
from eulerparams_control.lab.maps.base import Picture, Row, Table, of_variant
from eulerparams_control.lab.maps.sampling import away, over_directions, random_axis, with_tool_axis
from eulerparams_control.lab.maps.turning import DIVERGED, ArmTip, FreeTip, TurningMap
from eulerparams_control.laws.inverse import smallest_singular_value
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot
from sim_bridge.environment.keys import any_word, number


@dataclass(frozen=True, kw_only=True)
class ArmMap(TurningMap):
    """An arm and a free frame turn to R_d from the same errors, the tip staying where it is.

    ``samples`` counts the directions of the tool axis.

    Attributes:
        robot: of config/robots.
        error: [deg].
        least_singular: smallest singular value of J at the start and at R_d; below, the arm
            itself is singular there, and the cell is left out.
    """

    kind = "arm"

    robot: str = any_word(default="ur5")
    error: float = number(default=30.0, least=0.0)
    least_singular: float = number(default=0.06, least=0.0)

    @cached_property
    def arm(self) -> tuple[Robot, Array]:
        """The arm and its home (n,)."""
        about = load_robot(self.robot)
        robot = Robot(about.urdf, about.base_frame, about.tip_frame, about.joints)
        return robot, np.array(about.home)

    def besides(self) -> Any:
        """Return the whole description of the robot."""
        return asdict(load_robot(self.robot))

    def cells(self) -> list[Row]:
        """Return variants x directions."""
        return over_directions(len(self.variants), self.samples)

    def simulate(self, cell: Row) -> dict[str, float]:
        """Return the outcomes of the arm, and those of the free frame with the prefix free_."""
        random, theta = self.random(cell), math.radians(self.error)
        z = np.array([cell["x"], cell["y"], cell["z"]], dtype=float)
        R_d = with_tool_axis(z, random.uniform(-math.pi, math.pi))
        R_0 = away(R_d, theta * random_axis(random))
        variant = self.variant(cell)
        free = self.settle(variant, FreeTip(R_0), R_d, theta, self.random(cell))
        q = self.positions(R_0, R_d)
        outcome = dict.fromkeys(free, math.nan)
        if q is not None:
            tip = ArmTip(self.arm[0], q)
            outcome = self.settle(variant, tip, R_d, theta, self.random(cell))
        named = {f"free_{name}": value for name, value in free.items()}
        return {**outcome, **named, "reached": float(q is not None)}

    def positions(self, R_0: Array, R_d: Array) -> Array | None:
        """Return q (n,) with the tip of home at R_0; None if it or R_d cannot be reached well."""
        robot, home = self.arm
        p = robot.state(home, np.zeros_like(home)).p_e
        q_0 = self._search(home, DesiredFrame(p, R_0))
        if q_0 is None or self._search(q_0, DesiredFrame(p, R_d)) is None:
            return None
        return q_0

    def _search(self, q: Array, frame: DesiredFrame) -> Array | None:
        """Return q (n,) for a frame, if it is within reach and well inside."""
        robot, _ = self.arm
        try:
            q = inverse_kinematics(robot, frame, q)
        except EulerParamsError:
            return None
        J = robot.state(q, np.zeros_like(q)).J
        return q if smallest_singular_value(J) > self.least_singular else None

    def pictures(self, table: Table) -> list[Picture]:
        """Return peak speed and detour of the arm over those of the free frame."""
        figure = Figure(figsize=(5.2, 2.5), layout="constrained")
        grid = figure.subplots(1, 2)
        parts = [(variant, reached(rows)) for variant, rows in self.parts(table)]
        names = {"speed_ratio": "peak speed / direct turn", "detour": "travel / direct turn"}
        for axes, (name, label) in zip(grid, names.items(), strict=True):
            top = 1.0
            for i, (variant, rows) in enumerate(parts):
                top = max(top, *rows[name], *rows[f"free_{name}"])
                axes.plot(rows[f"free_{name}"], rows[name], "x+.1"[i % 4], color=colour(i), ms=4,
                          mew=0.8, label=variant.label, zorder=2 + i)  # fmt: skip
            axes.plot([0.8, top], [0.8, top], color="0.5", lw=0.6, zorder=1)
            axes.set(xlabel=f"free frame: {label}", ylabel=f"{self.robot}: {label}")
            axes.set(xscale="log", yscale="log")
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_formatter("{x:g}")
                axis.set_minor_formatter("{x:g}")
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
        peaks = (f"{v.label} up to {rows['speed_ratio'].max():.2f} times" for v, rows in parts)
        title = (
            f"On the {self.robot} the peak speed is, over a direct turn: {', '.join(peaks)}; its "
            f"detour differs from the free frame's by {100 * difference(table):.2g} % in the median"
        )
        count = int((of_variant(table, 0)["reached"] > 0).sum())
        caption = (
            f"The same turns by {self.error:g} deg through inverse kinematics and exact inverse "
            f"dynamics (33) of the {self.robot}, the tip staying where it is: {count} of "
            f"{self.samples} directions that it reaches away from its own singularities."
        )
        return [Picture("arm", title, caption, figure)]


def reached(rows: Table) -> Table:
    """Return the rows in which the arm reaches start and end, and neither run diverged."""
    chosen = (rows["reached"] > 0) & (rows["failure"] < DIVERGED)
    chosen &= rows["free_failure"] < DIVERGED
    return {name: column[chosen] for name, column in rows.items()}


def difference(rows: Table) -> float:
    """Return the median relative difference of the detours of arm and free frame."""
    rows = reached(rows)
    return float(np.median(np.abs(rows["detour"] / rows["free_detour"] - 1)))
