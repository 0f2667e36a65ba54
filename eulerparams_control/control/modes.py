"""The modes of a controller as small classes: each owns its data and says what to command.

What they share, the law on its motion, is :class:`Guidance`; what ends efforts that must not act
any more is :class:`Release`.
"""

from typing import ClassVar

import numpy as np

from eulerparams_control.control.guidance import Guidance
from eulerparams_control.control.limiter import Limiter
from eulerparams_control.control.mode import (
    CALL_RESUME,
    Cause,
    Latch,
    Mode,
    ModeEvent,
    Why,
    latched,
    transition,
)
from eulerparams_control.errors import UnsafeCommandError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand, Scheme

# An arm that ran away gets efforts again after it was at rest for this time [s], within this
# distance [rad or m]: it may be at a turning point.  Its speed may be noisy.
_REST_TIME, _SAME_PLACE = 0.2, 2e-3


class Release:
    """Gravity compensation until it is reached; then no efforts at all.

    The robot has to brake itself then, and no effort that was to move the arm acts meanwhile.
    In simulated time they go on: a robot in lock-step does not go on without them.

    Attributes:
        is_reached: whether only gravity compensation acts.
    """

    def __init__(self, limiter: Limiter) -> None:
        self._limiter = limiter
        self.is_reached = False

    def command(
        self, scheme: Scheme, q: Array, dq: Array, acted: float, is_simulated: bool
    ) -> JointCommand | None:
        """Return the next efforts for the state q, dq (n,), ``acted`` [s] after the last ones.

        Raises:
            UnsafeCommandError: if they are not finite.
        """
        limiter = self._limiter
        if not limiter.commands_efforts or (self.is_reached and not is_simulated):
            return None
        bounded = limiter.bounded
        try:
            command = limiter(scheme.last_command(q, dq), q, acted)
        except UnsafeCommandError:
            self.is_reached = True  # what acts is the best there is
            raise
        except Exception:  # a law that has a defect: then there are none
            return None
        self.is_reached = limiter.bounded == bounded
        return command


class ControlMode:
    """A mode.

    Attributes:
        why: why it was entered.
        is_led: whether the law alone says what is commanded.
        is_halted: whether the arm is held still instead of moved.
        is_runaway: whether the arm has to come to rest before it is commanded again.
        latch: what leads out of it, if the arm is stopped.
    """

    mode: ClassVar[Mode]
    is_led = is_halted = is_runaway = False
    latch = Latch.NONE

    def __init__(self, why: Why) -> None:
        self.why = why

    def command(
        self, guidance: Guidance, t: int, dt: float, q: Array, dq: Array
    ) -> JointCommand | None:
        """Return what is to be commanded for the state q, dq (n,) stamped t [ns]; here nothing."""
        return None

    def after(self, event: ModeEvent, why: Why) -> "ControlMode":
        """Return the mode after an event."""
        latch = latched(self.latch, event)
        after = _CLASSES[transition(self.mode, event)].entered(self, event, why)
        after.latch = latch
        return after

    @classmethod
    def entered(cls, before: "ControlMode", event: ModeEvent, why: Why) -> "ControlMode":
        """Return the mode that follows another."""
        return cls(before.why if before.has_defect else why)

    @property
    def is_latched(self) -> bool:
        """Whether nothing leads out of it."""
        return self.latch is Latch.NEVER

    @property
    def has_defect(self) -> bool:
        """Whether a defect is why; whatever comes later, that is what has to be told."""
        return self.why.cause is Cause.DEFECT

    @property
    def remedy(self) -> str:
        """What to do about it."""
        if self.latch is Latch.RESUME and self.why.fault:
            return f"{self.why.remedy}; {CALL_RESUME}"
        return self.why.remedy


class Waiting(ControlMode):
    """Silent until the first reference: others may move the arm until then."""

    mode = Mode.WAITING


class Holding(ControlMode):
    """The law at a frame at rest."""

    mode = Mode.HOLDING
    is_led = True


