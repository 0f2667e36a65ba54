"""Inverse dynamics, section IV: from joint accelerations to the efforts of the joints, and back.

Notation: ``tau`` (n,) [Nm or N] efforts, ``ddq`` (n,) joint accelerations, ``B, C_dq, g`` terms of
eq. (32), ``h`` (6,) [N, Nm] what the end effector exerts on the environment, base frame, ``e`` (n,)
external efforts: what the environment exerts on the joints.
"""

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from eulerparams_control.errors import ModelError, RobotError, SingularityError
from eulerparams_control.laws.blend import Blend
from eulerparams_control.laws.hold import NO_CONTACT, JointHold, contact_force, release_rate
from eulerparams_control.laws.inverse import DampedInverse
from eulerparams_control.laws.jit import b1, jit, new_vector, types, vector
from eulerparams_control.laws.limits import SHORTEST, JointLimits, factor_within
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Bounds, JointCommand, Scheme, Tick, refuse_error
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import DynamicState, Robot, RobotState

if TYPE_CHECKING:
    from eulerparams_control.parameters.efforts import EffortParameters

# Time constant [s] of the acceleration that disturbances cause, and rate [1/s] at which the
# external efforts are estimated.
_DRIFT_TIME, _OBSERVER_RATE = 0.005, 100.0

# The reported efforts at rest differ from the model by this part of the weight, and this part of
# the effort limits, at most: friction, and a payload.
_MODEL_PART, _LIMIT_PART = 0.3, 0.03

# Efforts [Nm or N] that a robot reports: where all are smaller it has none, its brakes hold it.
_NOISE_EFFORT = 0.01

# Square [Nm^2] of the external efforts below which the arm touches nothing.
_NO_EFFORT = 1.0

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


