"""Kinematic control: closed-loop inverse kinematics (CLIK), section III, Fig. 1.

Notation: ``dp_de`` (3,) [m] p_d - p_e, ``x_de`` the orientation displacement of the
representation, ``k_Pp, k_Po`` [1/s] gains; all in the base frame.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError, FollowingError, SingularityError
from eulerparams_control.laws.blend import Blend
from eulerparams_control.laws.compiled import (
    NONE,
    Array,
    Input,
    Inputs,
    Row,
    Rows,
    kernel,
    layout,
    slot,
    to_rows,
)
from eulerparams_control.laws.inverse import DampedInverse, invert, resolve
from eulerparams_control.laws.limits import (
    SHORTEST,
    JointLimits,
    agree,
    integrate,
    is_finite,
    rows_of,
    subtract,
)
from eulerparams_control.laws.linear import Vec, mat, norm, put_vec, vec
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
from eulerparams_control.robot.robot import Robot, RobotState

FEEDBACKS = ("internal", "measured")


displacement = velocity = read = put = slot  # of a representation


class _Numbers(NamedTuple):
    """A law in numbers: the slope is that of the representation, damping that of the inverse."""

    options: Coordinates
    slope: float
    k_Pp: float
    k_Po: float
    k_posture: float
    eps: float
    lambda_max: float
    length: float


read_numbers = layout(_Numbers).read


@kernel
def over(k: float, dt: float) -> float:
    """Return the gain k [1/s] that acts for dt [s]: (1 - exp(-k dt)) / dt.

    The error of (25), de = -k e, then decays by exp(-k dt) as in continuous time, where k itself
    would multiply it by 1 - k dt, a limit cycle from k dt = 2 on (exact discretization, Franklin,
    Powell and Workman, Digital Control of Dynamic Systems, sec. 4.3).
    """
    return -math.expm1(-k * dt) / dt if dt > 0.0 else k


def _velocity(
    q: Input, p_e: Input, R_e: Inputs, J: Inputs,
    p_d: Input, R_d: Inputs, dp_d: Input, omega_d: Input, ddp_d: Input, domega_d: Input,
    previous: Input, numbers: Input, motion: Input, dt: float, posture: Input, joints: Rows,
    dq: Row, dp_de: Row, x_de: Row,
) -> bool:  # fmt: skip
    """Fill dq (n,), dp_de (3,) and x_de: see ClikLaw; return whether they are finite.

    What acts for dt has the gains ``over`` dt, and the means of dp_d and omega_d at constant
    acceleration: what is held for dt then leads to where the desired frame will be.  An error e
    asks for the speed k e: no more than that from which the tip stops where e is 0.
    """
    law, most = read_numbers(numbers, 0), read_limits(motion, 0)
    R, away = mat(R_d), vec(p_d) - vec(p_e)  # eq. (21)
    x = displacement(R, mat(R_e), read(previous, 0), law.options)  # eqs. (22), (27)
    k_Pp, k_Po = over(law.k_Pp, dt), over(law.k_Po, law.slope * dt)
    distance, angle = norm(away), chord(R, mat(R_e))
    v = approach(distance, k_Pp, most.linear_speed, most.linear_acceleration)
    if k_Pp * distance > v:
        k_Pp = v / distance
    w = approach(angle, law.slope * k_Po, most.angular_speed, most.angular_acceleration)
    if 2.0 * k_Po * law.slope * angle > w:  # where x_de is large it is not slope times the angle
        k_Po *= w / max(norm(velocity(x, Vec(0.0, 0.0, 0.0), k_Po, law.options)), w)
    v_p = vec(dp_d) + (dt / 2.0) * vec(ddp_d) + k_Pp * away
    v_o = velocity(x, vec(omega_d) + (dt / 2.0) * vec(domega_d), k_Po, law.options)
    put_vec(dp_de, 0, away)
    put(x_de, 0, x)
    inverse = np.empty((len(q), 6))
    invert(J, law.eps, law.lambda_max, law.length, inverse)
    bracket, dq_0 = np.empty(6), np.zeros(len(q))
    put_vec(bracket, 0, v_p)
    put_vec(bracket, 3, v_o)
    if len(posture) > 0:
        subtract(joints, posture, q, dq_0)
        for i in range(len(q)):
            dq_0[i] *= over(law.k_posture, dt)
    resolve(inverse, J, bracket, dq_0, dq)  # eqs. (23), (28)
    return not math.isnan(v_o.x)


@dataclass(frozen=True)
class ClikLaw:
    """The law (23), (28): the joint velocity for a state and a desired frame.

    Attributes:
        orientation: the representation of the orientation displacement.
        k_Pp: position gain [1/s].
        k_Po: orientation gain [1/s]; see the errata on fair gains between representations.
        inverse: of the Jacobian.
        posture: (n,) [rad or m] to which a redundant arm tends, or None.
        k_posture: gain of that tendency [1/s].
        joints: the limits of the joints, modulo whose turns positions differ; None: no turns.
    """

    orientation: OrientationRepresentation
    k_Pp: float = 100.0
    k_Po: float = 100.0
    inverse: DampedInverse = field(default_factory=DampedInverse)
    posture: Array | None = field(default=None, compare=False)
    k_posture: float = 1.0
    joints: JointLimits | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        check_gains(self, "k_Pp", "k_Po", "k_posture")
        law_of(_velocity, type(self.orientation))  # not while an arm moves

    @cached_property
    def numbers(self) -> Array:
        """What the law is made of, as a row."""
        damped = self.inverse
        gains = self.orientation.slope, self.k_Pp, self.k_Po, self.k_posture
        options = self.orientation.options.values
        return to_rows(
            _Numbers, _Numbers(options, *gains, damped.eps, damped.lambda_max, damped.length)
        )

    def velocity(
        self,
        state: RobotState,
        desired: DesiredFrame,
        previous: Any,
        dt: float = 0.0,
        motion: MotionLimits | None = None,
    ) -> tuple[Any, ...]:
        """Return dq (n,) [rad/s], dp_de (3,) [m] and x_de.

        dq = J^-1 [dp_d + k_Pp dp_de; omega(x_de)], eqs. (23), (28), where omega is
        omega_d + k_Po eps_de for Euler parameters.

        Args:
            state: kinematics of the arm.
            desired: the desired frame.
            previous: x_de of the tick before, or None.
            dt: for how long dq will act [s]; 0: in continuous time.
            motion: limits of the tip, within which errors are undone; None: at any speed.

        Raises:
            SingularityError: if the representation has no finite answer.
        """
        q, orientation, posture = state.q, self.orientation, self.posture
        dq, dp_de, x_de = np.empty(len(q)), np.empty(3), np.empty(orientation.rows.width)
        is_finite = law_of(_velocity, type(orientation))(
            q,
            state.p_e,
            state.R_e,
            state.J,
            *desired,
            orientation.row(previous),
            self.numbers,
            NO_LIMITS.row if motion is None else motion.row,
            dt,
            NONE if posture is None else posture,
            rows_of(self.joints),
            dq,
            dp_de,
            x_de,
        )
        if not is_finite:
            raise SingularityError(orientation.singularity)
        return dq, dp_de, orientation.rows.unpack(x_de)

    @cached_property
    def fastest_gain(self) -> LoopGain:
        """The gain of the faster error equation: dx_de + k x_de = 0, errors being small."""
        return max(
            LoopGain("k_Pp", self.k_Pp, self.k_Pp),
            LoopGain("k_Po", self.k_Po, self.k_Po * self.orientation.slope),
            key=lambda gain: gain.rate,
        )

    def lyapunov(self, x_de: Any, _omega_de: Array) -> Lyapunov | None:
        """Return V_1 and its derivative, eqs. (30), (31)."""
        return self.orientation.lyapunov_1(x_de, self.k_Po)


class Clik(Scheme):
    """CLIK as in Fig. 1: integrates dq from the first measured q.

    At each tick q is the integral of the velocities commanded before, and dq the answer
    of the law to it, so q and dq belong to the same instant as the desired frame.

    Args:
        robot: the arm.
        law: the law with its gains.
        feedback: ``"internal"`` closes the loop on the integrated q, as in Fig. 1;
            ``"measured"`` on the measured q.
        limits: that bound the command; None if there are none.
        blend_time: [s] in which the command goes over to a law that replaces another.
        max_deviation: [rad or m] of the measured from the integrated q, while limits are on.
        max_error: of the tip, while limits are on.
        motion: limits of the tip, which bound how fast an error is undone, and what measured
            feedback may ask for, which overshoots; None if there are none.

    Raises:
        ConfigurationError: if the feedback is unknown or the posture has the wrong size.
    """

    def __init__(
        self,
        robot: Robot,
        law: ClikLaw,
        feedback: str = "internal",
        limits: JointLimits | None = None,
        blend_time: float = 0.1,
        max_deviation: float = 0.1,
        max_error: ErrorBounds = ErrorBounds(),  # noqa: B008  it is frozen
        motion: MotionLimits | None = None,
    ) -> None:
        if feedback not in FEEDBACKS:
            raise ConfigurationError(f"feedback is '{feedback}'; expected one of {FEEDBACKS}")
        self.robot = robot
        self.feedback = feedback
        self.limits = limits
        self._blend = Blend(blend_time)
        self.max_deviation, self.max_error = max_deviation, max_error
        self.motion = motion
        self._x_de: Any = None
        self.law = _checked(law, robot)
        self.reset(np.zeros(robot.n))

    def replace_law(self, law: ClikLaw) -> None:
        """Go over to another law, without a jump of the command.

        Raises:
            ConfigurationError: if its posture has the wrong size.
        """
        law = _checked(law, self.robot)
        if law == self.law and np.array_equal(law.posture, self.law.posture):  # type: ignore[arg-type]
            return
        if law.orientation != self.law.orientation:
            self._x_de = None  # means nothing to another representation
        self.law = law
        self._blend.replace(self._dq)

    @property
    def bounds(self) -> Bounds:
        """The limits of the joints."""
        return Bounds(self.limits)

    def bound(self, joints: JointLimits) -> None:
        """Keep to limits of the joints from the next tick on."""
        self.limits = joints

    @property
    def fastest_gain(self) -> LoopGain:
        """That of the law."""
        return self.law.fastest_gain

    def reset(self, q: Array) -> None:
        """Begin at the measured q (n,) with zero velocity."""
        self._q = q.copy()
        self._dq = np.zeros_like(q)
        self._x_de = None
        self._blend.reset()

    def resume(self, q: Array) -> None:
        """Restart at the measured q (n,), by the turns of the joints that were commanded."""
        self.reset(self._q + self.robot.limits.difference(q, self._q))

    def hold(self, dt: float, q: Array, dq: Array) -> JointCommand:
        """Return the command that holds still: it brakes as fast as the limits allow."""
        before, self._dq = self._dq, np.zeros_like(self._q)
        if self.limits is not None:
            self._q = self._integrate(dt, before)
            self._dq, _ = self.limits.limit_velocity(
                self._q, self._dq, dt if dt > 0 else SHORTEST, before
            )
        self._x_de = None
        self._blend.reset()
        return JointCommand(self._q, self._dq)

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the integrated q, no velocity."""
        return JointCommand(self._q, np.zeros_like(self._q))

    def start_frame(self) -> DesiredFrame:
        """Return the pose of the tip at the integrated q."""
        return self.frame_at(self._q)

    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame) -> Tick:
        """Integrate over dt [s] and return q, dq for this instant.

        Raises:
            SingularityError: if the law has no finite answer; nothing is integrated then.
            FollowingError: if the measured q is too far from the integrated one, or the tip from
                the desired frame.
        """
        q_c = self._integrate(dt, self._dq)
        if not is_finite(q_c):
            raise SingularityError("the joint velocities lead to infinite joint positions")
        self._refuse_deviation(q_c, q)
        if self.feedback == "internal":
            state = self.robot.state(q_c, self._dq)
        else:
            state = self.robot.state(q, dq)
        motion = None if self.limits is None else self.motion
        dq_c, dp_de, x_de = self.law.velocity(state, desired, self._x_de, dt, motion)
        dq_c = self._blend.blended(dt, dq_c)
        saturated, excess = False, 1.0
        if not is_finite(dq_c):
            raise SingularityError("the law asks for an infinite joint velocity")
        if self.limits is not None:
            self.max_error.refuse(desired, state)
            if self.feedback != "internal" and motion is not None:
                dq_c = dq_c / self._too_fast(q_c + dt / 2 * dq_c, dq_c, desired, motion)
            excess = self.limits.excess(dq_c)
            lasts = dt if dt > 0 else SHORTEST
            dq_c, saturated = self.limits.limit_velocity(q_c, dq_c, lasts, self._dq)
        self._q, self._dq, self._x_de = q_c, dq_c, x_de
        command = JointCommand(q_c, dq_c)
        return Tick(command, state, desired, dp_de, x_de, saturated, excess=excess)

    def _too_fast(self, q: Array, dq: Array, desired: DesiredFrame, motion: MotionLimits) -> float:
        """Return by how much the tip, at q, dq (n,), is beyond its speeds; 1 if it is not."""
        tip = self.robot.state(q, dq)
        pairs = (tip.dp_e, desired.dp_d), (tip.omega_e, desired.omega_d)
        return max(
            1.0,
            *(
                math.sqrt(v @ v) / max(most, math.sqrt(v_d @ v_d))
                for (v, v_d), most in zip(pairs, motion.speeds, strict=True)
            ),
        )

    def _integrate(self, dt: float, dq: Array) -> Array:
        """Return q (n,) after dt [s] of the velocity dq (n,)."""
        q = np.empty(len(dq))
        integrate(rows_of(self.limits), self._q, dq, dt, q)
        return q

    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return V_1 and its derivative, eqs. (30), (31)."""
        return self.law.lyapunov(tick.x_de, tick.desired.omega_d - tick.state.omega_e)

    def _refuse_deviation(self, q_c: Array, q: Array) -> None:
        if self.limits is None:
            return
        if not agree(self.limits.rows, q_c, q, self.max_deviation):
            deviation = self.limits.deviation(q_c, q)
            i = int(np.argmax(deviation))
            raise FollowingError(
                f"the joint {self.robot.joints[i]} is {deviation[i]:.3f} from its command; at most "
                f"{self.max_deviation} is allowed: is the arm braked or blocked, or its servo off? "
                "then send the reference again, else raise max_deviation"
            )


def _checked(law: ClikLaw, robot: Robot) -> ClikLaw:
    """Return the law of the robot, whose posture fits it."""
    if law.posture is not None and law.posture.shape != (robot.n,):
        raise ConfigurationError(
            f"posture has {law.posture.size} values; expected one for each of the {robot.n} "
            f"joints {', '.join(robot.joints)}"
        )
    inverse = replace(law.inverse, length=robot.length)
    return replace(law, joints=robot.limits, inverse=inverse)
