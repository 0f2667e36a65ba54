"""Impedance control with an inner motion loop, section V, Fig. 3.

The contact wrench moves a compliant frame away from the desired one by the impedance equations
(52), (55), (59); the motion loop (49), (50), (51) follows it on inverse dynamics with the wrench
compensated, eq. (48).

Notation: ``h`` (6,) [N, Nm] wrench of the end effector on the environment: minus the contact
wrench ``w`` = (f, mu) of the environment on the end effector; base frame, about the tip.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import (
    ConfigurationError,
    ContactError,
    FollowingError,
    OverloadError,
)
from eulerparams_control.laws._old.blend import Blend, blend, kept
from eulerparams_control.laws._old.compiled import (
    NONE,
    Array,
    Input,
    Row,
    Rows,
    layout,
    slot,
)
from eulerparams_control.laws._old.contact_watch import ContactWatch, observe
from eulerparams_control.laws._old.dynamic_control import (
    DynamicControl,
    EffortLimits,
    ResolvedAcceleration,
)
from eulerparams_control.laws._old.inverse_dynamics import InverseDynamics
from eulerparams_control.laws._old.orientation import Lyapunov
from eulerparams_control.laws._old.orientation.base import Coordinates, entry_of
from eulerparams_control.laws._old.rotations import angle_between, exp
from eulerparams_control.laws.compliant_frame import ComplianceLaw, CompliantFrame
from eulerparams_control.laws.contact_watch import Oscillation
from eulerparams_control.laws.force_control import ForceControl, ForceOptions
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.scheme import Bounds, JointCommand, LoopGain, Scheme, Tick
from eulerparams_control.laws.wrench import (
    STATE,
    SensedWrench,
    WrenchChain,
    WrenchOptions,
    at_point,
    feel,
)
from eulerparams_control.motion.frames import (
    AT_ORIGIN,
    DesiredFrame,
    Placement,
    carried_row,
    read_frame,
)
from eulerparams_control.robot.chain import (
    TIP,
    WORK,
    arm_width,
    dJ_dq,
    jacobian_in,
    put_arm,
    read_tip,
)
from eulerparams_control.robot.robot import Robot, RobotState

# Time [s] in which the wrench goes over to one that is made otherwise, or lost, or found again.
_BLEND_TIME = 0.1

_TOO_LARGE = -1
"""Of a contact; else what is sensed has the code of an :class:`Oscillation`."""

# The part of its bound that the displacement has reached where it is at its end.
_AT_ITS_END = 0.99

# Each time that the contact oscillates there is so many times the damping, up to this, until the
# tool was free for the time [s].
_CALMER, _CALMEST, _FREE = 3.0, 9.0, 2.0


class NoMotionLoop:
    """Commands nothing: the compliant frame goes to a controller of positions (admittance).

    Args:
        robot: the arm.
        limits: the errors at which the motion is stopped.
    """

    def __init__(self, robot: Robot, limits: EffortLimits) -> None:
        self.robot, self.limits = robot, limits
        self.work, self.width = np.empty((robot.n, WORK)), arm_width(robot.n)

    fastest_gain, hold_rate, loop_rate = None, 0.0, 0.0  # the loops are those of the robot

    @property
    def bounds(self) -> Bounds:
        """The limits of the joints."""
        return Bounds(self.limits.joints)

    def bound(self, joints: JointLimits) -> None:
        """Go on: no joint is commanded."""

    def reset(self, q: Array) -> None:
        """Begin: there is nothing to forget."""

    resume = reset

    def start_from(self, effort: Array | None) -> None:
        """Begin: there are no efforts."""

    def skip(self) -> None:
        """Go on: there are no rates."""

    def note_contact(
        self, dt: float, row: Array, desired: Array, force: Array | None, presses: bool
    ) -> None:
        """Go on: no joint is held here."""

    def hold(self, dt: float, q: Array, dq: Array, w: Array | None = None) -> JointCommand:
        """Return no command."""
        return JointCommand()

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return no command."""
        return JointCommand()

    def efforts(
        self, dt: float, row: Array, desired: Array, h: Array
    ) -> tuple[Array | None, bool, float]:
        """Return no efforts; raises FollowingError if the arm does not follow."""
        self.limits.refuse_error(DesiredFrame.of(desired), RobotState.of(row, self.robot.n))
        return None, False, 1.0

    def replace_law(
        self, law: ResolvedAcceleration, dynamics: InverseDynamics, limits: EffortLimits
    ) -> None:
        """Take over the limits."""
        self.limits = limits