class EffortControl(Scheme):
    """Base of the schemes that command efforts: inverse dynamics within limits, and the hold.

    Attributes:
        limits: of the joints; None: nothing is limited.
        tau: (n,) the last efforts; None before the first.
        ddq: (n,) the last accelerations, as far as the limits allow them.
        external: (n,) e as it is estimated by eq. (32).
        drift: (n,) by how much [rad/s^2] the joints accelerate more than commanded.
    """

    hold_rate = 20.0  # [1/s] states that come slower cannot hold the joints
    blend_time = 0.1  # [s] in which the command goes over to a law that replaces another
    parameters: "EffortParameters"
    orientation: OrientationRepresentation

    def __init__(self, robot: Robot, parameters: "EffortParameters") -> None:
        refuse_model(robot)
        self.robot, self._zero, self._blend = robot, np.zeros(robot.n), Blend(self.blend_time)
        self._start: Array | None = None
        self._take(parameters)
        self.reset(self._zero)

    def _take(self, parameters: Any) -> None:
        """Go over to other parameters; if they are refused, the ones before stay in force."""
        robot = self.robot
        friction, posture = parameters.friction_of(robot), parameters.posture_of(robot)
        rate, limits = parameters.effort_rate(robot), parameters.limits(robot)
        inverse, orientation = parameters.inverse(robot), parameters.representation()
        self.parameters, self.orientation = parameters, orientation
        self._friction, self._posture, self._rate, self.limits = friction, posture, rate, limits
        self.inverse, self._motion = inverse, parameters.motion_limits()

    @abstractmethod
    def _accelerate(
        self, dt: float, state: DynamicState, desired: DesiredFrame
    ) -> tuple[Array, Any, Any]:
        """Return ddq (n,) [rad/s^2] of the law, x_de, and the effects of a :class:`Tick`."""

    def _excess(self, dq: Array, ddq: Array, effects: Any) -> float:
        return 1.0 if self.limits is None else self.limits.excess_after(dq, ddq)

    def _effort_limits(self) -> JointLimits | None:
        return self.limits

    def change(self, parameters: "EffortParameters") -> None:
        """Go over to other parameters, without a jump of the command."""
        orientation = self.orientation
        self._take(parameters)
        self._see_release()
        if self.orientation != orientation:
            self._forget_x()  # it means nothing to another representation
        if not self._saturated:  # else its acceleration is not that of the arm: nothing to blend
            self._blend.replace(self.ddq)

    def _forget_x(self) -> None:
        self._x_de: Any = None

    @property
    def bounds(self) -> Bounds:
        """The limits of the joints, and the rate of the efforts."""
        return Bounds(self.limits, self._rate)

    def bound(self, joints: JointLimits) -> None:
        """Keep to limits of the joints from the next tick on."""
        self.limits = joints

    def start_from(self, effort: Array | None) -> None:
        """Begin at the efforts (n,) that the robot reports, if it does; else at its weight.

        A robot that compensates its weight itself begins at none.
        """
        effort, self._start = believed(effort, self.parameters), None
        if effort is not None and self.parameters.compensate_gravity:
            self._start = self.robot.limits.limit_effort(effort)[0]

    def skip(self) -> None:
        """Forget the speeds of the tick before, from which accelerations are estimated."""
        self._dq: Array | None = None

    def reset(self, q: Array) -> None:
        """Begin at the measured q (n,)."""
        self.tau: Array | None = None
        self.external, self._contact = self._zero, NO_CONTACT
        self.skip()
        self.resume(q)

    def resume(self, q: Array) -> None:
        """Begin at the measured q (n,), with the efforts and the contact as they are."""
        self.ddq = self.drift = self._zero
        self._is_obeyed = self._saturated = False  # by the efforts before, if they were not cut
        self._hold: JointHold | None = None
        self._home = q.copy()
        self._leave_the_law(self._home)
        self._see_release()

    def _see_release(self) -> None:
        if self._motion is not None:
            state, limit = self.robot.dynamic_state(self._q, self._zero), self.robot.limits.effort
            self.release_rate = release_rate(state, limit, self._motion.linear_speed)

    def _leave_the_law(self, q: Array) -> None:
        self._q = q
        self._forget_x()
        self._blend.reset()

    def hold(self, dt: float, q: Array, dq: Array, w: Array | None = None) -> JointCommand:
        """Return efforts that stop the joints, and hold them there: see :class:`JointHold`.

        It needs no orientation.  Friction, which helps to stop, is not compensated.  The contact
        w (6,) is measured, base frame, about the tip; None: it is estimated.
        """
        state, rate, length = self.robot.dynamic_state(q, dq), self._rate, self.robot.length
        self._leave_the_law(state.arm.q)
        added, limits = self._added(state), self.limits or self.robot.limits
        last = self._acting(state.C_dq + state.g - added)
        e_now, e = self._observe(dt, state), self.external
        if self._hold is None:
            drove_in = self._contact.drove_in
            self._hold = JointHold(limits, rate, length, state, e, w, drove_in)
        self._hold.limits, self._hold.rate = limits, rate
        tau, _ = self._ramped(dt, self._hold.effort(dt, state, e_now, e, w) - added, last)
        if not math.isfinite(tau @ tau):  # the measured state gives no finite efforts
            tau, self._hold, self.external = last, None, self._zero
        self._keep(tau, self._zero, state.arm.dq, is_obeyed=False)
        self.drift = self._zero
        return JointCommand(effort=tau)

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the gravitational efforts at q (n,): nothing in them gets stale."""
        state = self.robot.dynamic_state(q, self._zero)  # C dq = 0
        return JointCommand(effort=self.robot.limits.limit_effort(state.g - self._added(state))[0])

    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame) -> Tick:
        """Return the efforts for this instant; raises SingularityError, FollowingError."""
        state = self.robot.dynamic_state(q, dq)
        tick = self.follow(dt, state, desired)
        self.note_contact(dt, state.arm, desired, None, self.is_pressing)
        return tick

    def follow(
        self, dt: float, state: DynamicState, desired: DesiredFrame, h: Array | None = None
    ) -> Tick:
        """Return the efforts for a state of the arm, also against a contact h (6,), eq. (48)."""
        arm = state.arm
        self._q, self._hold = arm.q, None
        ddq, x_de, effects = self._accelerate(dt, state, desired)
        if self.limits is not None:
            refuse_error(desired, arm, self.parameters)
        if not math.isfinite(ddq @ ddq):
            raise SingularityError("the law asks for an infinite joint acceleration")
        ddq = self._blend(dt, ddq)
        excess = self._excess(arm.dq, ddq, effects)
        self._saturated = self._drive(dt, state, ddq, h)
        self._x_de = x_de
        command = JointCommand(effort=self.tau)
        return Tick(command, desired, arm, x_de, self._saturated, excess, None, effects)

    def _drive(self, dt: float, state: DynamicState, ddq: Array, h: Array | None) -> bool:
        """Set ``tau`` for ddq (n,) and h (6,); return whether one of the limits changed it.

        One factor cuts all efforts: from C dq + g on for their limits, from the efforts that act
        on for their rates.
        """
        arm, limits, slowed, cut, is_ramped = state.arm, self._effort_limits(), False, False, False
        self._observe(dt, state)
        if limits is not None:
            ddq, slowed = limits.limit_acceleration(arm.q, arm.dq, ddq, dt, self.drift)
        tau = joint_efforts(state, ddq, h)
        if self._friction is not None:
            tau = tau + self._friction.effort(arm.dq)  # d of (33)
        if not math.isfinite(tau @ tau):
            raise SingularityError("the joints are measured at a state of infinite efforts")
        added = self._added(state)
        if limits is None:
            tau = tau - added
        else:
            tau, cut = cut_from(state.C_dq + state.g, tau, limits.effort)
            weight = state.g if self.parameters.compensate_gravity else self._zero
            tau, is_ramped = self._ramped(dt, tau - added, self._acting(weight))
        self._keep(tau, ddq, arm.dq, is_obeyed=not (cut or is_ramped))
        return slowed or cut or is_ramped

    def _keep(self, tau: Array, ddq: Array, dq: Array, *, is_obeyed: bool) -> None:
        self.tau, self.ddq, self._dq, self._is_obeyed = tau, ddq, dq, is_obeyed
        self._start = None

    def _added(self, state: DynamicState) -> Array:
        """Return the efforts (n,) that the robot adds itself: the terms not compensated here."""
        p, added = self.parameters, self._zero
        if not p.compensate_gravity:
            added = added + state.g
        return added if p.compensate_coriolis else added + state.C_dq

    def _acting(self, unknown: Array) -> Array:
        """Return the efforts (n,) that act until the next ones; ``unknown`` if nobody knows."""
        acting = self._start if self.tau is None else self.tau
        return unknown if acting is None else acting

    def _ramped(self, dt: float, tau: Array, last: Array) -> tuple[Array, bool]:
        """Return tau (n,) as far as the rates allow from ``last`` in dt [s]; and if they cut it."""
        lasts = max(dt, SHORTEST) if self.tau is None else dt
        most = self._rate * lasts if lasts > 0.0 else self._zero  # rates may be infinite
        change, is_cut = cut_from(self._zero, tau - last, most)
        return last + change, is_cut

    def null_acceleration(self, q: Array, dq: Array) -> Array:
        """Return ddq_0 (n,) = -k_null dq - k_posture (q - posture), which the tip does not feel."""
        p = self.parameters
        ddq_0 = -p.k_null * dq
        if (way := self.way_to_posture(q)) is not None:
            ddq_0 += p.k_posture * way
        return ddq_0

    def _observe(self, dt: float, state: DynamicState) -> Array:
        """Update ``external`` and ``drift`` from the last dt [s]; return e (n,) of that time.

        e = B ddq + C dq + d + g - tau, eq. (32), with ddq from the measured speeds; ``external``,
        unchanged, where these are not known.
        """
        if not dt > 0.0 or self._dq is None or self.tau is None:
            return self.external
        ddq = (state.arm.dq - self._dq) / dt
        e: Array = joint_efforts(state, ddq) - self._added(state) - self.tau  # (32)
        if self._friction is not None:
            e += self._friction.effort(state.arm.dq)
        if math.isfinite(e @ e):
            part = 1.0 - math.exp(-_OBSERVER_RATE * dt)
            self.external = self.external + part * (e - self.external)
        if self._is_obeyed:
            part = 1.0 - math.exp(-dt / _DRIFT_TIME)
            self.drift = self.drift + part * (ddq - self.ddq - self.drift)
        return e

    def note_contact(
        self, dt: float, arm: RobotState, desired: DesiredFrame, force: Array | None, presses: bool
    ) -> None:
        """Sum up the work on a contact: of the motion, and of the environment on the arm.

        The force (3,) [N] on the tip is measured; None: it is estimated.  ``presses`` is whether
        the arm is commanded to exert one.
        """
        e, is_measured = self.external, force is not None
        if force is None:
            if not e @ e >= _NO_EFFORT:
                self._contact = NO_CONTACT
                return
            force = contact_force(arm.J, e, self.robot.length)
        self._contact = self._contact.after(dt, force, is_measured, desired.dp_d, arm.dp_e, presses)


@jit(types.Tuple((new_vector, b1))(vector, vector, vector))
def cut_from(base: Array, tau: Array, most: Array) -> tuple[Array, bool]:
    """Return tau (n,), by one factor as near to ``base`` as |tau| <= most needs; and whether cut.

    Where the base itself is beyond, it is clipped.
    """
    factor, is_beyond = factor_within(base, tau - base, most), (np.abs(tau) > most).any()
    if factor == 1.0 and not is_beyond:
        return tau.copy(), False
    return np.minimum(np.maximum(base + factor * (tau - base), -most), most), True


def believed(effort: Array | None, parameters: "EffortParameters") -> Array | None:
    """Return efforts (n,) that a robot reports, if they are those of its joints."""
    if effort is None or not np.isfinite(effort).all() or (np.abs(effort) < _NOISE_EFFORT).all():
        return None
    return effort if parameters.effort_feedback else None


def refuse_mismatch(
    robot: Robot, parameters: "EffortParameters", q: Array, effort: Array | None
) -> None:
    """Raise ModelError if the joints cannot bear the weight of the model, or bear another one.

    Args:
        robot: the model of the arm.
        parameters: whether the robot compensates gravity itself, and reports its efforts.
        q: (n,) at which the arm is at rest.
        effort: (n,) that act there as the robot reports them; None: they are not known.
    """
    limits, joints = robot.limits.effort, ", ".join(robot.joints)
    g = robot.dynamic_state(q, np.zeros(robot.n)).g
    if (np.abs(g) > limits).any():
        raise ModelError(
            f"the weight of the arm needs {_listed(g)} Nm at {joints}, whose effort limits are "
            f"{_listed(limits)} Nm: it would fall"
        )
    reported = believed(effort, parameters)
    if reported is None or not parameters.compensate_gravity:  # some report that of gravity, too
        return
    most = _MODEL_PART * np.linalg.norm(g)
    most += _LIMIT_PART * np.linalg.norm(limits[np.isfinite(limits)])
    if np.linalg.norm(reported - g) > most:
        raise ModelError(
            f"the robot reports efforts of {_listed(reported)} Nm at {joints}; expected "
            f"{_listed(g)} Nm, which hold its weight by the URDF: does the tool touch something? "
            "does the driver report other quantities (then set effort_feedback: false)?"
        )


def _listed(efforts: Array) -> str:
    return f"({', '.join(f'{effort:.3g}' for effort in efforts)})"


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
    B = robot.dynamic_state(zero, zero).B - np.diag(robot.model.armature)
    if not np.linalg.eigvalsh(B)[0] > _LEAST_INERTIA:
        raise RobotError(
            "the joint inertia is not positive definite: the URDF lacks <inertial> of some links "
            f"beyond {robot.joints[0]}; efforts cannot be computed without them"
        )
