"""Kinematic control: closed-loop inverse kinematics (CLIK), section III, Fig. 1.

Notation: ``dp_de`` (3,) [m] p_d - p_e, ``x_de`` the orientation displacement of the
representation, ``k_Pp, k_Po`` [1/s] gains; all in the base frame.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from eulerparams_control.errors import FollowingError, SingularityError
from eulerparams_control.laws.blend import Blend
from eulerparams_control.laws.inverse import DampedInverse
from eulerparams_control.laws.limits import SHORTEST, JointLimits
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
from eulerparams_control.robot.robot import Robot, RobotState

if TYPE_CHECKING:
    from eulerparams_control.parameters.clik import ClikParameters

FEEDBACKS = ("internal", "measured")

# Time constant [s] in which the command goes over to a law that replaces another.
_BLEND_TIME = 0.1


def clik(
    arm: RobotState,
    desired: DesiredFrame,
    orientation: OrientationRepresentation,
    x_before: Any,
    k_Pp: float,
    k_Po: float,
    inverse: DampedInverse,
    dq_0: Array,
) -> tuple[Array, Any]:
    """Return the joint velocity dq (n,) [rad/s] of (23), (28), and x_de; raises SingularityError.

    Args:
        arm: p_e, R_e and J (6, n), eqs. (18)-(20).
        desired: p_d, R_d, dp_d, omega_d.
        orientation: (23) with Euler angles, (28) with Euler parameters, or another.
        x_before: x_de of the tick before, or None.
        k_Pp, k_Po: [1/s].
        inverse: J* of J.
        dq_0: (n,) [rad/s] which the null space of J follows.
    """
    dp_de = desired.p_d - arm.p_e  # (21)
    x_de = orientation.displacement(desired.R_d, arm.R_e, x_before)  # (22), (27)
    v_p = desired.dp_d + k_Pp * dp_de  # upper half of the bracket of (23), (28)
    v_o = orientation.velocity(x_de, desired.omega_d, k_Po)  # the lower one
    v = np.concatenate((v_p, v_o))
    dq: Array = dq_0 + inverse(arm.J) @ (v - arm.J @ dq_0)  # (23), (28)
    return dq, x_de


def held_gain(k: float, dt: float) -> float:
    """Return the gain that acts where a command is held for dt [s]: (1 - exp(-k dt)) / dt.

    The error of (25), de = -k e, then decays by exp(-k dt) as in continuous time, where k itself
    would multiply it by 1 - k dt, a limit cycle from k dt = 2 on (exact discretization, Franklin,
    Powell and Workman, Digital Control of Dynamic Systems, sec. 4.3).
    """
    return -math.expm1(-k * dt) / dt if dt > 0.0 else k


def held_frame(desired: DesiredFrame, dt: float) -> DesiredFrame:
    """Return the frame with its mean velocities over the dt [s] for which a command is held."""
    return desired._replace(
        dp_d=desired.dp_d + (dt / 2.0) * desired.ddp_d,
        omega_d=desired.omega_d + (dt / 2.0) * desired.domega_d,
    )


class Clik(Scheme):
    """CLIK as in Fig. 1: integrates dq from the first measured q.

    At each tick q is the integral of the velocities commanded before, and dq the answer
    of the law to it, so q and dq belong to the same instant as the desired frame.  With
    ``feedback: measured`` the loop is closed on the measured q instead.

    Where there are limits of the joints, those of the tip bound how fast an error is undone, and
    too large an error or deviation of the joints stops the motion.
    """

    def __init__(self, robot: Robot, parameters: "ClikParameters") -> None:
        self.robot = robot
        self._blend = Blend(_BLEND_TIME)
        self._take(parameters)
        self.reset(np.zeros(robot.n))

    def _take(self, parameters: "ClikParameters") -> None:
        """Go over to other parameters; if they are refused, the ones before stay in force."""
        robot, orientation = self.robot, parameters.representation()
        posture, limits = parameters.posture_of(robot), parameters.limits(robot)
        inverse, motion = parameters.inverse(robot), parameters.motion_limits()
        self.parameters, self.orientation, self._inverse = parameters, orientation, inverse
        self._posture, self.limits, self._motion = posture, limits, motion
        self.loop_rate = self.fastest_gain.rate

    def change(self, parameters: "ClikParameters") -> None:
        """Go over to other parameters, without a jump of the command."""
        orientation, law = self.orientation, self._law
        self._take(parameters)
        if self.orientation != orientation:
            self._x_de = None  # it means nothing to another representation
        if self._law != law:
            self._blend.replace(self._dq)

    @property
    def _law(self) -> tuple[Any, ...]:
        """All that the joint velocity depends on; a change of it is blended."""
        p = self.parameters
        return self.orientation, self._inverse, p.k_Pp, p.k_Po, p.posture, p.k_posture

    @property
    def bounds(self) -> Bounds:
        """The limits of the joints."""
        return Bounds(self.limits)

    def bound(self, joints: JointLimits) -> None:
        """Keep to limits of the joints from the next tick on."""
        self.limits = joints

    @property
    def fastest_gain(self) -> LoopGain:
        """That of the faster error equation, dx_de + k x_de = 0, errors being small."""
        k_Pp, k_Po = self.parameters.k_Pp, self.parameters.k_Po
        gains = LoopGain("k_Pp", k_Pp, k_Pp), LoopGain("k_Po", k_Po, k_Po * self.orientation.slope)
        return max(gains, key=lambda gain: gain.rate)

    def reset(self, q: Array) -> None:
        """Begin at the measured q (n,) with zero velocity."""
        self._q, self._dq, self._x_de = q.copy(), np.zeros_like(q), None
        self._home = self._q
        self._blend.reset()

    def resume(self, q: Array) -> None:
        """Restart at the measured q (n,), by the turns of the joints that were commanded."""
        self.reset(self._q + self.robot.limits.difference(q, self._q))

    def hold(self, dt: float, q: Array, dq: Array) -> JointCommand:
        """Return the command that holds still: it brakes as fast as the limits allow."""
        q_c, dq_c = self._q, np.zeros_like(self._dq)
        if self.limits is not None:
            q_c = self.limits.integrated(q_c, self._dq, dt)
            dq_c, _ = self.limits.limit_velocity(q_c, dq_c, dt or SHORTEST, self._dq)
        self._q, self._dq, self._x_de = q_c, dq_c, None
        self._blend.reset()
        return JointCommand(q_c, dq_c)

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the integrated q, no velocity."""
        return JointCommand(self._q, np.zeros_like(self._q))

    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame) -> Tick:
        """Integrate over dt [s] and return q, dq for this instant.

        Raises SingularityError if the law has no finite answer, or FollowingError; nothing is
        integrated then.
        """
        self.robot.refuse_size(q, dq)
        is_internal, limits = self.parameters.feedback == "internal", self.limits
        q_c = self._integrated(dt, q)
        arm = self.robot.state(q_c, self._dq) if is_internal else self.robot.state(q, dq)
        dq_c, x_de = self._velocity(dt, arm, desired)
        saturated, excess = False, 1.0
        if not math.isfinite(dq_c @ dq_c):
            raise SingularityError("the law asks for an infinite joint velocity")
        if limits is not None:
            refuse_error(desired, arm, self.parameters)
        dq_c = self._blend(dt, dq_c)
        if limits is not None:
            if not is_internal:
                dq_c = self._slowed(dt, q_c, dq_c, desired)
            excess = limits.excess(dq_c)
            dq_c, saturated = limits.limit_velocity(q_c, dq_c, dt or SHORTEST, self._dq)
        self._q, self._dq, self._x_de = q_c, dq_c, x_de
        return Tick(JointCommand(q_c, dq_c), desired, arm, x_de, saturated, excess)

    def _integrated(self, dt: float, q: Array) -> Array:
        """Return the commanded q dt [s] later; refuse it if it is not near the measured q."""
        if self.limits is None:
            q_c = self._q + dt * self._dq
        else:
            q_c = self.limits.integrated(self._q, self._dq, dt)
        if not math.isfinite(q_c @ q_c):
            raise SingularityError("the joint velocities lead to infinite joint positions")
        if self.limits is not None:
            deviation = np.abs(self.limits.difference(q_c, q))
            i, bound = int(deviation.argmax()), self.parameters.max_deviation
            if not deviation[i] <= bound:
                raise FollowingError(
                    f"the joint {self.robot.joints[i]} is {deviation[i]:.3f} from its command; at "
                    f"most {bound} is allowed: is the arm braked or blocked, or its servo off? "
                    "then send the reference again, else raise max_deviation"
                )
        return q_c

    def _velocity(self, dt: float, arm: RobotState, desired: DesiredFrame) -> tuple[Array, Any]:
        k_Pp, k_Po = self._gains(dt, arm, desired)
        mean, dq_0 = held_frame(desired, dt), np.zeros(self.robot.n)
        if (way := self.way_to_posture(arm.q)) is not None:
            dq_0 = held_gain(self.parameters.k_posture, dt) * way
        return clik(arm, mean, self.orientation, self._x_de, k_Pp, k_Po, self._inverse, dq_0)

    def _gains(self, dt: float, arm: RobotState, desired: DesiredFrame) -> tuple[float, float]:
        """Return k_Pp, k_Po [1/s], smaller where the tip could not brake from the speed k e."""
        orientation, motion = self.orientation, self._motion
        k_Pp = held_gain(self.parameters.k_Pp, dt)
        k_Po = held_gain(self.parameters.k_Po, orientation.slope * dt)
        if motion is None:
            return k_Pp, k_Po
        distance, angle = norm(desired.p_d - arm.p_e), chord(desired.R_d, arm.R_e)
        v, w = motion.approach((distance, angle), (k_Pp, orientation.slope * k_Po))
        if k_Pp * distance > v:
            k_Pp = v / distance
        # |omega| is at most twice k_Po slope angle, but for Euler angles near their pole and for
        # Rodrigues parameters near a half turn: where even that is within w it is not computed.
        if 2.0 * k_Po * orientation.slope * angle > w:
            x_de = orientation.displacement(desired.R_d, arm.R_e, self._x_de)
            k_Po *= w / max(norm(orientation.velocity(x_de, np.zeros(3), k_Po)), w)
        return k_Pp, k_Po

    def _slowed(self, dt: float, q: Array, dq: Array, desired: DesiredFrame) -> Array:
        """Return dq with which the tip, half a step later, is not beyond its speeds."""
        if self._motion is None:
            return dq
        tip = self.robot.state(q + dt / 2.0 * dq, dq)
        v = max(self._motion.linear_speed, norm(desired.dp_d))
        w = max(self._motion.angular_speed, norm(desired.omega_d))
        return dq / max(1.0, norm(tip.dp_e) / v, norm(tip.omega_e) / w)

    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return V_1 and its derivative, eqs. (30), (31)."""
        return self.orientation.lyapunov_1(tick.x_de, self.parameters.k_Po)
