"""Inverse dynamics, section IV: from joint accelerations to the efforts of the joints, and back.

Notation: ``tau`` (n,) [Nm or N] efforts, ``ddq`` (n,) joint accelerations, ``B, C_dq, g`` terms of
eq. (32), ``h`` (6,) [N, Nm] what the end effector exerts on the environment, base frame, ``e`` (n,)
external efforts: what the environment exerts on the joints.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from eulerparams_control.errors import RobotError, SingularityError
from eulerparams_control.laws.inverse import DampedInverse
from eulerparams_control.laws.jit import b1, jit, new_vector, types, vector
from eulerparams_control.laws.limits import SHORTEST, JointLimits, factor_within
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import DynamicState, Robot

if TYPE_CHECKING:
    from eulerparams_control.parameters.efforts import EffortParameters

# Time constant [s] of the acceleration that disturbances cause, and rate [1/s] at which the
# external efforts are estimated.
_DRIFT_TIME, _OBSERVER_RATE = 0.005, 100.0

# Least eigenvalue of a valid joint inertia [kg m^2].
_LEAST_INERTIA = 1e-7


def joint_acceleration(
    state: DynamicState, a: Array, inverse: DampedInverse, ddq_0: Array
) -> Array:
    """Return ddq (n,) = J^-1 (a - dJ dq), which gives the tip the acceleration a (6,), eq. (33).

    The null space of J follows ddq_0 (n,).  The inverse is J*, refs. [16], [17].
    """
    J = state.arm.J
    ddq: Array = ddq_0 + inverse(J) @ (a - state.dJ_dq - J @ ddq_0)  # (33)
    return ddq


def joint_efforts(state: DynamicState, ddq: Array, h: Array | None = None) -> Array:
    """Return tau (n,) = B ddq + C dq + g + J' h, eqs. (33), (48), without friction."""
    tau: Array = state.B @ ddq + state.C_dq + state.g  # (33)
    return tau if h is None else tau + state.arm.J.T @ h  # (48)


