"""Maps of errors that have to vanish: law, gains, failure; kinds "orientation" and "error"."""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.lab.maps.base import MapKind, MapVariant, Row, Table
from eulerparams_control.lab.maps.run import (
    DrivenTip,
    FreeTip,
    Sampling,
    Tip,
    TurnOutcome,
    failure,
    run,
)
from eulerparams_control.lab.maps.sampling import away, directions, random_axis, with_tool_axis
from eulerparams_control.laws.clik import ClikLaw
from eulerparams_control.laws.dynamic_control import ResolvedAcceleration
from eulerparams_control.laws.rotations import Array, exp
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
        self, variant: MapVariant, rate: float | None = None
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
        self, variant: MapVariant, tip: Tip, R_d: Array, theta: float, random: np.random.Generator
    ) -> dict[str, float]:
        """Return what becomes of a tip that is theta [rad] away from R_d (3, 3), at rest."""
        desired = DesiredFrame(tip.state.p_e, R_d)
        drive = DrivenTip(self.motion_law(variant), tip)
        outcome = run(drive, lambda _: desired, self.sampling, random)
        return self.row(outcome, self.direct_peak(theta), theta)

    def row(self, outcome: TurnOutcome, direct: float, theta: float) -> dict[str, float]:
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
        drive = DrivenTip(self.motion_law(self.variant(cell)), tip)
        outcome = run(drive, desired, self.sampling, random)
        if outcome.worst > self.sampling.bound:  # it had settled: it was to stay so
            outcome = outcome._replace(settled=math.inf)
        speed = math.sqrt(omega_d @ omega_d)
        return self.row(outcome, speed, speed * self.duration)


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
