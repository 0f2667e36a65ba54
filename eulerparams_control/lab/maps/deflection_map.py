"""Kind "deflection": how far moments of all sizes turn the compliant frame."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eulerparams_control.analysis.labels import colour
from eulerparams_control.errors import SingularityError
from eulerparams_control.lab.maps.base import Picture, Row, Table, count, multiples
from eulerparams_control.lab.maps.pressed import PressedMap
from eulerparams_control.lab.maps.sampling import directions, random_axis, with_tool_axis
from eulerparams_control.laws.rotations import Array
from sim_bridge.environment.keys import number

_CLOSED: dict[str, tuple[str, Callable[[Array], Array]]] = {
    "euler_parameters": ("arcsin(m)", np.arcsin),
    "rotation_vector": ("m", lambda m: m),
    "angle_axis": ("arcsin(2 m) / 2, up to m = 1/2", lambda m: np.arcsin(2 * m) / 2),
}
"""Turn [rad] over m, the moment over the stiffness; NaN where there is no equilibrium."""


@dataclass(frozen=True, kw_only=True)
class DeflectionMap(PressedMap):
    """Moments about random axes at random orientations, from small to almost the stiffness.

    ``samples`` counts the sizes of the moment.

    Attributes:
        trials: orientations and axes for each size.
        largest: moment over stiffness [rad].
    """

    kind = "deflection"

    trials: int = count(default=20)
    largest: float = number(default=0.98, least=0.0)

    def cells(self) -> list[Row]:
        """Return variants x sizes x trials; a trial has the same orientation for each size."""
        sizes = self.largest * np.arange(1, self.samples + 1) / self.samples
        return [
            {"variant": v, "place": trial, "moment": moment}
            for v in range(len(self.variants))
            for moment in sizes.tolist()
            for trial in range(self.trials)
        ]

    def simulate(self, cell: Row) -> dict[str, float]:
        """Return the angle [deg] of the turn, and that between its axis and the moment."""
        random = self.random(cell)
        z = directions(self.trials)[int(cell["place"])]
        R_d = with_tool_axis(z, random.uniform(-math.pi, math.pi))
        axis = random_axis(random)
        mu = float(cell["moment"]) * self.K_o[0] * axis
        try:
            turn = self.turn(self.law(self.variant(cell)), R_d, mu)
        except SingularityError:
            return {"turn": math.nan, "deviation": math.nan}
        theta = math.sqrt(turn @ turn)
        if not theta > 0:  # it does not come to rest
            return {"turn": math.nan, "deviation": math.nan}
        cosine = float(turn @ (R_d.T @ axis)) / theta
        deviation = math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
        return {"turn": math.degrees(theta), "deviation": deviation}

    def pictures(self, table: Table) -> list[Picture]:
        """Return the turn of each representation, the middle of all trials and their range."""
        figure, grid = multiples(self, (1.35, 1.9), 0.5, sharex=True, sharey=True)
        spread = []
        for axes, (variant, rows) in zip(grid, self.parts(table), strict=True):
            m = np.unique(rows["moment"])
            turns = np.array([rows["turn"][rows["moment"] == size] for size in m])  # (m, trials)
            axes.fill_between(m, turns.min(1), turns.max(1), color=colour(0), alpha=0.25, lw=0)
            axes.plot(m, np.median(turns, axis=1), color=colour(0), lw=1.3)
            if variant.orientation in _CLOSED:
                text, law = _CLOSED[variant.orientation]
                fine = np.linspace(0, 1, 200)
                with np.errstate(invalid="ignore"):
                    axes.plot(fine, np.degrees(law(fine)), color="black", lw=0.8, ls=(0, (4, 2)))
                axes.text(0.04, 0.93, text, fontsize=6.5, va="top", transform=axes.transAxes)
            widest = float(np.nanmax(turns.max(axis=1) - turns.min(axis=1)))
            spread.append(f"{variant.label} {widest:.3g}°")
        grid[0].set(ylabel="turn [deg]", xlim=(0, 1), ylim=(0, 100))
        grid[0].set(xticks=[0, 0.5, 1], yticks=[0, 30, 60, 90])
        figure.supxlabel("moment / stiffness [rad]", fontsize=8)
        title = "The same moment turns by angles that differ with the orientation by: "
        caption = (
            f"Line: the median of {self.trials} orientations and axes; band: from the least to the "
            "largest; dashed: in closed form. The moment of Euler parameters saturates at k, at 90 "
            "deg; that of angle/axis at k/2, at 45 deg, beyond which the frame turns over."
        )
        return [Picture("deflection", title + ", ".join(spread), caption, figure)]
