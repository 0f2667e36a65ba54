"""Dynamic control: resolved acceleration on inverse dynamics, section IV, Fig. 2.

Notation: ``a`` (6,) [m/s^2, rad/s^2] resolved acceleration, ``ddq`` (n,) [rad/s^2],
``tau`` (n,) [Nm], ``dp_de`` (3,) [m] p_d - p_e, ``x_de`` the orientation displacement of
the representation; ``k_Pp, k_Po`` [1/s^2] and ``k_Vp, k_Vo`` [1/s] gains; base frame.
"""

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.laws.blend import Blend
from eulerparams_control.laws.hold import NO_CONTACT, JointHold, contact_force
from eulerparams_control.laws.inverse_dynamics import InverseDynamics, joint_acceleration
from eulerparams_control.laws.jit import f8, jit
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.orientation import Lyapunov, OrientationRepresentation
from eulerparams_control.laws.rotations import Array, chord, norm
from eulerparams_control.laws.scheme import (
    Bounds,
    JointCommand,
    LoopGain,
    Scheme,
    Tick,
    refuse_error,
)
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import approach
from eulerparams_control.robot.robot import DynamicState, Robot, RobotState

if TYPE_CHECKING:
    from eulerparams_control.parameters.efforts import EffortParameters, ResolvedParameters

# States that come slower than this [1/s] cannot hold the joints.
_HOLD_RATE = 20.0

# Square [Nm^2] of the external efforts below which the arm touches nothing.
_NO_EFFORT = 1.0

# Least damping k_V [1/s], for a finite k_P / k_V.
_LEAST_DAMPING = 1e-100


def resolved_acceleration(
    arm: RobotState,
    desired: DesiredFrame,
    orientation: OrientationRepresentation,
    x_before: Any,
    gains: tuple[float, float, float, float],
) -> tuple[Array, Any]:
    """Return a (6,) [m/s^2, rad/s^2] of (36), (38), (40), and x_de.

    The efforts B J^-1 (a - dJ dq) + C dq + d + g, eq. (33), give the tip this acceleration.

    Args:
        arm: p_e, R_e, dp_e and omega_e, eqs. (18)-(20).
        desired: the desired frame.
        orientation: (38) with Euler angles, (40) with Euler parameters, or another.
        x_before: x_de of the tick before, or None.
        gains: k_Pp [1/s^2], k_Vp [1/s], k_Po [1/s^2], k_Vo [1/s].
    """
    p_d, R_d, dp_d, omega_d, ddp_d, domega_d = desired
    k_Pp, k_Vp, k_Po, k_Vo = gains
    dp_de = p_d - arm.p_e  # (21)
    x_de = orientation.displacement(R_d, arm.R_e, x_before)  # (22), (27)
    a_p = ddp_d + k_Vp * (dp_d - arm.dp_e) + k_Pp * dp_de  # (36)
    a_o = orientation.acceleration(x_de, omega_d, domega_d, arm.omega_e, k_Po, k_Vo)  # (38), (40)
    return np.concatenate((a_p, a_o)), x_de


