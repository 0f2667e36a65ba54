"""Dynamic control: resolved acceleration on inverse dynamics, section IV, Fig. 2.

Notation: ``a`` (6,) [m/s^2, rad/s^2] resolved acceleration, ``ddq`` (n,) [rad/s^2],
``tau`` (n,) [Nm], ``dp_de`` (3,) [m] p_d - p_e, ``x_de`` the orientation displacement of
the representation; ``k_Pp, k_Po`` [1/s^2] and ``k_Vp, k_Vo`` [1/s] gains; base frame.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError, SingularityError
from eulerparams_control.laws.blend import Blend
from eulerparams_control.laws.compiled import (
    NONE,
    Array,
    Input,
    Inputs,
    Row,
    kernel,
    layout,
    slot,
    to_rows,
)
from eulerparams_control.laws.inverse_dynamics import (
    CUT,
    INFINITE,
    RAMPED,
    InverseDynamics,
    check_model,
    command_effort,
    fitted,
)
from eulerparams_control.laws.limits import SHORTEST, JointLimits, rows_of
from eulerparams_control.laws.linear import mat, norm, put_vec, read_vec, vec
from eulerparams_control.laws.orientation import Lyapunov, OrientationRepresentation
from eulerparams_control.laws.orientation.base import Coordinates, law_of
from eulerparams_control.laws.rotations import chord
from eulerparams_control.laws.scheme import (
    Bounds,
    ErrorBounds,
    JointCommand,
    LoopGain,
    Scheme,
    Tick,
    check_gains,
)
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import (
    NO_LIMITS,
    MotionLimits,
    approach,
    read_limits,
)
from eulerparams_control.robot.robot import DynamicState, MotionState, Robot, RobotState

# Stiffness [1/s^2] and damping [1/s] by which the joints are held where they are.
_HOLD_K, _HOLD_D = 400.0, 40.0

# Joints that brake slower than this [rad/s or m/s] are all but at rest.
_SLOW = 0.05

_NO_DRIFT = np.zeros(6)

# A gain [1/s] that is none.
_TINY = 1e-100


displacement = acceleration = read = put = slot  # of a representation


class _Numbers(NamedTuple):
    """A law in numbers; the slope is that of the representation."""

    options: Coordinates
    slope: float
    k_Pp: float
    k_Vp: float
    k_Po: float
    k_Vo: float


_numbers = layout(_Numbers).read


@kernel
def _braked(k_P: float, k_V: float, e: float, speed: float, a: float, resisted: float) -> float:
    """Return k_P, smaller where the error e is so large that the tip would overshoot.

    An error e asks for the speed k_P e / k_V: no more than that from which the tip stops where
    e is 0.  Bounded accelerations would swing else.
    """
    v = approach(e, k_P / max(k_V, _TINY), speed, a)
    if math.isinf(v) or k_P * e <= k_V * v + resisted:
        return k_P
    return (k_V * v + resisted) / e


def _acceleration(
    p_e: Input, R_e: Inputs, dp_e: Input, omega_e: Input,
    p_d: Input, R_d: Inputs, dp_d: Input, omega_d: Input, ddp_d: Input, domega_d: Input,
    previous: Input, numbers: Input, motion: Input, drift: Input,
    a: Row, dp_de: Row, x_de: Row,
) -> bool:  # fmt: skip
    """Fill a (6,), dp_de (3,), x_de: see ResolvedAcceleration; return whether they are finite."""
    law, most = _numbers(numbers, 0), read_limits(motion, 0)
    R, away = mat(R_d), vec(p_d) - vec(p_e)  # eq. (21)
    x = displacement(R, mat(R_e), read(previous, 0), law.options)  # eqs. (22), (27)
    put_vec(dp_de, 0, away)
    put(x_de, 0, x)
    v, linear = most.linear_speed, most.linear_acceleration
    k_Pp = _braked(law.k_Pp, law.k_Vp, norm(away), v, linear, norm(read_vec(drift, 0)))
    w, angular, k_Po = most.angular_speed, most.angular_acceleration, law.slope * law.k_Po
    k_Po = _braked(k_Po, law.k_Vo, chord(R, mat(R_e)), w, angular, norm(read_vec(drift, 3)))
    a_p = vec(ddp_d) + law.k_Vp * (vec(dp_d) - vec(dp_e)) + k_Pp * away  # (36)
    a_o = acceleration(  # eqs. (38), (40)
        x, vec(omega_d), vec(domega_d), vec(omega_e), k_Po / law.slope, law.k_Vo, law.options
    )
    put_vec(a, 0, a_p)
    put_vec(a, 3, a_o)
    return not math.isnan(a_o.x)


@dataclass(frozen=True)
class ResolvedAcceleration:
    """The laws (36), (38), (40): the acceleration of the tip that the loop asks for.

    Attributes:
        orientation: the representation of the orientation displacement.
        k_Pp, k_Vp: position gains [1/s^2], [1/s].
        k_Po, k_Vo: orientation gains [1/s^2], [1/s]; see the errata on fair gains.
    """

    orientation: OrientationRepresentation
    k_Pp: float = 400.0
    k_Vp: float = 40.0
    k_Po: float = 800.0
    k_Vo: float = 40.0

    def __post_init__(self) -> None:
        check_gains(self, "k_Pp", "k_Vp", "k_Po", "k_Vo")
        law_of(_acceleration, type(self.orientation))  # not while an arm moves

    def acceleration(
        self,
        arm: RobotState,
        desired: DesiredFrame,
        previous: Any,
        motion: MotionLimits | None = None,
        drift: Array = _NO_DRIFT,
    ) -> tuple[Any, ...]:
        """Return a (6,), dp_de (3,) [m] and x_de.

        a_p = ddp_d + k_Vp (dp_d - dp_e) + k_Pp (p_d - p_e), eq. (36), and a_o of the
        representation: domega_d + k_Vo Delta omega_de + k_Po eps_de for Euler parameters,
        eq. (40).

        Args:
            arm: kinematics of the arm.
            desired: the desired frame.
            previous: x_de of the tick before, or None.
            motion: limits of the tip; errors are corrected by no more than what it can brake.
            drift: (6,) by which the tip accelerates more than asked for: that is resisted, too.

        Raises:
            SingularityError: if the representation has no finite answer.
        """
        orientation = self.orientation
        a, dp_de, x_de = np.empty(6), np.empty(3), np.empty(orientation.rows.width)
        is_finite = law_of(_acceleration, type(orientation))(
            *arm[2:6],
            *desired,
            orientation.row(previous),
            self.numbers,
            NO_LIMITS.row if motion is None else motion.row,
            drift,
            a,
            dp_de,
            x_de,
        )
        if not is_finite:
            raise SingularityError(orientation.singularity)
        return a, dp_de, orientation.rows.unpack(x_de)

    @cached_property
    def numbers(self) -> Array:
        """What the law is made of, as a row."""
        options = self.orientation.options.values
        gains = self.k_Pp, self.k_Vp, self.k_Po, self.k_Vo
        return to_rows(_Numbers, _Numbers(options, self.orientation.slope, *gains))

    @cached_property
    def fastest_gain(self) -> LoopGain:
        """The gain of the fastest pole: ddx + k_V dx + k_P x = 0, errors being small."""
        k_Po = self.k_Po * self.orientation.slope
        return max(
            LoopGain("k_Vp", self.k_Vp, self.k_Vp / 2),
            LoopGain("k_Pp", self.k_Pp, math.sqrt(self.k_Pp), order=2),
            LoopGain("k_Vo", self.k_Vo, self.k_Vo / 2),
            LoopGain("k_Po", self.k_Po, math.sqrt(k_Po), order=2),
            key=lambda gain: gain.rate,
        )

    def lyapunov(self, x_de: Any, omega_de: Array) -> Lyapunov | None:
        """Return V_2 and its derivative, eqs. (42), (43)."""
        return self.orientation.lyapunov_2(x_de, omega_de, self.k_Po, self.k_Vo)


@dataclass(frozen=True)
class EffortLimits:
    """Bounds on the efforts, and the errors at which the motion is stopped.

    Attributes:
        joints: limits of the joints; None disables the others too.
        rate: [Nm/s] of each effort, or (n,).
        error_position: [m] between the desired and the actual frame.
        error_rotation: [rad] between them.
        motion: limits of the tip, within which errors are corrected; None: at any speed.

    Raises:
        ConfigurationError: if one is not positive.
    """

    joints: JointLimits | None = None
    rate: Array | float = math.inf
    error_position: float = math.inf
    error_rotation: float = math.inf
    motion: MotionLimits | None = None

    def __post_init__(self) -> None:
        if not np.all(np.asarray(self.rate) > 0):
            raise ConfigurationError(f"rate is {self.rate}; expected > 0")
        object.__setattr__(self, "_errors", ErrorBounds(self.error_position, self.error_rotation))

    def rates(self, n: int) -> Array:
        """Return the rates (n,) [Nm/s] of the efforts."""
        return self.rate if isinstance(self.rate, np.ndarray) else np.full(n, self.rate)

    def refuse_error(self, desired: DesiredFrame, arm: RobotState) -> None:
        """Raise FollowingError if the tip is too far from the desired frame."""
        if self.joints is not None:
            self._errors.refuse(desired, arm)

    _errors: ErrorBounds = field(default=ErrorBounds(), init=False)


class DynamicControl(Scheme):
    """Resolved acceleration on inverse dynamics, as in Fig. 2.

    Args:
        robot: the arm.
        law: resolves the acceleration of the tip.
        dynamics: makes efforts of it.
        limits: that bound the command; the first effort is within its rate of the one at which
            the robot begins, see :meth:`start_from`.
        blend_time: [s] in which the command goes over to a law that replaces another.

    Raises:
        ConfigurationError: if the posture or the friction has the wrong size.
        RobotError: if the model of the robot cannot give its efforts.
    """

    def __init__(
        self,
        robot: Robot,
        law: ResolvedAcceleration,
        dynamics: InverseDynamics,
        limits: EffortLimits,
        blend_time: float = 0.1,
    ) -> None:
        self.robot = robot
        self.limits = limits
        self._blend = Blend(blend_time)
        self._x_de: Any = None
        self._start: Array | None = None
        self.law, self.dynamics = law, fitted(dynamics, robot)
        check_model(robot)
        self.reset(np.zeros(robot.n))

    def replace_law(
        self, law: ResolvedAcceleration, dynamics: InverseDynamics, limits: EffortLimits
    ) -> None:
        """Go over to another law, without a jump of the command.

        Raises:
            ConfigurationError: if the posture or the friction has the wrong size.
        """
        dynamics = fitted(dynamics, self.robot)
        if law.orientation != self.law.orientation:
            self._x_de = None  # means nothing to another representation
        self.law, self.dynamics, self.limits = law, dynamics, limits
        if not self._saturated:  # of a law that failed nothing is to go on
            self._blend.replace(self._ddq)

    @property
    def fastest_gain(self) -> LoopGain:
        """That of the law."""
        return self.law.fastest_gain

    @property
    def hold_rate(self) -> float:
        """The rate [1/s] of the loop by which the joints are held."""
        return max(math.sqrt(_HOLD_K), _HOLD_D / 2)

    @property
    def bounds(self) -> Bounds:
        """The limits of the joints, and the rate of the efforts."""
        return Bounds(self.limits.joints, self.limits.rate)

    def bound(self, joints: JointLimits) -> None:
        """Keep to limits of the joints from the next tick on."""
        self.limits = replace(self.limits, joints=joints)

    def start_from(self, effort: Array | None) -> None:
        """Begin at the efforts (n,) that the robot reports, if it does; else at its weight.

        A robot that compensates its weight itself begins at none.
        """
        if effort is None or not (self.dynamics.gravity and effort.any()):
            self._start = None
        else:
            self._start = self.robot.limits.limit_effort(effort)[0]

    def reset(self, q: Array) -> None:
        """Begin at the measured q (n,)."""
        self._q = q.copy()
        self._ddq = np.zeros_like(q)
        self._drift = np.zeros(len(q))
        self._dq: Array | None = None
        self._saturated = False
        self._tau: Array | None = None
        self._x_de = None
        self._braked: tuple[Array, Array] | None = None  # q, dq (n,) of joints that are to stop
        self._blend.reset()

    def skip(self) -> None:
        """Forget the speeds of the tick before, which tell how the joints drift."""
        self._dq = None

    def resume(self, q: Array) -> None:
        """Begin at the measured q (n,), with the efforts as they are."""
        tau = self._tau
        self.reset(q)
        self._tau = tau

    def hold(self, dt: float, q: Array, dq: Array) -> JointCommand:
        """Return efforts that stop the joints within their accelerations, and hold them there.

        tau = B (ddq_b + d (dq_b - dq) + k (q_b - q)) + C dq + g, b for braked: it needs neither J
        nor the orientation.  Friction, which helps to stop, is not compensated.
        """
        state = self.robot.motion_state(q, dq)
        since, (q_b, dq_b) = dt, self._braked or (q, dq)
        speed = dq_b @ dq_b
        if self._braked is None or (speed > _SLOW**2 and dq @ dq_b < speed / 2):
            since, q_b, dq_b = 0.0, q, dq  # it begins; or the arm is slower: others brake it
        q_b, dq_b, ddq_b = self._brake(since, q_b, dq_b)
        self._braked = q_b, dq_b
        self._q, self._x_de = q, None
        self._blend.reset()
        ddq = ddq_b + _HOLD_D * (dq_b - dq) + _HOLD_K * self.robot.limits.difference(q_b, q)
        dynamics = replace(self.dynamics, friction=None)
        try:
            return JointCommand(effort=self._command(state, ddq, dt, dynamics)[0])
        except SingularityError:  # the measured state gives no finite frame
            return JointCommand(effort=np.zeros_like(q) if self._tau is None else self._tau)

    def _brake(self, dt: float, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """Return q, dq, ddq (n,) after dt [s] of braking from q, dq within their accelerations."""
        joints = self.limits.joints
        lasts = 0.0 if joints is None else joints.stop_time(dq)
        if lasts == 0:
            return q, np.zeros_like(dq), np.zeros_like(dq)
        lasts = max(lasts, 2 / _HOLD_D, dt)  # slow joints stop softly
        left = 1 - dt / lasts
        return q + (1 + left) / 2 * dt * dq, left * dq, -dq / lasts

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the gravitational efforts at q (n,): nothing in them gets stale."""
        g = self.robot.dynamic_state(q, np.zeros_like(q)).g
        tau = g if self.dynamics.gravity else np.zeros_like(g)
        return JointCommand(effort=self.robot.limits.limit_effort(tau)[0])

    def start_frame(self) -> DesiredFrame:
        """Return the pose of the tip at the measured q."""
        return self.frame_at(self._q)

    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame) -> Tick:
        """Return the efforts for this instant.

        Raises:
            SingularityError: if the law has no finite answer.
            FollowingError: if the tip is too far from the desired frame.
        """
        return self.tick_at(dt, self.robot.motion_state(q, dq), desired)

    def tick_at(
        self,
        dt: float,
        state: MotionState | DynamicState,
        desired: DesiredFrame,
        h: Array = NONE,
    ) -> Tick:
        """Return the efforts for this instant, also against a contact, eq. (48).

        Args:
            dt: [s] after the tick before.
            state: of the arm.
            desired: the desired frame.
            h: (6,) [N, Nm] what the end effector exerts on the environment; (0,) is nothing.

        Raises:
            SingularityError: if the law has no finite answer.
            FollowingError: if the tip is too far from the desired frame.
        """
        self._q, self._braked = state.arm.q, None
        drift = state.arm.J @ self._drift
        a, dp_de, x_de = self.law.acceleration(
            state.arm, desired, self._x_de, self.limits.motion, drift
        )
        self.limits.refuse_error(desired, state.arm)
        if not math.isfinite(a @ a):
            raise SingularityError("the law asks for an infinite acceleration of the tip")
        ddq = self.dynamics.acceleration(state, a)
        ddq = self._blend.blended(dt, ddq)
        if not math.isfinite(ddq @ ddq):
            raise SingularityError("the law asks for an infinite joint acceleration")
        tau, self._saturated = self._command(state, ddq, dt, self.dynamics, h)
        self._x_de = x_de
        joints = self.limits.joints
        excess = 1.0 if joints is None else joints.excess_of_acceleration(state.arm.dq, ddq)
        command = JointCommand(effort=tau)
        return Tick(command, state.arm, desired, dp_de, x_de, self._saturated, excess=excess)

    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return V_2 and its derivative, eqs. (42), (43)."""
        return self.law.lyapunov(tick.x_de, tick.desired.omega_d - tick.state.omega_e)

    def _command(
        self,
        state: MotionState | DynamicState,
        ddq: Array,
        dt: float,
        dynamics: InverseDynamics,
        h: Array = NONE,
    ) -> tuple[Array, bool]:
        """Return the efforts for ddq (n,) within the limits, and whether one changed them.

        Raises:
            SingularityError: if they are not finite; nothing is kept then.
        """
        arm, limits, n = state.arm, self.limits, len(ddq)
        before = self._start if self._tau is None else self._tau
        wanted, tau = np.empty(n), np.empty(n)
        found = command_effort(
            self.robot.chain,
            arm.q,
            arm.dq,
            arm.J,
            ddq,
            h,
            dynamics.friction_rows,
            dynamics.gravity,
            dynamics.coriolis,
            rows_of(limits.joints),
            dt,
            NONE if self._dq is None else self._dq,
            self._ddq,
            self._drift,
            limits.rates(n),
            dt if self._tau is not None else max(dt, SHORTEST),
            NONE if before is None else before,
            wanted,
            tau,
        )
        if found & INFINITE:
            raise SingularityError("the joints are measured at a state of infinite efforts")
        self._ddq, self._tau, self._start = wanted, tau, None
        self._dq = None if found & (CUT | RAMPED) else arm.dq
        return tau, found != 0
