"""Inverse dynamics, section IV: from the acceleration of the tip to the efforts of the joints."""

import math
from dataclasses import astuple, dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError, RobotError
from eulerparams_control.laws._old.chain import WORK, chain_of_robot, efforts, place
from eulerparams_control.laws._old.compiled import (
    NONE,
    Array,
    Input,
    Inputs,
    Row,
    Rows,
    entry,
    kernel,
    layout,
    to_rows,
)
from eulerparams_control.laws._old.friction import friction_effort
from eulerparams_control.laws._old.inverse import invert, resolve
from eulerparams_control.laws._old.limits import UNLIMITED, limit_acceleration, subtract
from eulerparams_control.laws._old.scheme import check_gains
from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.laws.inverse import DampedInverse
from eulerparams_control.laws.limits import JointLimits, clip, factor_within
from eulerparams_control.robot.robot import DynamicState, Robot, RobotState

# Time constant [s] of the acceleration that disturbances cause.
_DRIFT_TIME = 0.005


# Least eigenvalue of a valid joint inertia [kg m^2].
_LEAST_INERTIA = 1e-7


class _Numbers(NamedTuple):
    """The law in numbers: its gains, the damping of the inverse, and what is compensated."""

    k_posture: float
    k_null: float
    eps: float
    lambda_max: float
    length: float
    gravity: bool
    coriolis: bool


_read_numbers = layout(_Numbers).read

NUMBERS = layout(_Numbers).width
"""How many floats :attr:`InverseDynamics.numbers` has."""


@dataclass(frozen=True)
class InverseDynamics:
    """The law (33): from the acceleration of the tip to the efforts of the joints.

    Attributes:
        inverse: of the Jacobian.
        gravity, coriolis: whether g and C dq are compensated here; some robots do it themselves.
        friction: that is compensated; None for no compensation.
        posture: (n,) [rad or m] to which a redundant arm tends, or None.
        k_posture: gain of that tendency [1/s^2].
        k_null: damping [1/s] of motions that do not move the tip.
        joints: the limits of the joints, modulo whose turns positions differ; None: no turns.
    """

    inverse: DampedInverse = field(default_factory=DampedInverse)
    gravity: bool = True
    coriolis: bool = True
    friction: JointFriction | None = None
    posture: Array | None = None
    k_posture: float = 10.0
    k_null: float = 10.0
    joints: JointLimits | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        check_gains(self, "k_posture", "k_null")

    def acceleration(self, state: DynamicState, a: Array) -> Array:
        """Return ddq (n,) = J^-1 (a - dJ dq), eq. (33), refs. [16], [17].

        With damping and posture where J* leaves a choice:
        ddq = J* (a - dJ dq) + (I - J* J) (-k_null dq - k_posture (q - posture)).
        """
        arm, ddq = state.arm, np.empty(len(state.arm.q))
        given = self.numbers, self.posture_rows
        resolve_acceleration(arm.q, arm.dq, arm.J, state.dJ_dq, a, *given, ddq)
        return ddq

    def effort(self, robot: Robot, arm: RobotState, ddq: Array, h: Array = NONE) -> Array:
        """Return tau (n,) = B ddq + C dq + d + g + J' h, eqs. (33), (48), without limits.

        Of the terms that are compensated here; h (6,) [N, Nm] is what the end effector exerts
        on the environment, base frame.
        """
        n, given = len(ddq), (self.friction_rows, self.numbers, UNLIMITED)
        past, wanted, tau = np.empty((PAST, n)), np.empty(n), np.empty(n)
        state = chain_of_robot(robot), arm.q, arm.dq, arm.J
        command_effort(*state, ddq, h, 0.0, 0.0, past, *given, wanted, tau)
        return tau

    @cached_property
    def numbers(self) -> Array:
        """What it is made of, as a row."""
        damped, compensated = self.inverse, (self.gravity, self.coriolis)
        damping = damped.eps, damped.lambda_max, damped.length
        return to_rows(_Numbers, _Numbers(self.k_posture, self.k_null, *damping, *compensated))

    @cached_property
    def posture_rows(self) -> Array:
        """The posture above the limits of the joints (6, n); (0, 0): there is none."""
        if self.posture is None:
            return np.empty((0, 0))
        turns = np.zeros((len(UNLIMITED), len(self.posture)))
        return np.vstack((self.posture, turns if self.joints is None else self.joints.rows))

    @cached_property
    def friction_rows(self) -> Array:
        """Viscous and Coulomb friction (2, n) that is compensated; (2, 0): none is."""
        friction = self.friction
        return np.empty((2, 0)) if friction is None else np.array([*astuple(friction)])


