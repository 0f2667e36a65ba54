"""Kind "stiffness": the apparent stiffness of the compliant frame over the tool axis."""

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import LogNorm, Normalize

from eulerparams_control.analysis.labels import number
from eulerparams_control.errors import SingularityError
from eulerparams_control.lab.maps.base import Picture, Row, Table
from eulerparams_control.lab.maps.pressed import PressedMap
from eulerparams_control.lab.maps.sampling import over_directions, with_tool_axis
from eulerparams_control.lab.maps.spheres import WHERE, Cell, spheres
from sim_bridge.environment.keys import key, word

_NO_ANSWER = {"k_min": math.nan, "k_max": math.nan, "deviation": math.nan}
_WHERE = (
    f"Over the direction of {WHERE}, the roll about it random. The "
    "compliance law runs to rest under small moments about the axes of K_o; circles: the poles."
)


@dataclass(frozen=True, kw_only=True)
class StiffnessMap(PressedMap):
    """Small moments about three axes of the desired frame give the apparent stiffness.

    ``samples`` counts the directions of the tool axis.

    Attributes:
        moment: over the stiffness about its axis [rad]: small.
        shown: "stiffness", or "deviation" of the turn from the axis of the moment.
    """

    kind = "stiffness"

    moment: float = key(default=1e-3, least=0.0)
    shown: str = word(default="stiffness", choices=("stiffness", "deviation"))

    def cells(self) -> list[Row]:
        """Return variants x directions."""
        return over_directions(len(self.variants), self.samples)

    def simulate(self, cell: Row) -> dict[str, float]:
        """Return least and largest apparent over chosen stiffness, and the worst deviation [deg].

        The apparent stiffness is the inverse of the matrix of turns by moment.
        """
        z = np.array([cell["x"], cell["y"], cell["z"]], dtype=float)
        R_d = with_tool_axis(z, self.random(cell).uniform(-math.pi, math.pi))
        moments = self.moment * np.diag(self.K_o)
        try:
            law = self.law(self.variant(cell))
            turns = np.array([self.turn(law, R_d, R_d @ mu) for mu in moments])
            K = np.linalg.inv(np.linalg.solve(moments, turns).T)
        except (SingularityError, np.linalg.LinAlgError):
            return _NO_ANSWER
        root = np.diag(np.array(self.K_o) ** -0.5)
        if not np.isfinite(K).all():
            return _NO_ANSWER
        relative = np.linalg.eigvalsh(root @ (K + K.T) / 2 @ root)
        cosines = np.diag(turns) / np.linalg.norm(turns, axis=1)
        worst = math.degrees(math.acos(float(np.clip(cosines.min(), -1, 1))))
        return {"k_min": float(relative[0]), "k_max": float(relative[-1]), "deviation": worst}

    def pictures(self, table: Table) -> list[Picture]:
        """Return the apparent stiffness, or the deviation."""
        return [self._stiffness(table) if self.shown == "stiffness" else self._deviation(table)]

    def _stiffness(self, table: Table) -> Picture:
        """Return the largest and the smallest apparent stiffness; (58): k/(1-s) and k/(1+s)."""
        columns, ticks = (
            {"k_max": "largest", "k_min": "smallest"},
            (1 / 16, 1 / 4, 1 / 2, 1, 2, 4, 16),
        )
        label, norm = "apparent stiffness / K_o  [1]", LogNorm(1 / 16, 16)
        figure = spheres(self, self._rows(table, columns), norm, "PuOr", label, ticks, "both")
        found = ", ".join(
            f"{v.label} {number(np.nanmin(rows['k_min']))} to {number(np.nanmax(rows['k_max']))}"
            for v, rows in self.parts(table)
        )
        title = f"Apparent over chosen rotational stiffness: {found}"
        caption = (
            f"{_WHERE} With Euler angles it is k/(1+s), k and k/(1-s) by (58), s = |sin beta|."
        )
        return Picture("stiffness", title, caption, figure)

    def _deviation(self, table: Table) -> Picture:
        """Return the angle between the turn and the axis of the moment, an axis of K_o (65)."""
        label, ticks = "angle between turn and moment  [deg]", range(0, 91, 15)
        rows = self._rows(table, {"deviation": "worst axis"})
        figure = spheres(self, rows, Normalize(0, 90), "viridis", label, ticks)
        worst = ", ".join(
            f"{v.label} {np.nanmax(part['deviation']):.1f}°" for v, part in self.parts(table)
        )
        title = f"A moment about an axis of K_o turns about another one, at worst by: {worst}"
        caption = (
            f"{_WHERE} K_o = {', '.join(f'{k:g}' for k in self.K_o)} Nm/rad. With geometric "
            "consistency (65) the turn is about the axis of the moment."
        )
        return Picture("deviation", title, caption, figure)

    def _rows(self, table: Table, columns: dict[str, str]) -> dict[str, list[Cell]]:
        """Return the spheres of columns of the table, and the range of each below it."""
        return {
            name: [
                (part, part[c], f"{np.nanmin(part[c]):.2f} to {np.nanmax(part[c]):.2f}")
                for _, part in self.parts(table)
            ]
            for c, name in columns.items()
        }
