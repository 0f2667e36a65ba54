"""Impedance control with an inner motion loop, section V, Fig. 3.

The contact wrench moves a compliant frame away from the desired one by the impedance equations
(52), (55), (59), see :mod:`.compliant_frame`; the motion loop (49), (50), (51) follows it on
inverse dynamics with the wrench compensated, eq. (48), see :mod:`.dynamic_control`.

Notation: ``w`` = (f, mu) (6,) [N, Nm] contact wrench of the environment on the end effector, ``h``
of the end effector on the environment, minus that; base frame, about the tip.
"""

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from eulerparams_control.errors import (
    ConfigurationError,
    ContactError,
    FollowingError,
    OverloadError,
)
from eulerparams_control.laws.blend import Blend
from eulerparams_control.laws.compliant_frame import STOP_TIME, ComplianceLaw, CompliantFrame
from eulerparams_control.laws.contact_watch import ContactWatch, Oscillation
from eulerparams_control.laws.dynamic_control import DynamicControl, NoMotionLoop
from eulerparams_control.laws.force_control import ForceControl
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.orientation import Lyapunov
from eulerparams_control.laws.rotations import Array, angle_between, exp, norm
from eulerparams_control.laws.scheme import Bounds, JointCommand, LoopGain, Scheme, Tick
from eulerparams_control.laws.wrench import SensedWrench, WrenchChain, shifted
from eulerparams_control.motion.frames import AT_ORIGIN, DesiredFrame
from eulerparams_control.robot.robot import DynamicState, Robot, RobotState

if TYPE_CHECKING:
    from eulerparams_control.parameters.impedance_control import ImpedanceParameters

# Time [s] in which the wrench goes over to one that is made otherwise, or lost, or found again.
_BLEND_TIME = 0.1

# The part of its bound that the displacement has reached where it is at its end.
_AT_ITS_END = 0.99

# The longest time constant [s] with which a frozen compliant frame comes to rest, however low the
# accelerations are: what is in its way is not felt.
_LONGEST_STOP = 0.5

# The part of a force that may be across the force axes.
_ACROSS = 0.7072

# Each time that the contact oscillates the damping is multiplied by this, up to so many times that
# of the law, until the tool was free for the time [s].
_CALMER, _CALMEST, _FREE = 3.0, 9.0, 2.0

_NO_WRENCH = np.zeros(6)
_NO_WRENCH.setflags(write=False)