DQ, DDQ, TAU, DRIFT, SPEED, EXTERNAL = range(6)
"""Rows of what is known of the command before: speeds measured then, all NaN if it was not obeyed;
the accelerations that were wanted; the efforts that act, all NaN if the weight does; by how
much [rad/s^2] the joints accelerate more than commanded; speeds measured then, obeyed or not, all
NaN if they are not known; and what the environment exerts on the joints [Nm]."""

PAST = EXTERNAL + 1
OBSERVER_RATE = 100.0
"""Rate [1/s] at which the external efforts are estimated."""

RATE = 5
"""Row of the rates of the efforts, below the limits of the joints."""

_EFFORT = 3  # the row of the limits of the efforts

# What changed an effort: the law asks for too much acceleration, effort or change of it; or it
# is not finite.
SLOWED, CUT, RAMPED, INFINITE = 1, 2, 4, 8


@entry
def resolve_acceleration(
    q: Input, dq: Input, J: Inputs, dJ_dq: Input, a: Input, numbers: Input, posture: Rows, ddq: Row
) -> None:
    """Fill ddq (n,): see :meth:`InverseDynamics.acceleration`."""
    n, given = len(q), _read_numbers(numbers, 0)
    inverse, ddq_0, bracket = np.empty((n, 6)), np.zeros(n), np.empty(6)
    invert(J, given.eps, given.lambda_max, given.length, inverse)
    if len(posture) > 0:
        subtract(posture[1:], posture[0], q, ddq_0)
    for i in range(n):
        ddq_0[i] = given.k_posture * ddq_0[i] - given.k_null * dq[i]
    for i in range(6):
        bracket[i] = a[i] - dJ_dq[i]
    resolve(inverse, J, bracket, ddq_0, ddq)  # eq. (33)


@kernel
def commanded(
    chain: Rows, work: Rows, q: Input, dq: Input, J: Inputs, ddq: Input, h: Input,
    dt: float, lasts: float, past: Rows, friction: Rows, numbers: Input, limits: Rows,
    wanted: Row, tau: Row,
) -> int:  # fmt: skip
    """Fill tau (n,) = B ddq + C dq + d + g + J' h, eqs. (33), (48), within the limits.

    Of the terms that are compensated here.  Return what was changed.

    Args:
        chain: of the arm; ``work`` has where its joints are.
        q, dq, J: (n,), (n,), (6, n) of the arm.
        ddq: (n,) wanted.
        h: (6,) [N, Nm] what the end effector exerts on the environment; (0,) is nothing.
        dt: [s] since the command before, which acts for ``lasts`` [s].
        past: rows of the command before, which become those of this one.
        friction: (2, n), viscous and Coulomb, that is compensated; (2, 0) is none.
        numbers: of the inverse dynamics; what is not compensated the robot adds itself.
        limits: (5, n) of the joints, and the rates [Nm/s] of the efforts; or of no joint.
        wanted: (n,) is filled with the accelerations within the limits.
        tau: (n,) is filled.
    """
    n, found, drift, given = len(q), 0, past[DRIFT], _read_numbers(numbers, 0)
    is_limited, gravity, coriolis = limits.shape[1] > 0, given.gravity, given.coriolis
    still, weight, added = np.zeros(n), np.empty(n), np.zeros(n)  # the latter by the robot itself
    efforts(chain, dq, still, work, True, True, weight)
    if not (gravity and coriolis):
        efforts(chain, dq, still, work, gravity, coriolis, added)
        for i in range(n):
            added[i] = weight[i] - added[i]
    _observe(chain, dq, work, dt, added, friction, past)
    for i in range(n):
        wanted[i] = ddq[i]
    if is_limited:
        if not math.isnan(past[DQ, 0]) and dt > 0.0:  # the efforts before were as wanted
            for i in range(n):
                more = (dq[i] - past[DQ, i]) / dt - past[DDQ, i]
                drift[i] += (1.0 - math.exp(-dt / _DRIFT_TIME)) * (more - drift[i])
        if limit_acceleration(limits, q, dq, ddq, dt, drift, wanted):
            found |= SLOWED
    efforts(chain, dq, wanted, work, gravity, coriolis, tau)
    for i in range(n):
        if friction.shape[1] > 0:
            tau[i] += friction_effort(friction[0, i], friction[1, i], dq[i])
        for j in range(len(h)):
            tau[i] += J[j, i] * h[j]  # eq. (48)
        if not math.isfinite(tau[i]):
            return INFINITE
    if is_limited:
        found |= _limit_effort(chain, work, lasts, past, gravity, weight, added, limits, tau)
    for i in range(n):
        past[DQ, i] = math.nan if found & (CUT | RAMPED) else dq[i]
        past[DDQ, i], past[TAU, i], past[SPEED, i] = wanted[i], tau[i], dq[i]
    return found


