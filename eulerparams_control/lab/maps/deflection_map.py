"""Kind "deflection": how far moments of any size turn the compliant frame."""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.lab.maps.base import Picture, Row, Table
from eulerparams_control.lab.maps.sampling import directions, random_axis, with_tool_axis
from eulerparams_control.lab.maps.stiffness_map import PressedMap


@dataclass(frozen=True, kw_only=True)
class DeflectionMap(PressedMap):
    """Moments about random axes at random orientations, from small to almost the stiffness.

    ``samples`` counts the sizes of the moment.

    Attributes:
        trials: orientations and axes for each size.
        largest: moment over stiffness [rad].
    """

    kind = "deflection"

    trials: int = 20
    largest: float = 0.98

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
        """Return the turn over the moment."""
        from eulerparams_control.lab.maps.deflection_picture import picture

        return [picture(self, table)]
