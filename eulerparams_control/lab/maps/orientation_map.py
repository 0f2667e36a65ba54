"""Kind "orientation": where in SO(3) a law fails, for errors of several sizes and in motion."""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.lab.maps.base import Picture, Row, Table
from eulerparams_control.lab.maps.run import run
from eulerparams_control.lab.maps.sampling import away, directions, random_axis, with_tool_axis
from eulerparams_control.lab.maps.tip import Drive, FreeTip
from eulerparams_control.lab.maps.turning import TurningMap
from eulerparams_control.laws.rotations import Array, exp
from eulerparams_control.motion.frames import DesiredFrame


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

    trials: int = 4
    errors: tuple[float, ...] = (30.0, 90.0, 150.0)
    speeds: tuple[float, ...] = (60.0,)

    def cells(self) -> list[Row]:
        """Return variants x (errors, speeds) x directions x trials."""
        tasks = [(e, 0.0) for e in self.errors] + [(0.0, s) for s in self.speeds]
        places = [
            {"place": d * self.trials + trial, "x": x, "y": y, "z": z}
            for d, (x, y, z) in enumerate(directions(self.samples).tolist())
            for trial in range(self.trials)
        ]
        return [
            {"variant": v, "error": e, "speed": s, **place}
            for v in range(len(self.variants))
            for e, s in tasks
            for place in places
        ]

    def simulate(self, cell: Row) -> dict[str, float]:
        """Return speed, detour, settle time and failure of the turn."""
        random = self.random(cell)
        z = np.array([cell["x"], cell["y"], cell["z"]], dtype=float)
        R_d = with_tool_axis(z, random.uniform(-math.pi, math.pi))
        r = random_axis(random)
        if cell["speed"]:
            return self._follow(cell, R_d, math.radians(float(cell["speed"])) * r, random)
        theta = math.radians(float(cell["error"]))
        tip = FreeTip(away(R_d, theta * r))
        return self.settle(self.variant(cell), tip, R_d, theta, random)

    def _follow(
        self, cell: Row, R_d: Array, omega_d: Array, random: np.random.Generator
    ) -> dict[str, float]:
        """Return what becomes of a tip that follows a turn at omega_d (3,) [rad/s] past R_d."""
        half = self.duration / 2

        def desired(t: float) -> DesiredFrame:
            return DesiredFrame(np.zeros(3), exp((t - half) * omega_d) @ R_d, omega_d=omega_d)

        tip = FreeTip(desired(0.0).R_d, omega_d)
        drive = Drive(self.motion_law(self.variant(cell)), tip)
        outcome = run(drive, desired, self.sampling, random)
        if outcome.worst > self.sampling.bound:  # it had settled: it was to stay so
            outcome = outcome._replace(settled=math.inf)
        speed = math.sqrt(omega_d @ omega_d)
        return self.row(outcome, speed, speed * self.duration)

    def pictures(self, table: Table) -> list[Picture]:
        """Return the peak speed over the sphere of tool axes, and where it fails."""
        from eulerparams_control.lab.maps.orientation_picture import picture

        return [picture(self, table)]