@kernel
def _observe(
    chain: Rows, dq: Input, work: Rows, dt: float, added: Row, friction: Rows, past: Rows
) -> None:  # fmt: skip
    """Estimate the external efforts: B ddq + C dq + d + g - tau, eq. (32)."""
    if not dt > 0.0 or math.isnan(past[SPEED, 0]) or math.isnan(past[TAU, 0]):
        return
    n, part = len(dq), 1.0 - math.exp(-OBSERVER_RATE * dt)
    ddq, needed = np.empty(n), np.empty(n)
    for i in range(n):
        ddq[i] = (dq[i] - past[SPEED, i]) / dt
    efforts(chain, dq, ddq, work, True, True, needed)
    for i in range(n):
        e = needed[i] - added[i] - past[TAU, i]
        if friction.shape[1] > 0:
            e += friction_effort(friction[0, i], friction[1, i], dq[i])
        if math.isfinite(e):
            past[EXTERNAL, i] += part * (e - past[EXTERNAL, i])


@kernel
def _limit_effort(
    chain: Rows, work: Rows, lasts: float, past: Rows, gravity: bool, weight: Row, added: Row,
    limits: Rows, tau: Row,
) -> int:  # fmt: skip
    """Limit tau (n,), and its change from what acts; return what was changed.

    One factor cuts all joints: about C dq + g for the limits, about what acts for the rates.
    """
    n, found = len(tau), 0
    step, room, last = np.empty(n), np.empty(n), past[TAU].copy()
    for i in range(n):
        step[i] = tau[i] + added[i] - weight[i]
    factor = factor_within(weight, step, limits[_EFFORT])
    for i in range(n):
        most, asked = limits[_EFFORT, i], tau[i] + added[i]
        if factor < 1.0 or abs(asked) > most:
            found |= CUT
            tau[i] = clip(weight[i] + factor * step[i], -most, most) - added[i]
    if math.isnan(last[0]):
        last[:] = 0.0
        if gravity:
            still = np.zeros(n)
            efforts(chain, still, still, work, True, False, last)
    for i in range(n):
        step[i], room[i] = tau[i] - last[i], limits[RATE, i] * lasts
    factor = factor_within(np.zeros(n), step, room)
    if factor < 1.0:
        found |= RAMPED
        for i in range(n):
            tau[i] = last[i] + factor * step[i]
    return found


@entry
def command_effort(
    chain: Rows, q: Input, dq: Input, J: Inputs, ddq: Input, h: Input,
    dt: float, lasts: float, past: Rows, friction: Rows, numbers: Input, limits: Rows,
    wanted: Row, tau: Row,
) -> int:  # fmt: skip
    """Fill tau (n,) as ``commanded``, for an arm whose joints have to be placed."""
    work = np.empty((len(q), WORK))
    place(chain, q, work)
    return commanded(
        chain, work, q, dq, J, ddq, h, dt, lasts, past, friction, numbers, limits, wanted, tau
    )


def fitted(dynamics: InverseDynamics, robot: Robot) -> InverseDynamics:
    """Return the inverse dynamics of the robot, whose posture and friction fit it."""
    given = {"posture": dynamics.posture}
    if dynamics.friction is not None:
        given["friction_viscous"] = dynamics.friction.viscous
        given["friction_coulomb"] = dynamics.friction.coulomb
    for name, values in given.items():
        if values is not None and values.shape != (robot.n,):
            raise ConfigurationError(
                f"{name} has {values.size} values; expected one for each of the {robot.n} "
                f"joints {', '.join(robot.joints)}"
            )
    inverse = replace(dynamics.inverse, length=robot.length)
    return replace(dynamics, joints=robot.limits, inverse=inverse)


def check_model(robot: Robot) -> None:
    """Raise RobotError unless the URDF has what inverse dynamics needs."""
    efforts = zip(robot.joints, robot.limits.effort, strict=True)
    weak = [joint for joint, most in efforts if not most > 0]
    if weak:
        raise RobotError(
            f"the URDF has an effort limit of 0 for {', '.join(weak)}; expected what each can "
            "exert, in effort of its <limit>"
        )
    if robot.mount:
        raise RobotError(
            f"{', '.join(robot.mount)} can turn between the root of the URDF and base_frame "
            f"{robot.base_frame}: the direction of gravity is not known"
        )
    zero = np.zeros(robot.n)
    B = robot.dynamic_state(zero, zero).B
    if not np.linalg.eigvalsh(B)[0] > _LEAST_INERTIA:
        raise RobotError(
            "the joint inertia is not positive definite: the URDF lacks <inertial> of some links "
            f"beyond {robot.joints[0]}; efforts cannot be computed without them"
        )