class ImpedanceControl(Scheme):
    """Impedance control of one arm; raises ConfigurationError for impossible parameters.

    Before each tick :meth:`sense` says what the force/torque sensor measures.  While nothing is
    measured the compliant frame is at rest, and the motion loop holds it.

    Attributes:
        law: the impedance equations that were asked for last.
        centre: frame of the compliance seen from the tip.
        compliant: the compliant frame, of the centre.
        damping: how many times that of the law: more where the contact oscillated.
    """

    _dq: Array | None  # of the tick before
    _x_de: Any

    def __init__(
        self, robot: Robot, parameters: "ImpedanceParameters", chain: WrenchChain | None = None
    ) -> None:
        self.robot, self.parameters = robot, parameters
        self.law, self.centre = parameters.compliance_law(), parameters.centre(robot)
        loop = DynamicControl if parameters.commands_joints else NoMotionLoop
        self.motion: DynamicControl | NoMotionLoop = loop(robot, parameters)
        self.chain = chain or WrenchChain(robot, parameters)
        self.chain.change(parameters)
        self.compliant = CompliantFrame(self.law, parameters.stiffness_energy)
        self.contact = ContactWatch(parameters)
        self.force = ForceControl(parameters)
        self.damping, self._free = 1.0, 0.0
        self._blend = Blend(_BLEND_TIME)  # to a wrench that is made otherwise
        self._fade = Blend(_BLEND_TIME)  # of h, to and from no wrench
        self._sensed: SensedWrench | None = None
        self.is_frozen, self.loop_rate = True, self.motion.loop_rate
        self.hold_rate = self.motion.hold_rate
        self._balance = _NO_WRENCH  # the contact at the last restart
        self.reset(np.zeros(robot.n))

    def rehearse(self) -> None:
        """Rehearse with a wrench: without one the compliant frame is frozen."""
        self.sense(SensedWrench(np.zeros(6), AT_ORIGIN))
        super().rehearse()

    def sense(self, wrench: SensedWrench | None) -> None:
        """Take what the sensor measures for the ticks that follow; None: it is not known."""
        if (wrench is None) != (self._sensed is None) and self.compliant.now is not None:
            self._fade.replace(-self._h)
        self._sensed, self.is_frozen = wrench, wrench is None

    def press(self, force: Array) -> None:
        """Let the tool exert a force (3,) [N] on the environment, axes of the compliance.

        It ends where the scheme restarts, or holds.
        """
        if not self.force.is_on:
            self.compliant.rearrange()
        self.force.press(force)

    def exerted_force(self, force: Array, R_d: Array) -> Array:
        """Return a force (3,) [N], axes of the tip, as :meth:`press` takes it, along force_axes.

        Raises ConfigurationError if it cannot be exerted.
        """
        p, on = self.parameters, self.force.selection
        f = self.centre.R.T @ force
        size = norm(f)
        if not p.inner_loop:
            raise ConfigurationError("target_wrench needs the motion loop: set inner_loop: true")
        if norm((1.0 - on) * f) > _ACROSS * size:
            raise ConfigurationError(
                f"target_wrench is {f.tolist()} N along x, y, z of the compliance; expected a "
                f"force along force_axes {list(p.force_axes)}"
            )
        if size > p.max_contact_force:
            raise ConfigurationError(
                f"target_wrench is {size:.3g} N; at most max_contact_force "
                f"{p.max_contact_force:g} N"
            )
        exerted: Array = on * f
        return exerted

    def end_force(self) -> bool:
        """Return whether the arm has to be held: only that ends a force that it exerts."""
        return self.force.is_on

    @property
    def is_pressing(self) -> bool:
        """Whether the tool exerts a force, or is to."""
        return self.force.is_on

    @property
    def is_at_its_end(self) -> bool:
        """Whether the tool is to press, but its frame may not go farther from the desired one."""
        bound = self.parameters.max_displacement_position
        return self.force.is_on and self._reach >= _AT_ITS_END * bound

    def change(self, parameters: "ImpedanceParameters") -> None:
        """Go over to other parameters, without a jump of the compliant frame or of the command.

        Raises ConfigurationError if they are impossible, or force_axes change while a force acts.
        """
        law, centre = parameters.compliance_law(), parameters.centre(self.robot)
        is_same = np.array_equal(parameters.force_selection(), self.force.selection)
        if self.force.is_on and not is_same:
            raise ConfigurationError("force_axes cannot change while target_wrench is followed")
        self.motion.change(parameters)
        self.loop_rate, self.release_rate = self.motion.loop_rate, self.motion.release_rate
        self.compliant.tank = parameters.stiffness_energy
        self.compliant.change(law)
        if (frame := self.compliant.now) is not None:
            self.compliant.begin(None, frame.carrying(self.centre.inverse).carrying(centre))
        if law.orientation != self.law.orientation:
            self._x_de = None  # it means nothing to another representation
        self.parameters, self.law, self.centre = parameters, law, centre
        self.contact.expect(parameters)
        self.force.change(parameters)
        self.chain.change(parameters)
        self.damping = 1.0
        self._blend.replace(self._w)

    def change_impedance(self, law: ComplianceLaw) -> None:
        """Go over to another impedance, of the same representation, frame and bounds."""
        self.compliant.change(law.damped(self.damping))
        self.contact.expect_changes()
        self.law = law

    def tare(self, felt: Array) -> None:
        """Take ``felt`` (6,), a mean of :meth:`WrenchChain.felt`, for no contact from now on."""
        self.chain.tare(felt)
        self._blend.replace(self._w)

    @property
    def stop_time(self) -> float:
        """The time constant [s] of a frozen frame: it brakes by the accelerations of the tip."""
        frame, motion = self.compliant.now, self.parameters.motion_limits()
        if frame is None or motion is None:
            return STOP_TIME
        return max(STOP_TIME, min(motion.stop_time(frame.dp_d, frame.omega_d), _LONGEST_STOP))

    def reset(self, q: Array) -> None:
        """Begin at the measured q (n,), the compliant frame where the tip is then."""
        self.motion.reset(q)
        self._restart(q)

    def resume(self, q: Array) -> None:
        """The same, with the efforts as they are."""
        self.motion.resume(q)
        self._restart(q)

    def _restart(self, q: Array) -> None:
        if self.compliant.now is not None:
            self._balance = self._contact_at(q, np.zeros_like(q))
        self._q, self.release_rate = q.copy(), self.motion.release_rate
        self._forget()

    def _contact_at(self, q: Array, dq: Array) -> Array:
        if self._sensed is None:
            return _NO_WRENCH
        self.chain.reset()
        return self.chain.contact(self._sensed, self.robot.state(q, dq), None, 0.0)

    def _forget(self) -> None:
        self.compliant.reset()  # first: then the damping changes at once
        self._damp(1.0)
        self.force.reset()
        self._reach = 0.0
        self.contact.reset()
        self.chain.reset()
        self._blend.reset()
        self._fade.reset()
        self._w = self._h = _NO_WRENCH
        self._dq = self._x_de = None
        self._was_frozen = False
        self._held: DesiredFrame | None = None

    def hold(self, dt: float, q: Array, dq: Array) -> JointCommand:
        """Return what holds the joints, and the tip, where they were when this began."""
        self._q = q
        held = self._held or super().frame_at(q)
        self._forget()
        self._balance = self._contact_at(q, dq)
        w = None if self._sensed is None else self._balance
        if isinstance(self.motion, NoMotionLoop) and w is not None:
            held = self.motion.retreated(dt, held, self.robot.state(q, dq).dp_e, w)
        self._held = held
        return self.motion.hold(dt, q, dq, w)._replace(frame=held)

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the command of the motion loop that may stay for good."""
        return self.motion.last_command(q, dq)._replace(frame=super().frame_at(q))

    def frame_at(self, q: Array) -> DesiredFrame:
        """Return the desired frame with which the tip stays at q (n,): p_d = p_e - K_p^+ f."""
        tip = super().frame_at(q)
        if not self._balance.any():
            return tip
        law, frame = self.law, tip.carrying(self.centre)
        f, mu = np.split(self._about_centre(self._balance, tip.R_d), 2)
        R = np.eye(3) if law.frame == "base" else frame.R_d
        x = R @ (np.linalg.pinv(law.translation.K) @ (R.T @ f))
        turn = frame.R_d @ (np.linalg.pinv(law.rotation.K) @ (frame.R_d.T @ mu))
        desired = DesiredFrame(frame.p_d - x, exp(-turn) @ frame.R_d)
        return desired.carrying(self.centre.inverse)

    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame) -> Tick:
        """Return the efforts and the compliant frame for this instant.

        Raises:
            SingularityError, FollowingError: as the motion loop does.
            OverloadError: if the contact is larger than allowed.
            ContactError: if the contact oscillates, and no damping helps.
        """
        self.robot.refuse_size(q, dq)
        state = self.robot.dynamic_state(q, dq)
        arm, orientation = state.arm, self.law.orientation
        x_de = orientation.displacement(desired.R_d, arm.R_e, self._x_de)
        w, h = self._feel(dt, state)
        at_centre = self._comply(dt, arm, desired.carrying(self.centre), w)
        compliant = at_centre.carrying(self.centre.inverse)
        if self.force.is_on:  # by which the contact is to change until the next tick, (FC6)
            ahead = np.concatenate((self.force.ahead, np.zeros(3)))
            h = h + shifted(AT_ORIGIN.R, arm.R_e @ self.centre.p, ahead)
        # the compliant frame is desired by the motion loop (49)-(51), which compensates h, (48)
        followed = self.motion.follow(dt, state, compliant, h)
        wrench, force = (None, None) if self.is_frozen else (w, w[:3])
        self.motion.note_contact(dt, arm, desired, force, self.force.is_on)
        self._x_de = x_de  # of the tip from the desired frame, not from the compliant one
        command = followed.command._replace(frame=compliant)
        return Tick(command, desired, arm, x_de, followed.saturated, followed.excess, wrench)

    def _feel(self, dt: float, state: DynamicState) -> tuple[Array, Array]:
        """Return the contact w (6,) and h (6,) that is compensated for it; watch the contact."""
        arm, p = state.arm, self.parameters
        dq_before = self._dq
        self._q, self._dq, self._held = arm.q, arm.dq, None
        if self._sensed is None:  # what is not known any more fades away
            self.chain.reset()
            w = _NO_WRENCH
        else:
            a = None
            if self.chain.tool is not None and dq_before is not None and dt > 0.0:
                a = arm.J @ ((arm.dq - dq_before) / dt) + state.dJ_dq
            w = self.chain.contact(self._sensed, arm, a, dt)
            _refuse_contact(norm(w[:3]), p.max_contact_force, "N", "max_contact_force")
            _refuse_contact(norm(w[3:]), p.max_contact_torque, "Nm", "max_contact_torque")
        w = self._blend(dt, w)
        # A wrench that returns acts on the impedance at once, since it balances K_p p_cd; only its
        # compensation in (48) fades in.
        h = -self._fade(dt, w)
        self._w, self._h = w, h
        watched = w
        if self.force.is_on:  # its swing is commanded: no oscillation
            watched = w + np.concatenate((self.force.swing, np.zeros(3)))
        found = self.contact.take(watched, arm.dp_e, arm.omega_e, dt)
        if found or self.force.is_on or self.damping > 1.0:
            self._calm(found, dt)
        return w, h

    def _calm(self, found: Oscillation, dt: float) -> None:
        """Raise the damping where the contact oscillates, until the tool was free for a while."""
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
            touches = self.is_frozen or norm(self._w[:3]) > self.parameters.max_ripple_force
            self._free = 0.0 if touches else self._free + dt
            if self._free > _FREE:
                self._damp(1.0)

    def _damp(self, times: float) -> None:
        """Take so many times the damping of the law from now on, without a jump."""
        if times > _CALMEST:
            raise ConfigurationError(f"at most {_CALMEST:g} times")
        if times != self.damping:
            self.compliant.change(self.law.damped(times))
            self.damping, self._free = times, 0.0

    def _comply(self, dt: float, arm: RobotState, desired: DesiredFrame, w: Array) -> DesiredFrame:
        """Return the compliant frame of the centre of compliance."""
        frame, is_new = self.compliant, self.compliant.now is None
        if self.is_frozen:
            self._was_frozen = not is_new
            self.force.restart()
            return frame.freeze(dt, self._actual(arm), self.stop_time)
        if self._was_frozen and frame.now is not None:
            self._refuse_return(desired, frame.now)
        self._was_frozen = False
        w = self._about_centre(w, arm.R_e)
        if is_new or not self.parameters.inner_loop:
            frame.begin(desired, self._actual(arm))
            return frame.step(0.0, desired, w)
        if not self.force.is_on:
            return frame.step(dt, desired, w)
        actual, before = self._actual(arm), frame.now
        assert before is not None
        drive, rate = self.force.drive(dt, actual, before, desired, w, self.damping)
        R = actual.R_d if self.law.frame == "base" else desired.R_d.T @ actual.R_d
        now = frame.step(dt, desired, drive, partial(self.force.freed, R, rate), rate)
        self._reach = norm(now.p_d - desired.p_d)
        return now

    def _refuse_return(self, desired: DesiredFrame, compliant: DesiredFrame) -> None:
        """Raise FollowingError if a wrench is measured again while the frames are far apart."""
        p, distance = self.parameters, norm(compliant.p_d - desired.p_d)
        angle = angle_between(desired.R_d, compliant.R_d)
        if not (distance <= p.max_jump_position and angle <= p.max_jump_rotation):
            raise FollowingError(
                f"the wrench is back, but the compliant frame is {distance:.3f} m, {angle:.3f} rad "
                "from the desired one, to which it would be pulled; at most "
                f"{p.max_jump_position:g} m, {p.max_jump_rotation:g} rad (max_jump_position, "
                "max_jump_rotation) are allowed: send the reference again"
            )

    def _about_centre(self, w: Array, R_e: Array) -> Array:
        return w if self.centre is AT_ORIGIN else shifted(AT_ORIGIN.R, -(R_e @ self.centre.p), w)

    def _actual(self, arm: RobotState) -> DesiredFrame:
        return DesiredFrame(arm.p_e, arm.R_e, arm.dp_e, arm.omega_e).carrying(self.centre)

    def stiffness(self, tick: Tick) -> tuple[Array, Array] | None:
        """Return K_p at the centre of compliance; None while there is no compliant frame."""
        frame = tick.command.frame
        if frame is None:
            return None
        K_p = self.compliant.law_now.stiffness(tick.desired.R_d)
        return K_p, frame.carrying(self.centre).p_d

    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return V_3 and its derivative, eqs. (68), (69), of the rotation of the centre."""
        frame = tick.command.frame
        if frame is None or tick.wrench is None:
            return None
        law, centre = self.law, self.centre
        desired, compliant = tick.desired.carrying(centre), frame.carrying(centre)
        mu = self._about_centre(tick.wrench, tick.state.R_e)[3:]
        return law.orientation.lyapunov_3(
            desired.R_d.T @ compliant.R_d,
            desired.R_d.T @ (compliant.omega_d - desired.omega_d),
            self.compliant.law_now.rotation,
            desired.R_d.T @ mu,
        )

    # --- as the motion loop has them; the compliant frame takes the steps that it needs -----------

    @property
    def bounds(self) -> Bounds:
        """Those of the motion loop."""
        return self.motion.bounds

    def bound(self, joints: JointLimits) -> None:
        """Let the motion loop keep to limits of the joints."""
        self.motion.bound(joints)

    @property
    def fastest_gain(self) -> LoopGain | None:
        """That of the motion loop."""
        return self.motion.fastest_gain

    def start_from(self, effort: Array | None) -> None:
        """Begin at the efforts (n,) that the robot reports, if it does."""
        self.motion.start_from(effort)

    def skip(self) -> None:
        """Forget the speeds of the tick before, which accelerations are made of."""
        self._dq = None
        self.motion.skip()


def _refuse_contact(size: float, most: float, unit: str, name: str) -> None:
    if not size <= most:
        raise OverloadError(
            f"the contact is {size:.3g} {unit}; at most {most:g} {unit} is allowed: free "
            f"the tool, then send the reference again, or raise {name}"
        )
