"""What is asked of the arm: to follow a motion, to stop, to go on."""

from eulerparams_control.control.acting import Acting
from eulerparams_control.control.admission import Admission
from eulerparams_control.control.guidance import Guidance
from eulerparams_control.control.mode import DEACTIVATED, HALTED, Latch, Mode, ModeEvent, Why
from eulerparams_control.control.supervisor import Supervisor
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import Goal, Jog
from eulerparams_control.motion.shaper import Reference
from eulerparams_control.motion.spline import Poses


class Orders:
    """Takes orders, from the next state on.

    Args:
        admission, supervisor, guidance: of the controller.
        acting: what acts on the arm.
        target_timeout: [s] for which a twist goes on without a successor.
    """

    def __init__(
        self,
        admission: Admission,
        supervisor: Supervisor,
        guidance: Guidance,
        acting: Acting,
        target_timeout: float,
    ) -> None:
        self._clock, self._supervisor, self._guidance = admission.clock, supervisor, guidance
        self._acting, self._target_timeout = acting, target_timeout

    def follow(self, motion: Reference, start: int | None, now: float | None = None) -> None:
        """Follow a motion from the stamp ``start`` [ns], or from the next state if None.

        Args:
            motion: what to follow.
            start: stamp [ns].
            now: when it came, steady clock [s]; None: time goes by the stamps alone.

        Raises:
            InvalidMessageError: if it is too far from the present desired frame, not finite, one
                of a stream that went on through a fault, or if the arm must not move now.
        """
        supervisor, guidance, q = self._supervisor, self._guidance, self._acting.q
        clock, desired, references = self._clock, guidance.motion, supervisor.references
        references.refuse_after_fault(supervisor.mode, clock.time(now))
        if supervisor.rate.is_too_low:
            raise InvalidMessageError(f"{supervisor.rate.why.fault}; {supervisor.rate.why.remedy}")
        if isinstance(motion, Poses) and not motion.is_timed and desired.limits is None:
            raise InvalidMessageError(
                "the reference has no times, and the tip has no limits that say how fast it goes; "
                "give each point a time_from_start"
            )
        was_halted = supervisor.mode.is_halted
        here = guidance.scheme.frame_at(q) if was_halted else desired.expected
        if guidance.is_braking and was_halted:
            raise InvalidMessageError("the arm brakes; send it when it is at rest")
        if isinstance(motion, (Goal, Jog)):
            references.refuse_target(motion, here)
        else:
            references.refuse_jump(motion, clock.late(start), here)
        if was_halted:  # only now: what is refused does not move what is held
            guidance.scheme.resume(q)
            desired.hold(here)
        elif guidance.is_braking and clock.last is not None:
            guidance.release(clock.last.stamp)
        desired.follow(motion, start)
        supervisor.change(ModeEvent.REFERENCE)

    def aim(self, frame: DesiredFrame, now: float | None = None) -> None:
        """Go to a pose, as fast as the limits allow; a stream of poses is followed as it comes.

        Raises:
            InvalidMessageError: see :meth:`follow`.
        """
        self.follow(Goal(frame), None, now)

    def jog(self, twist: Array, now: float | None = None) -> None:
        """Move with a twist (6,) [m/s, rad/s] of the tip, base frame, for ``target_timeout``.

        Raises:
            InvalidMessageError: see :meth:`follow`.
        """
        self.follow(Jog(twist, self._target_timeout), None, now)

    def settle(self, why: Why) -> None:
        """Hold the pose measured last, in a contact as it is, while the last command acts."""
        self._supervisor.begin(self._acting.q, acts=True)
        self._supervisor.change(ModeEvent.RESTART, why)

    def halt(self) -> None:
        """Hold until :meth:`resume`; command nothing now."""
        self._supervisor.change(ModeEvent.HALT, HALTED)

    def end(self) -> None:
        """Hold for good: after this nothing will be commanded."""
        self._supervisor.change(ModeEvent.END, DEACTIVATED)

    def resume(self) -> None:
        """Hold the measured pose, ready to follow; if the arm was stopped.

        Raises:
            InvalidMessageError: after a defect, while the arm runs away, or while it moves.
        """
        mode = self._supervisor.mode
        if mode.latch is Latch.NONE:
            return
        held = f"the arm is held ({mode.why.fault or mode.why.cause})"
        if mode.is_latched or mode.mode not in (Mode.STOPPED, Mode.WAITING):
            raise InvalidMessageError(f"not resumed: {held}; {mode.remedy}")
        if mode.mode is Mode.STOPPED:
            if not self._acting.is_at_rest:
                raise InvalidMessageError(f"not resumed: {held}, and moves; ask when it is at rest")
            acts = self._acting.command is not None
            self._supervisor.begin(self._acting.q, acts=acts)
            if not acts:
                self._guidance.scheme.start_from(None)
                self._supervisor.left = None  # the silence is over: what is sent now is followed
        self._supervisor.change(ModeEvent.RESUME)
