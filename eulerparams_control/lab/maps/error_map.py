"""Kind "error": how large an error may be: failure over a slice of the ball of rotation vectors."""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.lab.maps.base import Picture, Row, Table
from eulerparams_control.lab.maps.sampling import away, with_tool_axis
from eulerparams_control.lab.maps.tip import FreeTip
from eulerparams_control.lab.maps.turning import TurningMap


@dataclass(frozen=True, kw_only=True)
class ErrorMap(TurningMap):
    """A free frame turns back by errors theta r with r in the x-y plane of the end effector.

    ``samples`` counts the sizes of the error from 0 to 180 deg; there are as many axes.

    Attributes:
        tool_axis: of the desired orientation.
        roll: [deg] of the tool about it.
    """

    kind = "error"

    tool_axis: tuple[float, ...] = (0.5, 0.6, 0.62)
    roll: float = 40.0

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
        """Return the detour over the errors, and where it fails."""
        from eulerparams_control.lab.maps.error_picture import picture

        return [picture(self, table)]
