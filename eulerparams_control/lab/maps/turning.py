"""Maps of errors that have to vanish: the law, its gains, and when a run has failed."""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.lab.maps.base import MapKind, Table, Variant
from eulerparams_control.lab.maps.run import Outcome, Sampling, failure, run
from eulerparams_control.lab.maps.tip import Drive, Tip
from eulerparams_control.laws.clik import ClikLaw
from eulerparams_control.laws.dynamic_control import ResolvedAcceleration
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import DesiredFrame

LAWS = ("clik", "dynamic")


@dataclass(frozen=True, kw_only=True)
class TurningMap(MapKind):
    """An orientation error has to vanish.

    Attributes:
        law: "clik" (23), (28) or "dynamic" (38), (40).
        rate: [1/s] of the error: k_Po of CLIK; of dynamic control k_Po = rate^2, k_Vo = 2 rate.
        dt: [s] a step.
        duration: [s] within which it has to settle.
        noise: [deg] of the measured orientation.
        settled: [deg] error that counts as none.
        fast: peak speed, over that of a direct turn, that counts as a failure.
    """

    law: str = "dynamic"
    rate: float = 20.0
    dt: float = 2e-3
    duration: float = 0.6
    noise: float = 0.05
    settled: float = 0.5
    fast: float = 1.5

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise UnknownNameError("law", self.law, LAWS)
        for name in ("rate", "dt", "duration"):
            if not getattr(self, name) > 0:
                raise ConfigurationError(f"{name} is 0; expected more")

    def motion_law(
        self, variant: Variant, rate: float | None = None
    ) -> ClikLaw | ResolvedAcceleration:
        """Return the law with its fair gains: the same rate of small errors for all."""
        rate = rate or self.rate
        if self.law == "clik":
            return ClikLaw(variant.representation, k_Po=variant.k_factor * rate)
        k_P, k_V = variant.k_factor * rate**2, 2 * rate
        return ResolvedAcceleration(variant.representation, k_Po=k_P, k_Vo=k_V)

    def direct_peak(self, theta: float) -> float:
        """Return the peak speed [rad/s] of a direct turn by theta [rad] at this rate.

        k theta of dtheta = -k theta; k theta / e of a critically damped error.
        """
        return self.rate * theta / (1 if self.law == "clik" else math.e)

    @property
    def sampling(self) -> Sampling:
        """How its runs are sampled."""
        bound, noise = math.radians(self.settled), math.radians(self.noise)
        return Sampling(self.dt, self.duration, noise, bound)

    def settle(
        self, variant: Variant, tip: Tip, R_d: Array, theta: float, random: np.random.Generator
    ) -> dict[str, float]:
        """Return what becomes of a tip that is theta [rad] away from R_d (3, 3), at rest."""
        desired = DesiredFrame(tip.state.p_e, R_d)
        drive = Drive(self.motion_law(variant), tip)
        outcome = run(drive, lambda _: desired, self.sampling, random)
        return self.row(outcome, self.direct_peak(theta), theta)

    def row(self, outcome: Outcome, direct: float, theta: float) -> dict[str, float]:
        """Return the outcome as numbers of a map.

        Args:
            outcome: of the run.
            direct: [rad/s] peak speed of a direct turn.
            theta: [rad] its length.
        """
        return {
            "speed_ratio": outcome.peak / direct,
            "detour": outcome.travel / theta,
            "worst_deg": math.degrees(outcome.worst),
            "final_deg": math.degrees(outcome.final),
            "settle_time": outcome.settled,
            "failure": failure(outcome, self.fast * direct),
        }


def share_failed(rows: Table) -> float:
    """Return the share [%] of runs that failed."""
    return 100 * float(np.mean(rows["failure"] > 0)) if len(rows["failure"]) else math.nan