class EffortControl(Scheme):
    """Base of the schemes that command efforts: inverse dynamics, limits, and the hold."""

    hold_rate = _HOLD_RATE
    blend_time = 0.1  # [s] in which the command goes over to a law that replaces another
    parameters: "EffortParameters"
    orientation: OrientationRepresentation

    def __init__(self, robot: Robot, parameters: "EffortParameters") -> None:
        self.robot = robot
        self._blend = Blend(self.blend_time)
        self.dynamics = InverseDynamics(robot)
        self._take(parameters)
        self.reset(np.zeros(robot.n))

    def _take(self, parameters: Any) -> None:
        limits, orientation = parameters.limits(self.robot), parameters.representation()
        self.dynamics.change(parameters)
        self.parameters, self.orientation, self.limits = parameters, orientation, limits
        self._motion = parameters.motion_limits()

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
        if self.orientation != orientation:
            self._forget_x()  # it means nothing to another representation
        if not self._saturated:  # else its acceleration is not that of the arm: nothing to blend
            self._blend.replace(self.dynamics.ddq)

    def _forget_x(self) -> None:
        self._x_de: Any = None

    @property
    def bounds(self) -> Bounds:
        """The limits of the joints, and the rate of the efforts."""
        return Bounds(self.limits, self.dynamics.rate)

    def bound(self, joints: JointLimits) -> None:
        """Keep to limits of the joints from the next tick on."""
        self.limits = joints

    def start_from(self, effort: Array | None) -> None:
        """Begin at the efforts (n,) that the robot reports: see :class:`InverseDynamics`."""
        self.dynamics.start_from(effort)

    def skip(self) -> None:
        """Forget the speeds of the tick before, from which accelerations are estimated."""
        self.dynamics.dq = None

    def reset(self, q: Array) -> None:
        """Begin at the measured q (n,)."""
        self.dynamics.reset()
        self._contact = NO_CONTACT
        self.resume(q)

    def resume(self, q: Array) -> None:
        """Begin at the measured q (n,), with the efforts and the contact as they are."""
        self.dynamics.resume()
        self._hold: JointHold | None = None
        self._saturated = False
        self._leave_the_law(q.copy())

    def _leave_the_law(self, q: Array) -> None:
        self._q = q
        self._forget_x()
        self._blend.reset()

    def hold(self, dt: float, q: Array, dq: Array, w: Array | None = None) -> JointCommand:
        """Return efforts that stop the joints, and hold them there: see :class:`JointHold`.

        It needs no orientation.  Friction, which helps to stop, is not compensated.  The contact
        w (6,) is measured, base frame, about the tip; None: it is estimated.
        """
        state, dynamics = self.robot.dynamic_state(q, dq), self.dynamics
        self._leave_the_law(state.arm.q)
        added = dynamics.added(state)
        last = dynamics.acting(state.C_dq + state.g - added)
        e_now, e = dynamics.observe(dt, state), dynamics.external
        limits, rate, length = self.limits or self.robot.limits, dynamics.rate, self.robot.length
        if self._hold is None:
            drove_in = self._contact.drove_in
            self._hold = JointHold(limits, rate, length, state, e, w, drove_in)
        self._hold.limits, self._hold.rate = limits, rate
        tau = self._hold.effort(dt, state, e_now, e, w) - added
        tau = dynamics.ramped(dt, tau, last)[0]
        zero = np.zeros_like(tau)
        if not math.isfinite(tau @ tau):  # the measured state gives no finite efforts
            tau, self._hold, dynamics.external = last, None, zero
        dynamics.keep(tau, zero, state.arm.dq, is_obeyed=False)
        dynamics.drift = zero
        return JointCommand(effort=tau)

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the gravitational efforts at q (n,): nothing in them gets stale."""
        state = self.robot.dynamic_state(q, np.zeros_like(q))  # C dq = 0
        tau = state.g - self.dynamics.added(state)
        return JointCommand(effort=self.robot.limits.limit_effort(tau)[0])

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
        arm, dynamics = state.arm, self.dynamics
        self._q, self._hold = arm.q, None
        ddq, x_de, effects = self._accelerate(dt, state, desired)
        if self.limits is not None:
            refuse_error(desired, arm, self.parameters)
        if not math.isfinite(ddq @ ddq):
            raise SingularityError("the law asks for an infinite joint acceleration")
        ddq = self._blend(dt, ddq)
        excess = self._excess(arm.dq, ddq, effects)
        self._saturated = dynamics.command(dt, state, ddq, h, self._effort_limits())
        self._x_de = x_de
        command = JointCommand(effort=dynamics.tau)
        return Tick(command, desired, arm, x_de, self._saturated, excess, None, effects)

    def note_contact(
        self,
        dt: float,
        arm: RobotState,
        desired: DesiredFrame,
        force: Array | None,
        presses: bool,
    ) -> None:
        """Sum up the work on a contact: of the motion, and of the environment on the arm.

        The force (3,) [N] on the tip is measured; None: it is estimated.  ``presses`` is whether
        the arm is commanded to exert one.
        """
        e, is_measured = self.dynamics.external, force is not None
        if force is None:
            if not e @ e >= _NO_EFFORT:
                self._contact = NO_CONTACT
                return
            force = contact_force(arm.J, e, self.robot.length)
        self._contact = self._contact.after(dt, force, is_measured, desired.dp_d, arm.dp_e, presses)


class DynamicControl(EffortControl):
    """Resolved acceleration on inverse dynamics, as in Fig. 2."""

    parameters: "ResolvedParameters"

    def _take(self, parameters: Any) -> None:
        super()._take(parameters)
        self.loop_rate = self.fastest_gain.rate

    @property
    def fastest_gain(self) -> LoopGain:
        """The gain of the fastest pole: ddx + k_V dx + k_P x = 0, errors being small."""
        p = self.parameters
        return max(
            LoopGain("k_Vp", p.k_Vp, p.k_Vp / 2),
            LoopGain("k_Pp", p.k_Pp, math.sqrt(p.k_Pp), order=2),
            LoopGain("k_Vo", p.k_Vo, p.k_Vo / 2),
            LoopGain("k_Po", p.k_Po, math.sqrt(p.k_Po * self.orientation.slope), order=2),
            key=lambda gain: gain.rate,
        )

    def _accelerate(
        self, dt: float, state: DynamicState, desired: DesiredFrame
    ) -> tuple[Array, Any, Any]:
        gains = self._gains(state, desired)
        a, x_de = resolved_acceleration(state.arm, desired, self.orientation, self._x_de, gains)
        if not math.isfinite(a @ a):
            raise SingularityError("the law asks for an infinite acceleration of the tip")
        ddq_0 = self.dynamics.null_acceleration(state.arm.q, state.arm.dq)
        return joint_acceleration(state, a, self.dynamics.inverse, ddq_0), x_de, None

    def _gains(
        self, state: DynamicState, desired: DesiredFrame
    ) -> tuple[float, float, float, float]:
        """Return the gains of the law, smaller k_P where errors are large: see :func:`braked`."""
        p, motion, slope = self.parameters, self._motion, self.orientation.slope
        if motion is None:
            return p.k_Pp, p.k_Vp, p.k_Po, p.k_Vo
        arm, drift = state.arm, state.arm.J @ self.dynamics.drift
        distance, angle = norm(desired.p_d - arm.p_e), chord(desired.R_d, arm.R_e)
        v, a = motion.linear_speed, motion.linear_acceleration
        omega, alpha = motion.angular_speed, motion.angular_acceleration
        k_Pp = braked(p.k_Pp, p.k_Vp, distance, v, a, norm(drift[:3]))
        k_Po = braked(slope * p.k_Po, p.k_Vo, angle, omega, alpha, norm(drift[3:])) / slope
        return k_Pp, p.k_Vp, k_Po, p.k_Vo

    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return V_2 and its derivative, eqs. (42), (43)."""
        omega_de = tick.desired.omega_d - tick.state.omega_e
        p = self.parameters
        return self.orientation.lyapunov_2(tick.x_de, omega_de, p.k_Po, p.k_Vo)


