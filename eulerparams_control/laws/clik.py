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
from eulerparams_control.laws._old.compiled import (
    NONE,
    Array,
    Input,
    Inputs,
    Row,
    Rows,
    kernel,
    layout,
    of_parts,
    slot,
    to_rows,
)
from eulerparams_control.laws._old.linear import Mat, Vec, mat, norm, put_vec, vec
from eulerparams_control.laws._old.orientation import (
    Lyapunov,
    OrientationRepresentation,
    as_formulas,
)
from eulerparams_control.laws._old.orientation.base import Coordinates, law_of
from eulerparams_control.laws._old.rotations import chord
from eulerparams_control.laws.blend import Blend, blend, kept
from eulerparams_control.laws.inverse import DampedInverse, invert, resolve
from eulerparams_control.laws.limits import (
    SHORTEST,
    JointLimits,
    agree,
    excess,
    integrate,
    is_finite,
    limit_velocity,
    rows_of,
    subtract,
)
from eulerparams_control.laws.scheme import (
    FAR,
    TURNED,
    Bounds,
    ErrorBounds,
    JointCommand,
    LoopGain,
    Scheme,
    Tick,
    TipBounds,
    check_gains,
    tick_places,
    too_far,
)
from eulerparams_control.motion.frames import DesiredFrame, frame_of, read_frame
from eulerparams_control.motion.motion_limits import (
    NO_LIMITS,
    UNBOUNDED,
    MotionLimits,
    TipLimits,
    approach,
    read_limits,
)
from eulerparams_control.robot.chain import (
    WORK,
    jacobian_in,
    place,
    put_arm,
    tip_motion,
)
from eulerparams_control.robot.robot import Robot, RobotState

FEEDBACKS = ("internal", "measured")


displacement = velocity = slot  # of a representation
law = read = put = slot  # that follow from these


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


def _law(
    q: Input, p_e: Vec, R_e: Mat, J: Inputs, desired: DesiredFrame, previous: Any,
    numbers: _Numbers, most: TipLimits, dt: float, posture: Input, joints: Rows, dq: Row,
) -> tuple[Any, bool]:  # fmt: skip
    """Fill dq (n,): see ClikLaw; return x_de, and whether the representation has an answer.

    What acts for dt has the gains ``over`` dt, and the means of dp_d and omega_d at constant
    acceleration: what is held for dt then leads to where the desired frame will be.  An error e
    asks for the speed k e: no more than that from which the tip stops where e is 0.
    """
    away = desired.p_d - p_e  # eq. (21)
    x = displacement(desired.R_d, R_e, previous, numbers.options)  # eqs. (22), (27)
    k_Pp, k_Po = over(numbers.k_Pp, dt), over(numbers.k_Po, numbers.slope * dt)
    distance, angle = norm(away), chord(desired.R_d, R_e)
    v = approach(distance, k_Pp, most.linear_speed, most.linear_acceleration)
    if k_Pp * distance > v:
        k_Pp = v / distance
    w = approach(angle, numbers.slope * k_Po, most.angular_speed, most.angular_acceleration)
    if 2.0 * k_Po * numbers.slope * angle > w:  # where x_de is large: not slope times the angle
        k_Po *= w / max(norm(velocity(x, Vec(0.0, 0.0, 0.0), k_Po, numbers.options)), w)
    v_p = desired.dp_d + (dt / 2.0) * desired.ddp_d + k_Pp * away
    v_o = velocity(x, desired.omega_d + (dt / 2.0) * desired.domega_d, k_Po, numbers.options)
    inverse = np.empty((len(q), 6))
    invert(J, numbers.eps, numbers.lambda_max, numbers.length, inverse)
    bracket, dq_0 = np.empty(6), np.zeros(len(q))
    put_vec(bracket, 0, v_p)
    put_vec(bracket, 3, v_o)
    if len(posture) > 0:
        subtract(joints, posture, q, dq_0)
        for i in range(len(q)):
            dq_0[i] *= over(numbers.k_posture, dt)
    resolve(inverse, J, bracket, dq_0, dq)  # eqs. (23), (28)
    return x, not math.isnan(v_o.x)