MotionLoop = DynamicControl | NoMotionLoop
"""The loop that follows the compliant frame: one of the scheme, or the robot's own."""


@dataclass(frozen=True)
class ImpedanceLaw:
    """All that the impedance is made of.

    Attributes:
        compliance: the equations of the compliant frame.
        wrench: how the contact is made of what the sensor says.
        centre: frame of the compliance seen from the tip.
        max_force, max_moment: [N], [Nm] of the contact that stop the motion.
        ripple_force, ripple_moment: [N], [Nm] that the contact may swing by while the arm feeds it.
        stiffness_energy: [J] that changes of M and K may add, beside what the damping takes.
        max_jump_position, max_jump_rotation: [m], [rad] by which the compliant frame may be
            displaced when a wrench is measured again; more stops the motion.
        force: how a force is exerted.
        inner_loop: whether the motion loop follows the compliant frame; else the impedance
            acts on the measured frame itself, without rejecting disturbances.
    """

    compliance: ComplianceLaw
    wrench: WrenchOptions = field(default_factory=WrenchOptions)
    centre: Placement = AT_ORIGIN
    inner_loop: bool = True
    max_force: float = math.inf
    max_moment: float = math.inf
    max_jump_position: float = math.inf
    max_jump_rotation: float = math.inf
    ripple_force: float = math.inf
    ripple_moment: float = math.inf
    stiffness_energy: float = math.inf
    force: ForceOptions = field(default_factory=ForceOptions)

    def __post_init__(self) -> None:
        kind = type(self.compliance.orientation)
        object.__setattr__(self, "sense", entry_of(_sense, kind))

    sense: Callable[..., int] = field(init=False, repr=False, compare=False)

    @cached_property
    def numbers(self) -> Array:
        """What is sensed is made of, as a row, see :class:`_Numbers`."""
        most, options = (self.max_force, self.max_moment), self.compliance.orientation.options.row
        return np.concatenate((most, options, self.wrench.numbers))

    @cached_property
    def at(self) -> Array:
        """The centre seen from the tip, as a row."""
        return self.centre.row

    @cached_property
    def back(self) -> Array:
        """The tip seen from the centre, as a row."""
        return self.centre.inverse.row

    @property
    def watched(self) -> tuple[float, float, Impedance, Impedance]:
        """What its :class:`ContactWatch` expects."""
        law = self.compliance
        return self.ripple_force, self.ripple_moment, law.translation, law.rotation

    def refuse_wrench(self, force: float, moment: float) -> None:
        """Raise OverloadError for a contact of a force [N] or moment [Nm] that is too large."""
        for size, most, unit, name in (
            (force, self.max_force, "N", "max_contact_force"),
            (moment, self.max_moment, "Nm", "max_contact_torque"),
        ):
            if not size <= most:
                raise OverloadError(
                    f"the contact is {size:.3g} {unit}; at most {most:g} {unit} is allowed: free "
                    f"the tool, then send the reference again, or raise {name}"
                )

    def refuse_return(self, desired: DesiredFrame, compliant: DesiredFrame) -> None:
        """Raise FollowingError if a wrench is measured again while the frames are far apart."""
        distance = float(np.linalg.norm(compliant.p_d - desired.p_d))
        angle = angle_between(desired.R_d, compliant.R_d)
        if not (distance <= self.max_jump_position and angle <= self.max_jump_rotation):
            raise FollowingError(
                f"the wrench is back, but the compliant frame is {distance:.3f} m, {angle:.3f} rad "
                "from the desired one, to which it would be pulled; at most "
                f"{self.max_jump_position:g} m, {self.max_jump_rotation:g} rad (max_jump_position, "
                "max_jump_rotation) are allowed: send the reference again"
            )


displacement = read = put = slot  # of a representation


class _Numbers(NamedTuple):
    """Largest force [N] and moment [Nm] of a contact; the options of the representation."""

    force: float
    moment: float
    options: Coordinates


_numbers = layout(_Numbers)
_read_numbers, _OF_WRENCH = _numbers.read, _numbers.width