class InverseDynamics:
    """Efforts for joint accelerations, within the limits; estimates of what else acts on the arm.

    Attributes:
        rate: (n,) [Nm/s] at which efforts may change.
        tau: (n,) the last efforts; None before the first.
        ddq: (n,) the last accelerations, as far as the limits allow them.
        dq: (n,) speeds in the tick before; None where they are not known.
        external: (n,) e as it is estimated by eq. (32).
        drift: (n,) by how much [rad/s^2] the joints accelerate more than commanded.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self._zero = robot, np.zeros(robot.n)
        refuse_model(robot)
        self._start: Array | None = None
        self.reset()

    def change(self, parameters: "EffortParameters") -> None:
        """Go over to other parameters; if they are refused, the ones before stay in force."""
        robot = self.robot
        friction, posture = parameters.friction_of(robot), parameters.posture_of(robot)
        rate = parameters.effort_rate(robot)
        self._friction, self._posture, self.rate = friction, posture, rate
        self.inverse, self._parameters = parameters.inverse(robot), parameters

    def reset(self) -> None:
        """Forget the efforts before."""
        self.tau: Array | None = None
        self.dq: Array | None = None
        self.external = self._zero
        self.resume()

    def resume(self) -> None:
        """Forget the accelerations before; the efforts act on."""
        self.ddq = self.drift = self._zero
        self._is_obeyed = False  # by the efforts before: they were not cut

    def start_from(self, effort: Array | None) -> None:
        """Begin at the efforts (n,) that the robot reports, if it does; else at its weight.

        A robot that compensates its weight itself begins at none.
        """
        self._start = None
        is_known = effort is not None and np.isfinite(effort).all() and effort.any()
        if effort is not None and is_known and self._parameters.compensate_gravity:
            self._start = self.robot.limits.limit_effort(effort)[0]

    def added(self, state: DynamicState) -> Array:
        """Return the efforts (n,) that the robot adds itself: the terms not compensated here."""
        p, added = self._parameters, self._zero
        if not p.compensate_gravity:
            added = added + state.g
        return added if p.compensate_coriolis else added + state.C_dq

    def acting(self, unknown: Array) -> Array:
        """Return the efforts (n,) that act until the next ones; ``unknown`` if nobody knows."""
        acting = self._start if self.tau is None else self.tau
        return unknown if acting is None else acting

    def null_acceleration(self, q: Array, dq: Array) -> Array:
        """Return ddq_0 (n,) = -k_null dq - k_posture (q - posture), which the tip does not feel."""
        p = self._parameters
        ddq_0 = -p.k_null * dq
        if self._posture is not None:
            ddq_0 += p.k_posture * self.robot.limits.difference(self._posture, q)
        return ddq_0

    def command(
        self,
        dt: float,
        state: DynamicState,
        ddq: Array,
        h: Array | None,
        limits: JointLimits | None,
    ) -> bool:
        """Set ``tau`` for ddq (n,) and h (6,); return whether one of the limits changed it.

        One factor cuts all efforts: from C dq + g on for their limits, from the efforts that act
        on for their rates.
        """
        arm, slowed, cut, is_ramped = state.arm, False, False, False
        self.observe(dt, state)
        if limits is not None:
            ddq, slowed = limits.limit_acceleration(arm.q, arm.dq, ddq, dt, self.drift)
        tau = joint_efforts(state, ddq, h)
        if self._friction is not None:
            tau = tau + self._friction.effort(arm.dq)  # d of (33)
        if not math.isfinite(tau @ tau):
            raise SingularityError("the joints are measured at a state of infinite efforts")
        added = self.added(state)
        if limits is None:
            tau = tau - added
        else:
            tau, cut = cut_from(state.C_dq + state.g, tau, limits.effort)
            weight = state.g if self._parameters.compensate_gravity else self._zero
            tau, is_ramped = self.ramped(dt, tau - added, self.acting(weight))
        self.keep(tau, ddq, arm.dq, is_obeyed=not (cut or is_ramped))
        return slowed or cut or is_ramped

    def keep(self, tau: Array, ddq: Array, dq: Array, *, is_obeyed: bool) -> None:
        """Keep what acts until the next tick, and the speeds dq (n,)."""
        self.tau, self.ddq, self.dq, self._is_obeyed = tau, ddq, dq, is_obeyed
        self._start = None

    def observe(self, dt: float, state: DynamicState) -> Array:
        """Update ``external`` and ``drift`` from the last dt [s]; return e (n,) of that time.

        e = B ddq + C dq + d + g - tau, eq. (32), with ddq from the measured speeds; ``external``,
        unchanged, where these are not known.
        """
        if not dt > 0.0 or self.dq is None or self.tau is None:
            return self.external
        ddq = (state.arm.dq - self.dq) / dt
        e: Array = joint_efforts(state, ddq) - self.added(state) - self.tau  # (32)
        if self._friction is not None:
            e += self._friction.effort(state.arm.dq)
        if math.isfinite(e @ e):
            part = 1.0 - math.exp(-_OBSERVER_RATE * dt)
            self.external = self.external + part * (e - self.external)
        if self._is_obeyed:
            part = 1.0 - math.exp(-dt / _DRIFT_TIME)
            self.drift = self.drift + part * (ddq - self.ddq - self.drift)
        return e

    def ramped(self, dt: float, tau: Array, last: Array) -> tuple[Array, bool]:
        """Return tau (n,) as far as the rates allow from ``last`` in dt [s]; and if they cut it."""
        lasts = max(dt, SHORTEST) if self.tau is None else dt
        change, is_cut = cut_from(self._zero, tau - last, self.rate * lasts)
        return last + change, is_cut


@jit(types.Tuple((new_vector, b1))(vector, vector, vector))
def cut_from(base: Array, tau: Array, most: Array) -> tuple[Array, bool]:
    """Return tau (n,), by one factor as near to ``base`` as |tau| <= most needs; and whether cut.

    Where the base itself is beyond, it is clipped.
    """
    factor, is_beyond = factor_within(base, tau - base, most), (np.abs(tau) > most).any()
    if factor == 1.0 and not is_beyond:
        return tau.copy(), False
    return np.minimum(np.maximum(base + factor * (tau - base), -most), most), True


def refuse_model(robot: Robot) -> None:
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