class Following(ControlMode):
    """The law along a motion; where set-points have stopped, at the last one."""

    mode = Mode.FOLLOWING
    is_led = True


class Stopped(ControlMode):
    """The tip brakes along its path, if the law may; then the joints are held.

    Attributes:
        is_released: whether nothing is commanded: the arm ran away before.
    """

    mode = Mode.STOPPED
    is_halted = True
    is_released = False

    def command(
        self, guidance: Guidance, t: int, dt: float, q: Array, dq: Array
    ) -> JointCommand | None:
        """Return the command of the law while it brakes, then what holds the joints."""
        if self.is_released:
            return None
        if guidance.is_braking:
            return guidance.tick(t, dt, q, dq)
        return guidance.scheme.hold(dt, q, dq)

    @classmethod
    def entered(cls, before: ControlMode, event: ModeEvent, why: Why) -> ControlMode:
        """Return the mode that follows another; it began when the arm was first held."""
        if isinstance(before, Stopped) and event not in (ModeEvent.FAULT, ModeEvent.DEFECT):
            return before
        if before.has_defect or event is ModeEvent.RECOVERED:
            why = before.why
        elif before.is_halted:
            why = why._replace(at=before.why.at)
        after = cls(why)
        after.is_released = before.is_runaway or (
            isinstance(before, Stopped) and before.is_released
        )
        return after


class Releasing(ControlMode):
    """No efforts that are to move the arm: it runs away, or its positions are not measured."""

    mode = Mode.RELEASING
    is_halted = True

    def __init__(self, why: Why, is_runaway: bool = False) -> None:
        super().__init__(why)
        self.is_runaway = is_runaway
        self._place: Array | None = None  # where it rests, and for how long [s]
        self._rested = 0.0

    def rests(self, dt: float, q: Array) -> bool:
        """Return whether the arm has been at rest for long, at q (n,) now."""
        if self._place is None or (np.abs(q - self._place) > _SAME_PLACE).any():
            self._place, self._rested = q, 0.0
        self._rested += dt
        return self._rested > _REST_TIME

    @classmethod
    def entered(cls, before: ControlMode, event: ModeEvent, why: Why) -> ControlMode:
        """Return the mode that follows another; one that goes on keeps what it knows."""
        runs_away = event is ModeEvent.RUNS_AWAY
        if isinstance(before, Releasing):
            before.is_runaway |= runs_away
            if why.fault and not before.has_defect:
                before.why = why._replace(at=before.why.at)
            return before
        if before.has_defect:
            why = before.why
        elif before.is_halted:
            why = why._replace(at=before.why.at)
        return cls(why, runs_away or (isinstance(before, Stopped) and before.is_released))


class Distrusting(ControlMode):
    """States have changed to those of another arm, or clock: silent, so that the robot brakes.

    A simulation that was started again goes on steadily; a second publisher is back at once.

    Attributes:
        until: [s] on the steady clock.
        inner: the mode that is held back.
    """

    mode = Mode.DISTRUSTING

    def __init__(self, until: float, inner: ControlMode) -> None:
        super().__init__(inner.why)
        self.until, self.inner = until, inner
        self.is_halted, self.is_runaway = inner.is_halted, inner.is_runaway
        self.latch = inner.latch

    def after(self, event: ModeEvent, why: Why) -> ControlMode:
        """Return the mode that was held back, or go on holding back what follows it."""
        if transition(self.mode, event) is not self.mode:
            return self.inner
        if event is ModeEvent.DISTRUST:
            return self.entered(self.inner, event, why)
        return Distrusting(self.until, self.inner.after(event, why))

    @classmethod
    def entered(cls, before: ControlMode, event: ModeEvent, why: Why) -> ControlMode:
        """Return the mode that holds back another until ``why.at`` [s]."""
        return cls(why.at, before)


_CLASSES: dict[Mode, type[ControlMode]] = {
    one.mode: one for one in (Waiting, Holding, Following, Stopped, Releasing, Distrusting)
}