@jit(f8(f8, f8, f8, f8, f8, f8))
def braked(k_P: float, k_V: float, e: float, speed: float, a: float, resisted: float) -> float:
    """Return k_P [1/s^2], smaller where the error e is so large that the tip would overshoot.

    An error e [m or rad] asks for the speed k_P e / k_V: no more than that from which the tip stops
    where e is 0, within its speed and its acceleration a.  Otherwise bounded accelerations would
    make it swing.  ``resisted`` is the acceleration with which a disturbance holds the tip back:
    k_P e may balance it.
    """
    v = approach(e, k_P / max(k_V, _LEAST_DAMPING), speed, a)
    if math.isinf(v) or k_P * e <= k_V * v + resisted:
        return k_P
    return (k_V * v + resisted) / e


class NoMotionLoop:
    """Commands nothing: the compliant frame goes to a controller of positions (admittance)."""

    fastest_gain, hold_rate, loop_rate = None, 0.0, 0.0  # the loops are those of the robot

    def __init__(self, robot: Robot, parameters: "ResolvedParameters") -> None:
        self.robot = robot
        self.change(parameters)

    def change(self, parameters: "ResolvedParameters") -> None:
        """Go over to other limits."""
        self.parameters, self.bounds = parameters, Bounds(parameters.limits(self.robot))

    def follow(
        self, dt: float, state: DynamicState, desired: DesiredFrame, h: Array | None = None
    ) -> Tick:
        """Return no efforts; raises FollowingError if the arm does not follow."""
        if self.bounds.joints is not None:
            refuse_error(desired, state.arm, self.parameters)
        return Tick(JointCommand(), desired, state.arm, None)

    def hold(self, *_: Any) -> JointCommand:
        """Return no command."""
        return JointCommand()

    last_command = hold

    def bound(self, *_: Any) -> None:
        """Do nothing: no joints are commanded."""

    reset = resume = start_from = skip = note_contact = bound
