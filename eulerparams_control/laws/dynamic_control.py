"""Dynamic control: resolved acceleration on inverse dynamics, section IV, Fig. 2.

Notation: ``a`` (6,) [m/s^2, rad/s^2] resolved acceleration, ``ddq`` (n,) [rad/s^2],
``tau`` (n,) [Nm], ``dp_de`` (3,) [m] p_d - p_e, ``x_de`` the orientation displacement of
the representation; ``k_Pp, k_Po`` [1/s^2] and ``k_Vp, k_Vo`` [1/s] gains; base frame.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.laws.hold import NO_CONTACT, Retreat
from eulerparams_control.laws.inverse_dynamics import EffortControl, joint_acceleration
from eulerparams_control.laws.jit import f8, jit
from eulerparams_control.laws.orientation import Lyapunov, OrientationRepresentation
from eulerparams_control.laws.rotations import Array, chord, norm
from eulerparams_control.laws.scheme import Bounds, JointCommand, LoopGain, Tick, refuse_error
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import approach
from eulerparams_control.robot.robot import DynamicState, Robot, RobotState

if TYPE_CHECKING:
    from eulerparams_control.parameters.efforts import ResolvedParameters

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
        ddq_0 = self.null_acceleration(state.arm.q, state.arm.dq)
        return joint_acceleration(state, a, self.inverse, ddq_0), x_de, None

    def _gains(
        self, state: DynamicState, desired: DesiredFrame
    ) -> tuple[float, float, float, float]:
        """Return the gains of the law, smaller k_P where errors are large: see :func:`braked`."""
        p, motion, slope = self.parameters, self._motion, self.orientation.slope
        if motion is None:
            return p.k_Pp, p.k_Vp, p.k_Po, p.k_Vo
        arm, drift = state.arm, state.arm.J @ self.drift
        distance, angle = norm(desired.p_d - arm.p_e), chord(desired.R_d, arm.R_e)
        (v, omega), (a, alpha) = motion.speeds, motion.accelerations
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

    fastest_gain = None  # the loops are those of the robot
    hold_rate = loop_rate = release_rate = 0.0

    def __init__(self, robot: Robot, parameters: "ResolvedParameters") -> None:
        self.robot = robot
        self._contact, self._retreat = NO_CONTACT, Retreat()
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

    def hold(self, dt: float, q: Array, dq: Array, w: Array | None = None) -> JointCommand:
        """Return no command; see :meth:`retreated`."""
        return JointCommand()

    def retreated(self, dt: float, held: DesiredFrame, dp_e: Array, w: Array) -> DesiredFrame:
        """Return the frame to hold after dt [s], away from what the arm drove into.

        Args:
            dt: [s].
            held: the frame until now.
            dp_e: (3,) [m/s] of the tip.
            w: (6,) contact.
        """
        v = self._retreat.velocity(dt, dp_e, w[:3]) if self._contact.drove_in else None
        if v is None:
            self._contact = NO_CONTACT
            return DesiredFrame(held.p_d, held.R_d)
        return DesiredFrame(held.p_d + dt * v, held.R_d, v)

    def last_command(self, *_: Any) -> JointCommand:
        """Return no command."""
        return JointCommand()

    def note_contact(
        self, dt: float, arm: RobotState, desired: DesiredFrame, force: Array | None, presses: bool
    ) -> None:
        """Sum up the work on a contact, see :meth:`EffortControl.note_contact`."""
        self._retreat = Retreat()
        if force is None:
            self._contact = NO_CONTACT
        else:
            self._contact = self._contact.after(dt, force, True, desired.dp_d, arm.dp_e, presses)

    def reset(self, *_: Any) -> None:
        """Forget the contact."""
        self._contact, self._retreat = NO_CONTACT, Retreat()

    def bound(self, *_: Any) -> None:
        """Do nothing: no joints are commanded."""

    resume = start_from = skip = bound
