"""One simulation of a map: a law moves a tip; its outcome.

The tip is a free frame, or that of a real arm without its servos.  A free frame has J = I: it has
no workspace and no singularity of its own, so that what fails is the representation.  The laws are
those of the nodes: :class:`ClikLaw`, :class:`ResolvedAcceleration`, :class:`InverseDynamics`.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.laws.clik import ClikLaw
from eulerparams_control.laws.dynamic_control import ResolvedAcceleration
from eulerparams_control.laws.inverse_dynamics import InverseDynamics
from eulerparams_control.laws.rotations import Array, angle_between, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import Robot, RobotState

_NONE, _SIX = np.zeros(3), np.zeros(6)
_J = np.eye(6)

_FASTEST = 1e6  # [rad/s] beyond it has diverged

FINE, FAST, UNSETTLED, DIVERGED = 0, 1, 2, 3


class Tip(Protocol):
    """A tip that can be moved."""

    @property
    def state(self) -> RobotState:
        """Its kinematics now."""

    def move(self, dq: Array, dt: float) -> None:
        """Move at a joint velocity for dt [s]."""

    def accelerate(self, a: Array, dt: float) -> None:
        """Move at an acceleration a (6,) [m/s^2, rad/s^2] of the tip for dt [s]."""


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
        """Move at an acceleration of the tip for dt [s]."""
        state = self._robot.dynamic_state(self._q, self._dq)
        before, self._dq = self._dq, self._dq + dt * self._dynamics.acceleration(state, a)
        self._q = self._q + dt / 2 * (before + self._dq)


class DrivenTip:
    """A law of kinematic (23), (28) or dynamic control (38), (40) that moves a tip.

    Args:
        law: the law.
        tip: that it moves.
    """

    def __init__(self, law: ClikLaw | ResolvedAcceleration, tip: Tip) -> None:
        self.tip = tip
        self._law = law
        self._x_de: Any = None

    def step(self, measured: RobotState, desired: DesiredFrame, dt: float) -> None:
        """Move the tip for dt [s] as the law answers to what was measured.

        Raises:
            SingularityError: if the law has no finite answer.
        """
        if isinstance(self._law, ClikLaw):
            dq, _, self._x_de = self._law.velocity(measured, desired, self._x_de)
            self.tip.move(dq, dt)
        else:
            a, _, self._x_de = self._law.acceleration(measured, desired, self._x_de)
            self.tip.accelerate(a, dt)


class TurnOutcome(NamedTuple):
    """Outcome of a run.

    Attributes:
        peak: [rad/s] highest angular speed of the tip.
        travel: [rad] length of its way.
        worst: [rad] largest orientation error after the first step.
        final: [rad] orientation error at the end; of a run that diverged pi.
        settled: [s] from when on the error stays below a bound; inf if it does not.
        diverged: whether its state became non-finite, or the law had no answer.
    """

    peak: float
    travel: float
    worst: float
    final: float
    settled: float
    diverged: bool


class Sampling(NamedTuple):
    """How a run is sampled.

    Attributes:
        dt: [s] a step.
        duration: [s].
        noise: [rad] standard deviation of the measured orientation, about each axis.
        bound: [rad] orientation error below which it is settled.
    """

    dt: float
    duration: float
    noise: float
    bound: float


def run(
    drive: DrivenTip,
    desired: Callable[[float], DesiredFrame],
    sampling: Sampling,
    random: np.random.Generator,
) -> TurnOutcome:
    """Return what becomes of a tip that is driven to a desired frame over time."""
    dt, steps = sampling.dt, round(sampling.duration / sampling.dt)
    noise = sampling.noise * random.normal(size=(steps, 3))
    errors, speeds = np.zeros(steps), np.zeros(steps)
    for i in range(steps):
        target = desired(i * dt)
        state = drive.tip.state
        errors[i] = angle_between(state.R_e, target.R_d)
        try:
            drive.step(state._replace(R_e=exp(noise[i]) @ state.R_e), target, dt)
            omega = drive.tip.state.omega_e
            speeds[i] = math.sqrt(omega @ omega)
        except (SingularityError, OverflowError):
            speeds[i] = math.inf
        if not speeds[i] < _FASTEST:
            return _diverged(speeds[:i], errors[: i + 1], dt)
    return _outcome(speeds, errors, sampling)


def _outcome(speeds: Array, errors: Array, sampling: Sampling) -> TurnOutcome:
    outside = np.flatnonzero(errors > sampling.bound)
    last = int(outside[-1]) + 1 if len(outside) else 0
    settled = last * sampling.dt if last < len(errors) else math.inf
    travel = float(speeds.sum() * sampling.dt)
    worst = float(errors[1:].max())
    return TurnOutcome(float(speeds.max()), travel, worst, float(errors[-1]), settled, False)


def _diverged(speeds: Array, errors: Array, dt: float) -> TurnOutcome:
    travel = float(speeds.sum() * dt)
    return TurnOutcome(_FASTEST, travel, float(errors.max()), math.pi, math.inf, True)


def failure(outcome: TurnOutcome, highest: float) -> float:
    """Return how a run that had to settle failed: FINE, FAST, UNSETTLED or DIVERGED.

    One that never had an error has settled at once.

    Args:
        outcome: of the run.
        highest: [rad/s] speed that was not to be exceeded.
    """
    if outcome.diverged:
        return DIVERGED
    if math.isinf(outcome.settled):
        return UNSETTLED
    return FAST if outcome.peak > highest else FINE