def _velocity(
    q: Input, p_e: Input, R_e: Inputs, J: Inputs,
    p_d: Input, R_d: Inputs, dp_d: Input, omega_d: Input, ddp_d: Input, domega_d: Input,
    previous: Input, numbers: Input, motion: Input, dt: float, posture: Input, joints: Rows,
    dq: Row, x_de: Row,
) -> int:  # fmt: skip
    """Fill dq (n,) and x_de; return whether the representation has an answer."""
    desired = frame_of(p_d, R_d, dp_d, omega_d, ddp_d, domega_d)
    given, most, before = read_numbers(numbers, 0), read_limits(motion, 0), read(previous, 0)
    x, is_found = law(
        q, vec(p_e), mat(R_e), J, desired, before, given, most, dt, posture, joints, dq
    )
    put(x_de, 0, x)
    return is_found


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
        object.__setattr__(self, "orientation", as_formulas(self.orientation))

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
        dq, x_de = np.empty(len(q)), np.empty(orientation.rows.width)
        is_found = law_of(_velocity, _law, type(orientation))(
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
            x_de,
        )
        if not is_found:
            raise SingularityError(orientation.singularity)
        return dq, desired.p_d - state.p_e, orientation.rows.unpack(x_de)

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


# What a tick finds: a limit changed the command; or FAR, TURNED, or one of these.  _WORDS has the
# text of each code; _SINGULAR uses the text of the representation.
_SATURATED = 1
_SINGULAR, _LOST, _AWAY, _INFINITE = -3, -4, -5, -6


_WORDS = {
    _LOST: "the joint velocities lead to infinite joint positions",
    _INFINITE: "the law asks for an infinite joint velocity",
}


class _Loop(NamedTuple):
    """How the loop is closed, and its bounds: of the joints [rad or m], and of the tip."""

    is_internal: bool
    deviation: float
    tip: TipBounds


class _Given(NamedTuple):
    """What a tick is given."""

    numbers: _Numbers
    loop: _Loop


_read_given = layout(_Given).read


@kernel
def _slow_down(
    chain: Rows, q: Input, dq: Row, dt: float, desired: DesiredFrame, most: TipLimits, work: Rows
) -> None:
    """Slow dq (n,) down, so that the tip half a step later is not beyond its speeds.

    These are no lower than those of the desired frame.
    """
    n = len(q)
    there = np.empty(n)
    for i in range(n):
        there[i] = q[i] + dt / 2.0 * dq[i]
    _, p_e = place(chain, there, work)
    tip = tip_motion(chain, p_e, dq, work)
    v = max(most.linear_speed, norm(desired.dp_d))
    w = max(most.angular_speed, norm(desired.omega_d))
    beyond = max(1.0, max(norm(tip.v) / v, norm(tip.omega) / w))
    for i in range(n):
        dq[i] /= beyond


