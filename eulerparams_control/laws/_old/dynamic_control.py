"""Dynamic control: resolved acceleration on inverse dynamics, section IV, Fig. 2.

Notation: ``a`` (6,) [m/s^2, rad/s^2] resolved acceleration, ``ddq`` (n,) [rad/s^2],
``tau`` (n,) [Nm], ``dp_de`` (3,) [m] p_d - p_e, ``x_de`` the orientation displacement of
the representation; ``k_Pp, k_Po`` [1/s^2] and ``k_Vp, k_Vo`` [1/s] gains; base frame.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from eulerparams_control.errors import ConfigurationError, FollowingError, SingularityError
from eulerparams_control.laws._old.blend import Blend, blend, kept
from eulerparams_control.laws._old.chain import (
    TIP,
    WORK,
    Motion,
    TipState,
    arm_state,
    chain_of_robot,
    dJ_dq,
    jacobian_in,
    put_arm,
    read_tip,
)
from eulerparams_control.laws._old.compiled import (
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
from eulerparams_control.laws._old.frames import (
    UNBOUNDED,
    Frame,
    TipLimits,
    approach,
    frame_of,
    frame_of_row,
    read_frame,
    row_of,
)
from eulerparams_control.laws._old.inverse_dynamics import (
    DDQ,
    DQ,
    DRIFT,
    EXTERNAL,
    INFINITE,
    NUMBERS,
    OBSERVER_RATE,
    PAST,
    SPEED,
    TAU,
    InverseDynamics,
    check_model,
    commanded,
    fitted,
    resolve_acceleration,
)
from eulerparams_control.laws._old.limits import UNLIMITED, excess_after
from eulerparams_control.laws._old.linear import Vec, mat, norm, put_vec, read_vec, vec
from eulerparams_control.laws._old.orientation import (
    Lyapunov,
    OrientationRepresentation,
    as_formulas,
)
from eulerparams_control.laws._old.orientation.base import Coordinates, law_of
from eulerparams_control.laws._old.rotations import chord
from eulerparams_control.laws._old.scheme import (
    FAR,
    TURNED,
    TipBounds,
    bounds_row,
    check_gains,
    read_bounds,
    tick_places,
    too_far,
)
from eulerparams_control.laws.hold import (
    NO_CONTACT,
    JointHold,
    contact_force,
)
from eulerparams_control.laws.limits import SHORTEST, JointLimits, factor_within
from eulerparams_control.laws.scheme import (
    Bounds,
    JointCommand,
    LoopGain,
    Scheme,
    Tick,
    refuse_error,
)
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.robot.robot import Robot, RobotState

# States that come slower than this [1/s] cannot hold the joints.
_HOLD_RATE = 20.0

# Square [Nm^2] of the external efforts below which the arm touches nothing.
_NO_EFFORT = 1.0

# Where the velocity is in the row of a frame.
_DP_D = slice(12, 15)

# A gain [1/s] that is none.
_TINY = 1e-100


displacement = acceleration = slot  # of a representation
law = read = put = slot  # that follow from these


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


def _law(
    tip: TipState, desired: Frame, previous: Any, numbers: _Numbers, most: TipLimits,
    drift: Input, a: Row,
) -> tuple[Any, bool]:  # fmt: skip
    """Fill a (6,): see ResolvedAcceleration; return x_de, and whether there is an answer."""
    away, motion = desired.p_d - tip.p_e, tip.motion  # eq. (21)
    x = displacement(desired.R_d, tip.R_e, previous, numbers.options)  # eqs. (22), (27)
    v, linear = most.linear_speed, most.linear_acceleration
    k_Pp, k_Vp, k_Vo = numbers.k_Pp, numbers.k_Vp, numbers.k_Vo
    k_Pp = _braked(k_Pp, k_Vp, norm(away), v, linear, norm(read_vec(drift, 0)))
    w, angular, k_Po = most.angular_speed, most.angular_acceleration, numbers.slope * numbers.k_Po
    k_Po = _braked(k_Po, k_Vo, chord(desired.R_d, tip.R_e), w, angular, norm(read_vec(drift, 3)))
    a_p = desired.ddp_d + k_Vp * (desired.dp_d - motion.v) + k_Pp * away  # (36)
    k_Po /= numbers.slope
    a_o = acceleration(  # eqs. (38), (40)
        x, desired.omega_d, desired.domega_d, motion.omega, k_Po, k_Vo, numbers.options
    )
    put_vec(a, 0, a_p)
    put_vec(a, 3, a_o)
    return x, not math.isnan(a_o.x)


def _acceleration(
    p_e: Input, R_e: Inputs, dp_e: Input, omega_e: Input,
    p_d: Input, R_d: Inputs, dp_d: Input, omega_d: Input, ddp_d: Input, domega_d: Input,
    previous: Input, numbers: Input, a: Row, x_de: Row,
) -> int:  # fmt: skip
    """Fill a (6,) and x_de; return whether the representation has an answer."""
    still, drift = Vec(0.0, 0.0, 0.0), np.zeros(6)
    tip = TipState(vec(p_e), mat(R_e), Motion(vec(dp_e), vec(omega_e), still, still))
    desired = frame_of(p_d, R_d, dp_d, omega_d, ddp_d, domega_d)
    before, given, most = read(previous, 0), _numbers(numbers, 0), UNBOUNDED
    x, is_found = law(tip, desired, before, given, most, drift, a)
    put(x_de, 0, x)
    return is_found


OF_LAW = NUMBERS + layout(TipBounds).width
"""Where the numbers of a law are among those of a tick."""

# What a tick finds beside what changed an effort: FAR, TURNED, or one of these.  _WORDS has the
# text of each code; SINGULAR uses the text of the representation.
SINGULAR, _STEEP, STEEP_JOINT, INFINITE_EFFORT = -3, -4, -5, -6
_WORDS = {
    _STEEP: "the law asks for an infinite acceleration of the tip",
    STEEP_JOINT: "the law asks for an infinite joint acceleration",
    INFINITE_EFFORT: "the joints are measured at a state of infinite efforts",
}


@kernel
def is_bounded(values: Row) -> bool:
    """Return whether the square of a vector is finite."""
    square = 0.0
    for i in range(len(values)):
        square += values[i] * values[i]
    return math.isfinite(square)


def _tick(
    chain: Rows, work: Rows, row: Row, q_now: Input, dq_now: Input, desired_row: Input,
    h: Input, previous: Input, dt: float, lasts: float, past: Rows, numbers: Input,
    posture: Rows, friction: Rows, limits: Rows, step: Row,
) -> int:  # fmt: skip
    """Fill the row of a tick; return what is found.

    Args:
        chain, work: of the arm; ``work`` has where its joints are.
        row: is filled: the arm, the excess, ddq and tau (n,), x_de.
        q_now, dq_now: (n,) of the arm; (0,): it is in ``row`` and ``work`` already.
        desired_row: the desired frame.
        h: (6,) [N, Nm] what the end effector exerts on the environment; (0,) is nothing.
        previous: x_de of the tick before.
        dt, lasts, past, friction, limits: see :func:`commanded`.
        numbers: of the inverse dynamics; behind them :class:`TipBounds`, and those of the law.
        posture: see :attr:`InverseDynamics.posture_rows`.
        step: see :func:`blend`.
    """
    n = len(work)
    at, at_ddq, at_tau, at_x = tick_places(n)
    if len(q_now) > 0:
        put_arm(chain, q_now, dq_now, work, row)
    q, dq, tip, J = row[:n], row[n : 2 * n], read_tip(row, 2 * n), jacobian_in(row, n)
    desired, drifts, a = read_frame(desired_row, 0), np.zeros(6), np.empty(6)
    given, most = _numbers(numbers, OF_LAW), read_bounds(numbers, NUMBERS)
    for i in range(6):
        for k in range(n):
            drifts[i] += J[i, k] * past[DRIFT, k]
    x, is_found = law(tip, desired, read(previous, 0), given, most.limits, drifts, a)
    put(row, at_x, x)
    if not is_found:
        return SINGULAR
    if limits.shape[1] > 0:
        found = too_far(desired, tip.p_e, tip.R_e, most)
        if found:
            return found
    if not is_bounded(a):
        return _STEEP
    ddq = np.empty(n)
    resolve_acceleration(q, dq, J, dJ_dq(row, n), a, numbers, posture, ddq)
    blend(step, dt, ddq)
    if not is_bounded(ddq):
        return STEEP_JOINT
    row[at] = excess_after(limits, dq, ddq) if limits.shape[1] > 0 else 1.0
    changed = commanded(
        chain, work, q, dq, J, ddq, h, dt, lasts, past, friction, numbers, limits,
        row[at_ddq:at_tau], row[at_tau:at_x],
    )  # fmt: skip
    if changed & INFINITE:
        return INFINITE_EFFORT
    kept(step)
    return changed


class EffortLaw(Protocol):
    """A law that dynamic control makes efforts of: what fills the row of a tick."""

    @property
    def orientation(self) -> OrientationRepresentation:
        """The representation of the orientation displacement."""

    @property
    def numbers(self) -> Array:
        """What the law is made of, as a row."""

    @property
    def step(self) -> Callable[..., int]:
        """What fills the row of a tick, with what :func:`_tick` takes."""

    @property
    def width(self) -> int:
        """How many floats its part of the row of a tick has: x_de, and what it knows besides."""

    @property
    def fastest_gain(self) -> LoopGain | None:
        """The gain of the fastest pole; None if that depends on where the arm is."""


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
        object.__setattr__(self, "orientation", as_formulas(self.orientation))

    def acceleration(
        self, arm: RobotState, desired: DesiredFrame, previous: Any
    ) -> tuple[Any, ...]:
        """Return a (6,), dp_de (3,) [m] and x_de.

        a_p = ddp_d + k_Vp (dp_d - dp_e) + k_Pp (p_d - p_e), eq. (36), and a_o of the
        representation: domega_d + k_Vo Delta omega_de + k_Po eps_de for Euler parameters,
        eq. (40).

        Args:
            arm: kinematics of the arm.
            desired: the desired frame.
            previous: x_de of the tick before, or None.

        Raises:
            SingularityError: if the representation has no finite answer.
        """
        orientation, a = self.orientation, np.empty(6)
        x_de = np.empty(orientation.rows.width)
        given = orientation.row(previous), self.numbers
        of_arrays = law_of(_acceleration, _law, type(orientation))
        if not of_arrays(*arm[2:6], *desired, *given, a, x_de):
            raise SingularityError(orientation.singularity)
        return a, desired.p_d - arm.p_e, orientation.rows.unpack(x_de)

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

    @cached_property
    def step(self) -> Callable[..., int]:
        """What fills the row of a tick."""
        return law_of(_tick, _law, type(self.orientation))

    @property
    def width(self) -> int:
        """How many floats its part of the row of a tick has."""
        return self.orientation.rows.width

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

    @cached_property
    def rows(self) -> Array:
        """The limits of the joints, and the rates [Nm/s] of the efforts; or of no joint."""
        if self.joints is None:
            return UNLIMITED
        return np.vstack((self.joints.rows, np.full(len(self.joints.effort), self.rate)))

    @cached_property
    def bounds(self) -> Array:
        """Bounds of errors and tip as a row."""
        return bounds_row(self.error_position, self.error_rotation, self.motion)

    def refuse_error(self, desired: DesiredFrame, arm: RobotState) -> None:
        """Raise FollowingError if the tip is too far from the desired frame."""
        if self.joints is not None:
            refuse_error(desired, arm, self.error_position, self.error_rotation)


class DynamicControl(Scheme):
    """Resolved acceleration on inverse dynamics, as in Fig. 2.

    Args:
        robot: the arm.
        law: what the efforts are to do.
        dynamics: makes efforts of it.
        limits: that bound the command; the first effort is within its rate of the one at which
            the robot begins, see :meth:`start_from`.
        blend_time: [s] in which the command goes over to a law that replaces another.

    Attributes:
        law, dynamics, limits: in force; see :meth:`replace_law`, :meth:`bound`.
        work: where the joints are, as :func:`place` fills it; see :meth:`efforts`.
        width: of the row of a tick.

    Raises:
        ConfigurationError: if the posture or the friction has the wrong size.
        RobotError: if the model of the robot cannot give its efforts.
    """

    law: EffortLaw

    def __init__(
        self,
        robot: Robot,
        law: EffortLaw,
        dynamics: InverseDynamics,
        limits: EffortLimits,
        blend_time: float = 0.1,
    ) -> None:
        self.robot = robot
        self._blend = Blend(blend_time, robot.n)
        self._start: Array | None = None
        self._places, self.work = tick_places(robot.n), np.empty((robot.n, WORK))
        self._take(law, fitted(dynamics, robot), limits)
        check_model(robot)
        self.reset(np.zeros(robot.n))

    def replace_law(self, law: EffortLaw, dynamics: InverseDynamics, limits: EffortLimits) -> None:
        """Go over to another law, without a jump of the command.

        Raises:
            ConfigurationError: if the posture or the friction has the wrong size.
        """
        is_same = law.orientation == self.law.orientation
        self._take(law, fitted(dynamics, self.robot), limits)
        if not is_same:
            self._forget_x()  # it means nothing to another representation
        if not self._saturated:  # of a law that failed nothing is to go on
            self._blend.replace(self._past[DDQ])

    def _take(self, law: EffortLaw, dynamics: InverseDynamics, limits: EffortLimits) -> None:
        self.law, self.dynamics, self._step = law, dynamics, law.step  # compiled before a tick
        self._keep_to(limits)
        self.width, self._unpack = self._places[3] + law.width, law.orientation.rows.unpack
        gain = law.fastest_gain
        self.loop_rate = 0.0 if gain is None else gain.rate

    def _keep_to(self, limits: EffortLimits) -> None:
        self.limits, dynamics = limits, self.dynamics
        numbers = np.concatenate((dynamics.numbers, limits.bounds, self.law.numbers))
        rows = dynamics.posture_rows, dynamics.friction_rows, limits.rows
        self._given = numbers, *rows, self._blend.row

    def _forget_x(self) -> None:
        self._x_de = np.zeros(self.law.width)

    @property
    def fastest_gain(self) -> LoopGain | None:
        """That of the law."""
        return self.law.fastest_gain

    @property
    def hold_rate(self) -> float:
        """The rate [1/s] of the loop by which the joints are held."""
        return _HOLD_RATE

    @property
    def bounds(self) -> Bounds:
        """The limits of the joints, and the rate of the efforts."""
        return Bounds(self.limits.joints, self.limits.rate)

    def bound(self, joints: JointLimits) -> None:
        """Keep to limits of the joints from the next tick on."""
        self._keep_to(replace(self.limits, joints=joints))

    def start_from(self, effort: Array | None) -> None:
        """Begin at the efforts (n,) that the robot reports, if it does; else at its weight.

        A robot that compensates its weight itself begins at none.
        """
        is_known = effort is not None and np.isfinite(effort).all()
        if effort is None or not (is_known and self.dynamics.gravity and effort.any()):
            self._start = None
        else:
            self._start = self.robot.limits.limit_effort(effort)[0]
        self._note_efforts()

    def reset(self, q: Array) -> None:
        """Begin at the measured q (n,)."""
        self._q = q.copy()
        self._past = np.zeros((PAST, len(q)))
        self._past[DQ] = self._past[SPEED] = math.nan
        self._saturated, self._contact = False, NO_CONTACT
        self._tau: Array | None = None
        self._note_efforts()
        self._forget_x()
        self._hold: JointHold | None = None
        self._blend.reset()

    def skip(self) -> None:
        """Forget the speeds of the tick before, which tell how the joints drift."""
        self._past[DQ] = self._past[SPEED] = math.nan

    def resume(self, q: Array) -> None:
        """Begin at the measured q (n,), with the efforts and the contact as they are."""
        tau, past, contact = self._tau, self._past, self._contact
        self.reset(q)
        self._tau, self._contact = tau, contact
        self._past[SPEED], self._past[EXTERNAL] = past[SPEED], past[EXTERNAL]
        self._note_efforts()

    def _note_efforts(self) -> None:
        """Note which efforts act: the last ones, or those at the start, or those of the weight."""
        acting = self._start if self._tau is None else self._tau
        self._past[TAU] = math.nan if acting is None else acting

    def hold(self, dt: float, q: Array, dq: Array, w: Array | None = None) -> JointCommand:
        """Return efforts that stop the joints, and hold them there: see :class:`JointHold`.

        It needs no orientation.  Friction, which helps to stop, is not compensated.

        Args:
            dt, q, dq: as :meth:`tick` takes them.
            w: (6,) the contact as it is measured, base frame, about the tip; or None.
        """
        state, dynamics, past = self.robot.dynamic_state(q, dq), self.dynamics, self._past
        self._q = q
        self._forget_x()
        self._blend.reset()
        weight = state.C_dq + state.g
        own = dynamics.coriolis * state.C_dq + dynamics.gravity * state.g
        last = own if np.isnan(past[TAU]).any() else past[TAU].copy()
        rate = np.broadcast_to(self.limits.rate, q.shape).astype(float)
        e = e_now = past[EXTERNAL].copy()
        if dt > 0 and not np.isnan(past[SPEED]).any():  # eq. (32)
            e_now = state.B @ ((dq - past[SPEED]) / dt) + own - last
            if dynamics.friction is not None:
                e_now += dynamics.friction.effort(dq)
            e = e + (1 - math.exp(-OBSERVER_RATE * dt)) * (e_now - e)
        joints = self.limits.joints or self.robot.limits
        if self._hold is None:
            length, drove_in = self.robot.length, self._contact.drove_in
            self._hold = JointHold(joints, rate, length, state, e, w, drove_in)
        self._hold.bound(joints, rate)
        tau = self._hold.effort(dt, state, e_now, e, w) + own - weight
        room = rate * self._lasts(dt)
        tau = last + factor_within(np.zeros_like(tau), tau - last, room) * (tau - last)
        if not np.isfinite(tau).all():  # the measured state gives no finite efforts
            tau, e, self._hold = last, np.zeros_like(e), None
        past[DQ], past[DDQ], past[TAU], past[SPEED] = math.nan, 0.0, tau, dq
        past[DRIFT], past[EXTERNAL] = 0.0, e
        self._tau, self._start = tau, None
        return JointCommand(effort=tau)

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the gravitational efforts at q (n,): nothing in them gets stale."""
        g = self.robot.dynamic_state(q, np.zeros_like(q)).g
        tau = g if self.dynamics.gravity else np.zeros_like(g)
        return JointCommand(effort=self.robot.limits.limit_effort(tau)[0])

    def start_frame(self) -> DesiredFrame:
        """Return the pose of the tip at the measured q."""
        return self.frame_at(self._q)

    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame, h: Array = NONE) -> Tick:
        """Return the efforts for this instant, also against a contact, eq. (48).

        Args:
            dt: [s] after the tick before.
            q, dq: (n,) measured.
            desired: the desired frame.
            h: (6,) [N, Nm] what the end effector exerts on the environment; (0,) is nothing.

        Raises:
            RobotError: if q or dq has not n elements.
            SingularityError: if the law has no finite answer.
            FollowingError: if the tip is too far from the desired frame.
        """
        return self._tick(dt, q, dq, desired, h)

    def _tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame, h: Array) -> Tick:
        n = self.robot.n
        if len(q) != n or len(dq) != n:
            self.robot.refuse_size(q, dq)
        row = np.empty(self.width)
        tau, saturated, excess = self.efforts(dt, row, row_of(desired), h, q, dq)
        self.note_contact(dt, row, row_of(desired), None, self.is_pressing)
        x_de, arm = self._unpack(self._x_de), arm_state(row, n)
        command = JointCommand(effort=tau)
        return Tick(command, desired, arm, x_de, saturated, excess, None, self._x_de)

    def efforts(
        self, dt: float, row: Array, desired: Array, h: Array,
        q: Array = NONE, dq: Array = NONE,
    ) -> tuple[Array | None, bool, float]:  # fmt: skip
        """Return the efforts for this instant with the ``saturated`` and ``excess`` of a tick.

        Args:
            row: (width,) becomes that of the tick; without q, dq it begins with that of the arm,
                and ``work`` was filled, too.
            dt, desired, h, q, dq: as :meth:`step` takes them, which says what is raised.
        """
        robot, (at, _, at_tau, at_x) = self.robot, self._places
        chain, given = chain_of_robot(robot), (self._past, *self._given)
        found = self._step(
            chain, self.work, row, q, dq, desired, h, self._x_de, dt, self._lasts(dt), *given
        )
        self._q, self._hold = row[: robot.n], None
        if found < 0:
            raise self._error(found, row, frame_of_row(desired))
        self._saturated, self._x_de = found != 0, row[at_x:]
        tau = self._tau = row[at_tau:at_x]
        self._start = None
        return tau, self._saturated, row.item(at)

    def note_contact(
        self, dt: float, row: Array, desired: Array, force: Array | None, presses: bool
    ) -> None:
        """Count who does the work on a contact: the motion, or what pushes the arm.

        Args:
            dt: [s] since the tick before.
            row: of this tick.
            desired: the frame that leads the arm, as a row (24,).
            force: (3,) [N] of the contact on the tip as it is measured; None: it is estimated.
            presses: whether the arm is told to exert a force.
        """
        n, e, is_measured = self.robot.n, self._past[EXTERNAL], force is not None
        if force is None:
            if not e @ e >= _NO_EFFORT:
                self._contact = NO_CONTACT
                return
            J = row[2 * n + TIP : 8 * n + TIP].reshape(6, n)
            force = contact_force(J, e, self.robot.length)
        dp_d, dp_e = desired[_DP_D], row[2 * n + 12 : 2 * n + 15]
        self._contact = self._contact.after(dt, force, is_measured, dp_d, dp_e, presses)

    def _error(
        self, found: int, row: Array, desired: DesiredFrame
    ) -> FollowingError | SingularityError:
        """Return what to say of what was found."""
        if found in (FAR, TURNED):
            try:
                self.limits.refuse_error(desired, arm_state(row, self.robot.n))
            except FollowingError as error:
                return error
        return SingularityError(_WORDS.get(found) or self.law.orientation.singularity)

    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return V_2 and its derivative, eqs. (42), (43)."""
        assert isinstance(self.law, ResolvedAcceleration)  # another law has another scheme
        return self.law.lyapunov(tick.x_de, tick.desired.omega_d - tick.state.omega_e)

    def _lasts(self, dt: float) -> float:
        """Return how long [s] the efforts before have acted, dt [s] after the tick before."""
        return max(dt, SHORTEST) if self._tau is None else dt