def _sense(
    chain: Rows, q: Input, dq: Input, work: Rows, row: Row, desired: Input, previous: Input,
    w_s: Input, sensor: Row, numbers: Input, memory: Row, before: Input, change: Row, fade: Row,
    swing: Input, watch: Rows, dt: float, sensed: Row,
) -> int:  # fmt: skip
    """Fill the row of an arm, and what it senses; return what the contact does.

    Args:
        chain, q, dq, work, row: see :func:`put_arm`.
        desired: the desired frame, from which the tip is displaced by x_de.
        previous: x_de of the tick before.
        w_s: (6,) what the sensor measures; (0,): nothing.
        sensor: (12,) orientation and origin of its frame, seen from the tip.
        numbers: see :class:`_Numbers`; behind them those of the wrench.
        memory: see :class:`WrenchChain`.
        before: (n,) speeds in the tick before, whose change is the acceleration; or (0,).
        change, fade: blends of w and of h.
        swing: (3,) [N] of the contact that is commanded: that is no oscillation.
        watch: see :func:`observe`.
        dt: [s] after the tick before.
        sensed: is filled with w (6,), h (6,), x_de.
    """
    n, w, h, acceleration, watched = len(q), sensed[:6], sensed[6:12], np.empty(0), np.empty(6)
    tip, felt, found = row[2 * n : 2 * n + TIP], memory[:STATE], memory[STATE:]
    given = _read_numbers(numbers, 0)
    put_arm(chain, q, dq, work, row)
    R_d, R_e = read_frame(desired, 0).R_d, read_tip(row, 2 * n).R_e
    put(sensed, 12, displacement(R_d, R_e, read(previous, 0), given.options))
    if len(w_s) == 0:  # what is not known any more fades away
        felt[6] = 0.0
        w[:] = 0.0
    else:
        if len(before) > 0 and dt > 0.0:
            acceleration, J, bias = np.empty(6), jacobian_in(row, n), dJ_dq(row, n)
            for i in range(6):
                acceleration[i] = bias[i]
                for k in range(n):
                    acceleration[i] += J[i, k] * ((dq[k] - before[k]) / dt)  # J ddq + dJ dq
        R_e, omega_e, of_wrench = tip[3:12].reshape(3, 3), tip[15:18], numbers[_OF_WRENCH:]
        R_s, p_s = sensor[:9].reshape(3, 3), sensor[9:]
        feel(w_s, R_s, p_s, R_e, omega_e, acceleration, dt, of_wrench, felt, found)
        if not (found[6] <= given.force and found[7] <= given.moment):
            return _TOO_LARGE
        w[:] = found[:6]
    blend(change, dt, w)
    kept(change)
    # where it is found again the impedance takes it at once, or K_p p_cd had no counterpart
    h[:] = w
    blend(fade, dt, h)
    kept(fade)
    for i in range(6):
        h[i] = -h[i]
        watched[i] = w[i] + swing[i] if i < 3 else w[i]
    return observe(watched, tip[12:15], tip[15:18], dt, watch)


