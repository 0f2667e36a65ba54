"""Kind "gain": how close to a pole, and with which gain, a sampled law still follows."""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.maps.base import MapVariant, Row
from eulerparams_control.lab.maps.run import DrivenTip, FreeTip, Sampling, run
from eulerparams_control.lab.maps.sampling import passing
from eulerparams_control.lab.maps.turning_maps import TurningMap
from eulerparams_control.laws.rotations import exp
from eulerparams_control.motion.frames import DesiredFrame


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

    speed: float = 60.0
    arc: float = 40.0
    closest: tuple[float, ...] = (0.03, 30.0)
    gains: tuple[float, ...] = (10.0, 1000.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, ends in (("closest", self.closest), ("gains", self.gains)):
            if len(ends) != 2 or not 0 < ends[0] < ends[1]:
                raise ConfigurationError(f"{name} is {list(ends)}; expected a smaller and a larger")
        if not self.speed > 0:
            raise ConfigurationError("speed is 0; expected a motion")

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
        duration = arc / speed

        def desired(t: float) -> DesiredFrame:
            R_d = exp((speed * t - arc / 2) * n) @ R_m
            return DesiredFrame(np.zeros(3), R_d, omega_d=speed * n)

        tip = FreeTip(desired(0.0).R_d, speed * n)
        drive = DrivenTip(self.motion_law(variant, float(cell["gain"])), tip)
        sampling = Sampling(self.dt, duration, math.radians(self.noise), math.radians(self.settled))
        outcome = run(drive, desired, sampling, random)
        if outcome.worst > sampling.bound:  # it had settled: it was to stay so
            outcome = outcome._replace(settled=math.inf)
        return self.row(outcome, speed, arc)


def _spaced(ends: tuple[float, ...], count: int) -> list[float]:
    """Return numbers from end to end, evenly spaced in their logarithms."""
    values: list[float] = np.geomspace(ends[0], ends[1], count).tolist()
    return values


def _pole(variant: MapVariant) -> int:
    """Return the base axis to pass; of what has no pole there, x as for XYZ."""
    return 0 if variant.pole_axis is None else variant.pole_axis
