"""Maps of orientation errors that have to vanish: in each cell a law moves a tip.

The tip is a free frame, or that of a real arm without its servos.  A free frame has J = I: it has
no workspace and no singularity of its own, so that what fails is the representation.  The laws are
those of the nodes: :class:`ClikLaw`, :class:`ResolvedAcceleration`, :class:`InverseDynamics`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.lab.maps.base import MapKind, MapVariant
from eulerparams_control.laws.clik import ClikLaw
from eulerparams_control.laws.dynamic_control import ResolvedAcceleration
from eulerparams_control.laws.inverse_dynamics import InverseDynamics
from eulerparams_control.laws.rotations import Array, angle_between, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import Robot, RobotState
from sim_bridge.environment.keys import number, word

_NONE, _SIX, _J = np.zeros(3), np.zeros(6), np.eye(6)

_FASTEST = 1e6  # [rad/s] beyond it has diverged

LAWS = ("clik", "dynamic")

FINE, FAST, UNSETTLED, DIVERGED = 0, 1, 2, 3

MotionLaw = ClikLaw | ResolvedAcceleration
"""Of kinematic (23), (28) or dynamic control (38), (40)."""


class FreeTip:
    """A free frame, which turns as it is told; its joint velocity is its twist.

    Args:
        R: (3, 3) where it is at first.
        omega: (3,) [rad/s] how it turns then.
    """

    def __init__(self, R: Array, omega: Array = _NONE) -> None:
        self._R, self._omega = R, omega

    @property
    def state(self) -> RobotState:
        """Its kinematics now."""
        return RobotState(_SIX, _SIX, _NONE, self._R, _NONE, self._omega, _J)

    def move(self, dq: Array, dt: float) -> None:
        """Turn at an angular velocity for dt [s]."""
        self._omega = dq[3:]
        self._R = exp(dt * self._omega) @ self._R

    def accelerate(self, a: Array, dt: float) -> None:
        """Turn at an angular acceleration for dt [s]."""
        before, self._omega = self._omega, self._omega + dt * a[3:]
        self._R = exp(dt / 2 * (before + self._omega)) @ self._R


class ArmTip:
    """The tip of an arm whose inverse dynamics (33) is exact.

    Args:
        robot: the arm.
        q: (n,) where it is at first, at rest.
    """

    def __init__(self, robot: Robot, q: Array) -> None:
        self._robot, self._dynamics = robot, InverseDynamics()
        self._q, self._dq = q, np.zeros_like(q)

    @property
    def state(self) -> RobotState:
        """Its kinematics now."""
        return self._robot.state(self._q, self._dq)

    def move(self, dq: Array, dt: float) -> None:
        """Move at a joint velocity for dt [s]."""
        self._q, self._dq = self._q + dt * dq, dq

    def accelerate(self, a: Array, dt: float) -> None:
        """Move at an acceleration a (6,) [m/s^2, rad/s^2] of the tip for dt [s]."""
        state = self._robot.dynamic_state(self._q, self._dq)
        before, self._dq = self._dq, self._dq + dt * self._dynamics.acceleration(state, a)
        self._q = self._q + dt / 2 * (before + self._dq)


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

    law: str = word(default="dynamic", choices=LAWS)
    rate: float = number(default=20.0, above=0.0)
    dt: float = number(default=2e-3, above=0.0)
    duration: float = number(default=0.6, above=0.0)
    noise: float = number(default=0.05, least=0.0)
    settled: float = number(default=0.5, least=0.0)
    fast: float = number(default=1.5, least=0.0)

    def motion_law(self, variant: MapVariant, rate: float | None = None) -> MotionLaw:
        """Return the law with its fair gains: the same rate of small errors for all."""
        rate = rate or self.rate
        if self.law == "clik":
            return ClikLaw(variant.representation, k_Po=variant.k_factor * rate)
        k_P, k_V = variant.k_factor * rate**2, 2 * rate
        return ResolvedAcceleration(variant.representation, k_Po=k_P, k_Vo=k_V)

    @property
    def law_name(self) -> str:
        """The kind of control, in words."""
        return "kinematic" if self.law == "clik" else "dynamic"

    def direct_peak(self, theta: float) -> float:
        """Return the peak speed [rad/s] of a direct turn by theta [rad] at this rate.

        k theta of dtheta = -k theta; k theta / e of a critically damped error.
        """
        return self.rate * theta / (1 if self.law == "clik" else math.e)

    def run(
        self,
        law: MotionLaw,
        tip: FreeTip | ArmTip,
        desired: Callable[[float], DesiredFrame],
        duration: float,
        random: np.random.Generator,
        direct: tuple[float, float],
        must_stay: bool = False,
    ) -> dict[str, float]:
        """Return what becomes of a tip that a law drives to a desired frame, as numbers of a map.

        Args:
            law: the law.
            tip: the tip.
            desired: the desired frame over time [s].
            duration: [s] of the run.
            random: of the noise.
            direct: [rad/s] peak speed of a direct turn, [rad] its length.
            must_stay: whether an error is a failure at any time after the first step.

        Returns:
            peak speed and travel over those of a direct turn; largest error after the first step
            and error at the end [deg], 180 if the state became non-finite or the law had no answer;
            time [s] from which on the error stays below ``settled``, inf if it does not; failure.
        """
        dt, steps = self.dt, round(duration / self.dt)
        noise = math.radians(self.noise) * random.normal(size=(steps, 3))
        errors, speeds, end = np.zeros(steps), np.zeros(steps), steps
        x_de: Any = None
        for i in range(steps):
            target, state = desired(i * dt), tip.state
            errors[i] = angle_between(state.R_e, target.R_d)
            measured = state._replace(R_e=exp(noise[i]) @ state.R_e)
            try:
                if isinstance(law, ClikLaw):
                    dq, _, x_de = law.velocity(measured, target, x_de)
                    tip.move(dq, dt)
                else:
                    a, _, x_de = law.acceleration(measured, target, x_de)
                    tip.accelerate(a, dt)
                omega = tip.state.omega_e
                speeds[i] = math.sqrt(omega @ omega)
            except (SingularityError, OverflowError):
                speeds[i] = math.inf
            if not speeds[i] < _FASTEST:
                end = i
                break
        return self._row(errors, speeds, end, direct, must_stay)

    def _row(
        self, errors: Array, speeds: Array, end: int, direct: tuple[float, float], must_stay: bool
    ) -> dict[str, float]:
        """Return the numbers of a run with errors [rad] and speeds [rad/s] up to step ``end``."""
        steps, (highest, theta), bound = len(errors), direct, math.radians(self.settled)
        diverged = end < steps
        worst = float((errors[: end + 1] if diverged else errors[1:]).max())
        outside = np.flatnonzero(errors > bound)
        last = int(outside[-1]) + 1 if len(outside) else 0
        lost = diverged or last >= steps or (must_stay and worst > bound)
        peak = _FASTEST if diverged else float(speeds.max())
        fast = FAST if peak > self.fast * highest else FINE
        return {
            "speed_ratio": peak / highest,
            "detour": float(speeds[:end].sum() * self.dt) / theta,
            "worst_deg": math.degrees(worst),
            "final_deg": math.degrees(math.pi if diverged else float(errors[-1])),
            "settle_time": math.inf if lost else last * self.dt,
            "failure": DIVERGED if diverged else UNSETTLED if lost else fast,
        }

    def settle(
        self,
        variant: MapVariant,
        tip: FreeTip | ArmTip,
        R_d: Array,
        theta: float,
        random: np.random.Generator,
    ) -> dict[str, float]:
        """Return what becomes of a tip that is theta [rad] away from R_d (3, 3), at rest."""
        desired, law = DesiredFrame(tip.state.p_e, R_d), self.motion_law(variant)
        direct = self.direct_peak(theta), theta
        return self.run(law, tip, lambda _: desired, self.duration, random, direct)

    def follow(
        self,
        law: MotionLaw,
        desired: Callable[[float], DesiredFrame],
        turn: tuple[float, float],
        duration: float,
        random: np.random.Generator,
    ) -> dict[str, float]:
        """Return what becomes of a tip that follows a turn, from zero error.

        Args:
            law: the law.
            desired: the desired frame over time.
            turn: its speed [rad/s] and its length [rad].
            duration: [s] of it.
            random: of the noise.
        """
        first = desired(0.0)
        tip = FreeTip(first.R_d, first.omega_d)
        return self.run(law, tip, desired, duration, random, turn, must_stay=True)