class ImpedanceControl(Scheme):
    """Impedance control of one arm.

    Before each tick :meth:`sense` says what the force/torque sensor measures.  While nothing is
    measured the compliant frame is at rest, and the motion loop holds it.  :meth:`press` lets the
    tool exert a force, until the scheme restarts, or holds.

    Args:
        motion: follows the compliant frame.
        law: the impedance.
        chain: of the wrench, with its tare; None is a new one.

    Attributes:
        force: that the tool is to exert.
        contact: the energy that it is given, and whether it oscillates.
        damping: how many times that of the law: more where the contact oscillated.
    """

    def __init__(
        self, motion: MotionLoop, law: ImpedanceLaw, chain: WrenchChain | None = None
    ) -> None:
        self.motion, self.law = motion, law
        self.robot = motion.robot
        self.chain = chain or WrenchChain(law.wrench)
        self.chain.replace_options(law.wrench)
        self._compliant = CompliantFrame(law.compliance, law.stiffness_energy)
        self.contact = ContactWatch(*law.watched)
        self.force = ForceControl(law.force)
        self.damping, self._free = 1.0, 0.0
        self._blend = Blend(_BLEND_TIME, 6)  # to a wrench that is made otherwise
        self._fade = Blend(_BLEND_TIME, 6)  # of h, to and from no wrench
        self._sensed: SensedWrench | None = None
        self._sensor, self._sensor_row = AT_ORIGIN, AT_ORIGIN.row
        self.is_frozen, self.loop_rate = True, motion.loop_rate
        self._dq = NONE  # of the tick before
        self._w, self._h = np.zeros(6), np.zeros(6)
        self._balance = np.zeros(6)  # the contact at the last restart
        self.reset(np.zeros(self.robot.n))

    @property
    def bounds(self) -> Bounds:
        """Bounds on the commands of the motion loop."""
        return self.motion.bounds

    def bound(self, joints: JointLimits) -> None:
        """Let the motion loop keep to limits of the joints from the next tick on."""
        self.motion.bound(joints)

    def sense(self, wrench: SensedWrench | None) -> None:
        """Take what the sensor measures for the ticks that follow; None: it is not known."""
        if (wrench is None) != (self._sensed is None) and self._compliant.row is not None:
            self._fade.replace(-self._h)
        self._sensed, self.is_frozen = wrench, wrench is None
        if wrench is not None and wrench.sensor is not self._sensor:
            self._sensor, self._sensor_row = wrench.sensor, wrench.sensor.row

    def press(self, force: Array) -> None:
        """Let the tool exert a force (3,) [N] on the environment, axes of the compliance."""
        if not self.force.is_on:
            self._compliant.rearrange()
        self.force.press(force)

    @property
    def is_pressing(self) -> bool:
        """Whether the tool exerts a force, or is to."""
        return self.force.is_on

    @property
    def is_at_its_end(self) -> bool:
        """Whether the tool is to press, but its frame may not go farther from the desired one."""
        most = _AT_ITS_END * self.law.compliance.bounds.position
        return self.force.is_on and self._reach >= most

    def replace_law(
        self,
        law: ImpedanceLaw,
        motion: ResolvedAcceleration,
        dynamics: InverseDynamics,
        limits: EffortLimits,
    ) -> None:
        """Go over to another law, without a jump of the compliant frame or of the command.

        Raises:
            ConfigurationError: if the posture or the friction has the wrong size, or the axes of a
                force that is exerted change.
        """
        if self.force.is_on and law.force.axes != self.law.force.axes:
            raise ConfigurationError("force_axes cannot change while target_wrench is followed")
        self.motion.replace_law(motion, dynamics, limits)
        self.loop_rate = self.motion.loop_rate
        moved, now = (self.law.centre.inverse, law.centre), self._compliant.law_now
        kept = replace(law.compliance, translation=now.translation, rotation=now.rotation)
        self._compliant.replace_law(kept, moved)
        self._compliant.limit_energy(law.stiffness_energy)
        self._compliant.change_impedance(law.compliance)
        self.contact.expect(*law.watched)
        self.force.options = law.force
        self.damping = 1.0
        if law.compliance.orientation != self.law.compliance.orientation:
            self._x_de = law.compliance.orientation.row(None)  # else it means nothing
        self.chain.replace_options(law.wrench)
        self._blend.replace(self._w)
        self.law = law

    def change_impedance(self, compliance: ComplianceLaw) -> None:
        """Go over to another impedance, as far as there is energy for it.

        Args:
            compliance: with the representation, frame and bounds of the law.
        """
        self.law = replace(self.law, compliance=compliance)
        self.contact.expect_changes()
        self._compliant.change_impedance(compliance.damped(self.damping))

    @property
    def compliance_now(self) -> ComplianceLaw:
        """The equations of the compliant frame now, also while they change."""
        return self._compliant.law_now

    @property
    def changed(self) -> float:
        """How far a change of the impedance is, from 0 to 1."""
        return self._compliant.changed

    @property
    def energy_left(self) -> float:
        """The energy [J] that is left for changes of the impedance."""
        return self._compliant.energy_left

    @property
    def waits(self) -> bool:
        """Whether a change of the impedance waits for energy."""
        return self._compliant.waits

    def tare(self, felt: Array) -> None:
        """Take ``felt`` (6,), a mean of :meth:`WrenchChain.felt`, for no contact from now on."""
        self.chain.tare(felt)
        self._blend.replace(self._w)

    @property
    def fastest_gain(self) -> LoopGain | None:
        """That of the motion loop; the compliant frame takes the steps that it needs."""
        return self.motion.fastest_gain

    @property
    def hold_rate(self) -> float:
        """That of the motion loop."""
        return self.motion.hold_rate

    def skip(self) -> None:
        """Forget the speeds of the tick before, which the acceleration of the tool is made of."""
        self._dq = NONE
        self.motion.skip()

    @property
    def stop_time(self) -> float:
        """That of the compliant frame [s]."""
        return self._compliant.stop_time(self.motion.limits.motion)

    def start_from(self, effort: Array | None) -> None:
        """Begin at the efforts (n,) that the robot reports, if it does."""
        self.motion.start_from(effort)

    def reset(self, q: Array) -> None:
        """Begin at the measured q (n,), the compliant frame where the tip is then."""
        self.motion.reset(q)
        self._restart(q.copy())

    def resume(self, q: Array) -> None:
        """Begin at the measured q (n,), with the efforts as they are."""
        self.motion.resume(q)
        self._restart(q.copy())

    def _restart(self, q: Array) -> None:
        if self._compliant.row is not None:
            self._balance = self._contact(q, np.zeros_like(q))
        self._q = q
        self._forget()

    def _contact(self, q: Array, dq: Array) -> Array:
        """Return the contact wrench (6,) that is felt at the state q, dq (n,)."""
        if self._sensed is None:
            return np.zeros(6)
        self.chain.reset()
        return self.chain.contact(self._sensed, self.robot.state(q, dq), None, 0.0)

    def _forget(self) -> None:
        self._damp(1.0)
        self._compliant.reset()
        self.force.reset()
        self._reach = 0.0
        self.contact.reset()
        self.chain.reset()
        self._blend.reset()
        self._fade.reset()
        self._w, self._h = np.zeros(6), np.zeros(6)
        self._dq = NONE
        self._x_de = self.law.compliance.orientation.row(None)
        self._was_frozen = False
        self._held: DesiredFrame | None = None

    def hold(self, dt: float, q: Array, dq: Array) -> JointCommand:
        """Return what holds the joints, and the tip, where they were when this began."""
        self._q = q
        held = self._held or super().frame_at(q)
        self._forget()
        self._held = held
        self._balance = self._contact(q, dq)
        w = None if self._sensed is None else self._balance
        return self.motion.hold(dt, q, dq, w)._replace(frame=held)

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the command of the motion loop that may stay for good."""
        return self.motion.last_command(q, dq)._replace(frame=super().frame_at(q))

    def frame_at(self, q: Array) -> DesiredFrame:
        """Return the desired frame with which the tip stays at q (n,).

        That is its pose there; after a contact, moved by what balances the contact: p_d = p_e -
        K_p^+ f, and R_d likewise.
        """
        return self._balanced(super().frame_at(q))

    def start_frame(self) -> DesiredFrame:
        """Return the desired frame with which the tip stays where it was measured."""
        return self.frame_at(self._q)

    def _balanced(self, tip: DesiredFrame) -> DesiredFrame:
        if not self._balance.any():
            return tip
        law, frame = self.law.compliance, tip.carrying(self.law.centre)
        f, mu = np.split(at_point(self._balance, frame.p_d - tip.p_d), 2)
        R = np.eye(3) if law.frame == "base" else frame.R_d
        x = R @ (np.linalg.pinv(law.translation.K) @ (R.T @ f))
        turn = frame.R_d @ (np.linalg.pinv(law.rotation.K) @ (frame.R_d.T @ mu))
        desired = DesiredFrame(frame.p_d - x, exp(-turn) @ frame.R_d)
        return desired.carrying(self.law.centre.inverse)

    def tick(self, dt: float, q: Array, dq: Array, frame: DesiredFrame) -> Tick:
        """Return the efforts and the compliant frame for this instant.

        Raises:
            SingularityError: if a law has no finite answer.
            FollowingError: if the tip is too far from the compliant frame.
        """
        desired = frame.row
        motion, law, robot, chain, contact = (
            self.motion, self.law, self.robot, self.chain, self.contact
        )  # fmt: skip
        n, centre, before = robot.n, law.centre, self._x_de
        row, sensed = np.empty(motion.width), np.empty(12 + len(before))
        if len(q) != n or len(dq) != n:
            robot.refuse_size(q, dq)
        w_s = NONE if self._sensed is None else self._sensed.w
        found = law.sense(
            robot.chain, q, dq, motion.work, row, desired, before, w_s, self._sensor_row,
            law.numbers, chain.memory, self._dq, self._blend.row, self._fade.row,
            self.force.swing, contact.state, dt, sensed,
        )  # fmt: skip
        self._q, self._dq, self._held = q, row[n : 2 * n], None
        if found == _TOO_LARGE:
            law.refuse_wrench(chain.force, chain.moment)
        self._w, self._h = w, h = sensed[:6], sensed[6:12]
        if found or self.force.is_on or self.damping > 1.0:
            self._calm(found, dt)
        at_tip = centre is AT_ORIGIN
        compliant = self._comply(dt, row, desired if at_tip else carried_row(desired, law.at))
        compliant = compliant if at_tip else carried_row(compliant, law.back)
        if self.force.is_on:
            h = h + self._ahead(row)
        tau, saturated, excess = motion.efforts(dt, row, compliant, h)  # eq. (48)
        motion.note_contact(dt, row, desired, None if self.is_frozen else w[:3], self.force.is_on)
        command = JointCommand(effort=tau, frame=DesiredFrame.of(compliant))
        # of the tip from the desired frame, not from the compliant one
        self._x_de = sensed[12:]
        x_de = law.compliance.orientation.rows.unpack(self._x_de)
        felt = None if self.is_frozen else w
        return Tick(command, frame, RobotState.of(row, n), x_de, saturated, excess, felt)

    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return V_3 and its derivative, eqs. (68), (69), of the rotation of the centre."""
        frame = tick.command.frame
        if frame is None or tick.wrench is None:
            return None
        law, centre = self.law.compliance, self.law.centre
        desired, compliant = tick.desired.carrying(centre), frame.carrying(centre)
        mu = at_point(tick.wrench, tick.state.R_e @ centre.p)[3:]
        return law.orientation.lyapunov_3(
            desired.R_d.T @ compliant.R_d,
            desired.R_d.T @ (compliant.omega_d - desired.omega_d),
            law.rotation,
            desired.R_d.T @ mu,
        )

    def _calm(self, found: int, dt: float) -> None:
        """Raise the damping where the contact oscillates, until the tool was free for a while.

        Raises:
            ContactError: if that did not end it.
        """
        if found:
            self.contact.look_again()
        bounces = self.force.bounces() or (found and self.damping == 1.0)
        if found == Oscillation.IS_FED or bounces:
            try:
                self._damp(_CALMER * self.damping)
            except ConfigurationError as error:
                raise ContactError(
                    f"the contact oscillates with {self.damping:g} times the damping, too, and "
                    f"more is not possible: {error}"
                ) from error
        elif self.damping > 1.0:
            touches = self.chain.force > self.law.ripple_force
            self._free = 0.0 if touches else self._free + dt
            if self._free > _FREE:
                self._damp(1.0)

    def _damp(self, times: float) -> None:
        """Take so many times the damping of the law from now on, without a jump.

        Raises:
            ConfigurationError: if the impedance cannot have so much.
        """
        if times > _CALMEST:
            raise ConfigurationError(f"at most {_CALMEST:g} times")
        if times != self.damping:
            self._compliant.change_impedance(self.law.compliance.damped(times))
            self.damping, self._free = times, 0.0

    def _ahead(self, row: Array) -> Array:
        """Return by what (6,) the contact is to change until the next tick, about the tip."""
        R_e = RobotState.of(row, self.robot.n).R_e
        ahead = np.concatenate((self.force.ahead, np.zeros(3)))
        return at_point(ahead, -(R_e @ self.law.centre.p))

    def _comply(self, dt: float, row: Array, desired: Array) -> Array:
        """Return the compliant frame of the centre of compliance, for the arm in a row.

        Both frames are rows (24,).
        """
        law, frame, w = self.law, self._compliant, self._w
        is_new, centre = frame.row is None, law.centre
        if self.is_frozen:
            self._was_frozen = not is_new
            self.force.restart()
            frame.freeze(dt, self._actual(row), self.stop_time)
            assert frame.row is not None
            return frame.row
        if self._was_frozen and frame.now is not None:
            law.refuse_return(DesiredFrame.of(desired), frame.now)
        self._was_frozen = False
        if centre is not AT_ORIGIN:
            w = at_point(w, RobotState.of(row, self.robot.n).R_e @ centre.p)
        if is_new or not law.inner_loop:
            frame.begin(DesiredFrame.of(desired), self._actual(row))
            return frame.step_row(0.0, desired, w)
        if not self.force.is_on:
            return frame.step_row(dt, desired, w)
        actual, before, leads = self._actual(row), frame.now, DesiredFrame.of(desired)
        assert before is not None
        drive, rate = self.force.drive(dt, actual, before, leads, w, self.damping)
        now = frame.step_row(dt, desired, drive, partial(self.force.freed, leads.R_d, rate))
        self._reach = float(np.linalg.norm(now[:3] - leads.p_d))
        return now

    def _actual(self, row: Array) -> DesiredFrame:
        """Return the frame of the centre of compliance as it is, of the arm in a row."""
        arm = RobotState.of(row, self.robot.n)
        return DesiredFrame(arm.p_e, arm.R_e, arm.dp_e, arm.omega_e).carrying(self.law.centre)