def _tick(
    chain: Rows, q: Input, dq: Input, desired_row: Input, before: Input, dt: float,
    numbers: Input, posture: Rows, limits: Rows, step: Row, row: Row,
) -> int:  # fmt: skip
    """Fill the row of a tick, see :class:`Clik`, and return what is found.

    Args:
        chain: of the arm.
        q, dq: (n,) measured.
        desired_row: the desired frame.
        before: the row of the tick before.
        dt: [s] since then.
        numbers: see :class:`_Given`.
        posture: (1, n) of the law, above the limits by whose turns positions differ; or (0, n).
        limits: of the joints; there may be none.
        step: see :func:`blend`.
        row: is filled.
    """
    n, is_limited = len(q), limits.shape[1] > 0
    given, closed = _read_given(numbers, 0)
    work, tends = np.empty((n, WORK)), posture[0] if len(posture) > 0 else row[:0]
    at, at_q, at_dq, at_x = tick_places(n)
    q_c, dq_c, dq_0 = row[at_q:at_dq], row[at_dq:at_x], before[at_dq:at_x]
    integrate(limits, before[at_q:at_dq], dq_0, dt, q_c)
    if not is_finite(q_c):
        return _LOST
    if is_limited and not agree(limits, q_c, q, closed.deviation):
        return _AWAY
    desired = read_frame(desired_row, 0)
    if closed.is_internal:
        tip = put_arm(chain, q_c, dq_0, work, row)
    else:
        tip = put_arm(chain, q, dq, work, row)
    most, J, wanted = UNBOUNDED, jacobian_in(row, n), np.empty(n)
    if is_limited:
        most = closed.tip.limits
    x, is_found = law(
        row[:n], tip.p_e, tip.R_e, J, desired, read(before, at_x), given, most, dt, tends,
        posture[1:], wanted,
    )  # fmt: skip
    put(row, at_x, x)
    row[at] = 1.0
    if not is_found:
        return _SINGULAR
    blend(step, dt, wanted)
    if not is_finite(wanted):
        return _INFINITE
    if not is_limited:
        for i in range(n):
            dq_c[i] = wanted[i]
        kept(step)
        return 0
    found = too_far(desired, tip.p_e, tip.R_e, closed.tip)
    if found:
        return found
    if not closed.is_internal:
        _slow_down(chain, q_c, wanted, dt, desired, most, work)
    row[at] = excess(limits, wanted)
    kept(step)
    lasts = dt if dt > 0.0 else SHORTEST
    return _SATURATED if limit_velocity(limits, q_c, wanted, lasts, dq_0, dq_c) else 0


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
        self._blend = Blend(blend_time, robot.n)
        self._max_deviation = max_deviation
        self._places = tick_places(robot.n)
        self.law = _checked(law, robot)
        self.keep_to(limits, max_error, motion)
        self._take(self.law)
        self.reset(np.zeros(robot.n))

    def keep_to(
        self, limits: JointLimits | None, max_error: ErrorBounds, motion: MotionLimits | None
    ) -> None:
        """Keep to these limits and errors from the next tick on."""
        self.limits, self._max_error = limits, max_error
        closed = self.feedback == FEEDBACKS[0], self._max_deviation
        self._loop = np.array([*closed, *max_error.row(motion)])
        self._give()

    def _take(self, law: ClikLaw) -> None:
        self.law = law
        self._step = law_of(_tick, _law, type(law.orientation))  # before it is ticked
        self._unpack, self.loop_rate = law.orientation.rows.unpack, law.fastest_gain.rate
        self._give()

    def _give(self) -> None:
        """Gather what each tick is given."""
        law, posture = self.law, np.empty((0, self.robot.n))
        if law.posture is not None:
            posture = np.vstack((law.posture, self.robot.limits.rows))
        numbers = np.concatenate((law.numbers, self._loop))
        self._given = numbers, posture, rows_of(self.limits), self._blend.row

    def replace_law(self, law: ClikLaw) -> None:
        """Go over to another law, without a jump of the command.

        Raises:
            ConfigurationError: if its posture has the wrong size.
        """
        law = _checked(law, self.robot)
        if law == self.law and np.array_equal(law.posture, self.law.posture):  # type: ignore[arg-type]
            return
        is_same, q, dq = law.orientation == self.law.orientation, self._q, self._dq
        self._take(law)
        if not is_same:
            self._begin(q, dq)  # x_de means nothing to another representation
        self._blend.replace(dq)

    @property
    def bounds(self) -> Bounds:
        """The limits of the joints."""
        return Bounds(self.limits)

    def bound(self, joints: JointLimits) -> None:
        """Keep to limits of the joints from the next tick on."""
        self.limits = joints
        self._give()

    @property
    def fastest_gain(self) -> LoopGain:
        """That of the law."""
        return self.law.fastest_gain

    def reset(self, q: Array) -> None:
        """Begin at the measured q (n,) with zero velocity."""
        self._begin(q, np.zeros_like(q))
        self._blend.reset()

    def _begin(self, q: Array, dq: Array) -> None:
        """Go on from the commands q, dq (n,), without an x_de."""
        self._keep(np.zeros(self._places[3] + self.law.orientation.rows.width))
        self._q[:], self._dq[:] = q, dq

    def _keep(self, row: Array) -> None:
        """Take the row of a tick for that of the last one."""
        _, at_q, at_dq, at_x = self._places
        self._row, self._q, self._dq = row, row[at_q:at_dq], row[at_dq:at_x]

    def resume(self, q: Array) -> None:
        """Restart at the measured q (n,), by the turns of the joints that were commanded."""
        self.reset(self._q + self.robot.limits.difference(q, self._q))

    def hold(self, dt: float, q: Array, dq: Array) -> JointCommand:
        """Return the command that holds still: it brakes as fast as the limits allow."""
        before, limits, lasts = self._dq, self.limits, dt if dt > 0 else SHORTEST
        q_c, dq_c = self._q.copy(), np.zeros_like(before)
        if limits is not None:
            integrate(limits.rows, self._q, before, dt, q_c)
            dq_c, _ = limits.limit_velocity(q_c, dq_c, lasts, before)
        self._begin(q_c, dq_c)
        self._blend.reset()
        return JointCommand(q_c, dq_c)

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the integrated q, no velocity."""
        return JointCommand(self._q, np.zeros_like(self._q))

    def start_frame(self) -> DesiredFrame:
        """Return the pose of the tip at the integrated q."""
        return self.frame_at(self._q)

    def step(self, dt: float, q: Array, dq: Array, desired: Array) -> Tick:
        """Integrate over dt [s] and return q, dq for this instant.

        Raises:
            SingularityError: if the law has no finite answer; nothing is integrated then.
            FollowingError: if the measured q is too far from the integrated one, or the tip from
                the desired frame.
        """
        robot, before = self.robot, self._row
        if len(q) != robot.n or len(dq) != robot.n:
            robot.refuse_size(q, dq)
        row = np.empty(len(before))
        found = self._step(robot.chain, q, dq, desired, before, dt, *self._given, row)
        if found < 0:
            raise self._error(found, row, q, DesiredFrame.of(desired))
        at, at_q, at_dq, at_x = self._places
        self._row, self._q, self._dq = row, row[at_q:at_dq], row[at_dq:at_x]
        told = found > 0, row.item(at), None, row[at_x:]
        command = of_parts(JointCommand, (self._q, self._dq, None, None))
        return of_parts(Tick, (command, desired, row, robot.n, self._unpack, *told))

    def _error(
        self, found: int, row: Array, q: Array, desired: DesiredFrame
    ) -> FollowingError | SingularityError:
        """Return what to say of what was found at the measured q (n,)."""
        if found == _AWAY:
            return self._deviation(row, q)
        if found in (FAR, TURNED):
            return self._max_error.error(found, desired, RobotState.of(row, len(q)))
        return SingularityError(_WORDS.get(found) or self.law.orientation.singularity)

    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return V_1 and its derivative, eqs. (30), (31)."""
        return self.law.lyapunov(tick.x_de, tick.desired.omega_d - tick.state.omega_e)

    def _deviation(self, row: Array, q: Array) -> FollowingError:
        _, at_q, at_dq, _ = self._places
        deviation = self.robot.limits.deviation(row[at_q:at_dq], q)
        i = int(np.argmax(deviation))
        return FollowingError(
            f"the joint {self.robot.joints[i]} is {deviation[i]:.3f} from its command; at most "
            f"{self._max_deviation} is allowed: is the arm braked or blocked, or its servo off? "
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
