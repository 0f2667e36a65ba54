"""The modes of a controller, what changes them, and the table of transitions."""

from dataclasses import dataclass, replace
from enum import Enum, IntEnum, StrEnum, auto
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import (
    ContactError,
    EulerParamsError,
    FollowingError,
    LoadError,
    OverloadError,
    SingularityError,
    UnsafeCommandError,
)
from eulerparams_control.laws.rotations import Array

# An arm that ran away gets efforts again after it was at rest for this time [s], within this
# distance [rad or m]: it may be at a turning point.  Its speed may be noisy.
_REST_TIME, _SAME_PLACE = 0.2, 2e-3


class Mode(StrEnum):
    """What a controller does."""

    WAITING = "waiting"  # for its first reference; it commands nothing
    HOLDING = "holding"  # the law at a frame at rest
    FOLLOWING = "following"  # the law along a motion
    STOPPED = "stopped"  # the joints are held, because of a fault or when told to
    RELEASING = "releasing"  # gravity compensation, then no efforts: only the brakes act;
    # after a runaway there are none in the stop that follows, either (in simulated time gravity
    # compensation goes on)
    DISTRUSTING = "distrusting"  # no commands: it is not known whose states these are


_STILL = Mode.STOPPED, Mode.RELEASING


class Cause(StrEnum):
    """Why a controller does not do what it was asked for."""

    NONE = ""
    # holding or following otherwise than asked
    NO_STATES = "no_states"  # joint_states have stopped: nothing is commanded
    SILENCE = "silence"  # of joint_states, which are back
    STAMP_JUMP = "stamp_jump"
    COMMAND_SILENCE = "command_silence"  # states came, but had no answer for a while
    STREAM_ENDED = "stream_ended"
    NO_WRENCH = "no_wrench"  # none that is to be believed: the compliant frame is frozen
    WRENCH_RATE_TOO_LOW = "wrench_rate_too_low"  # for wrench_timeout: the same
    WRENCH_STUCK = "wrench_stuck"  # the sensor repeats itself: the same
    FORCE_NOT_REACHED = "force_not_reached"  # no surface within the bound of the displacement
    CONTACT_OSCILLATES = "contact_oscillates"  # damping is raised; where that is not enough, held
    STIFFNESS_WAITS = "stiffness_waits"  # for energy: it would add too much to the arm
    WAITING = "waiting"  # the time of the motion stands, or creeps: the arm does not follow
    # held still
    HALT = "halt"
    DEACTIVATED = "deactivated"  # until the arm is at rest; then nothing is commanded
    REFERENCE_LEAPS = "reference_leaps"  # when it begins
    NEVER_BEGINS = "never_begins"  # set-points come, stamped too far ahead
    SINGULARITY = "singularity"
    NOT_FOLLOWING = "not_following"  # the arm does not follow its commands
    CONTACT_TOO_LARGE = "contact_too_large"  # more than max_contact_force or max_contact_torque
    OVERLOADED = "overloaded"  # by a load, or a push, that the springs of the arm do not hold
    UNSAFE_COMMAND = "unsafe_command"
    ARM_MOVED = "arm_moved"  # before the motion began
    STAMP_STUCK = "stamp_stuck"  # states change, or go on, under one stamp
    FROZEN_ENCODER = "frozen_encoder"
    RUNAWAY = "runaway"
    TWO_PUBLISHERS = "two_publishers"  # of joint_states
    INCOMPATIBLE_QOS = "incompatible_qos"  # of a publisher: nothing of it is received
    MODEL_MISMATCH = "model_mismatch"  # the weight of the arm is not that of the model
    RATE_TOO_LOW = "rate_too_low"  # of joint_states, for the gains or for state_timeout
    DEFECT = "defect"


class Latch(IntEnum):
    """What leads out of a stop; of two stops the one that is harder to leave counts."""

    NONE = 0  # the arm is not stopped
    PAUSE = 1  # a reference after a pause of its source, or ~/resume: after a fault
    RESUME = 2  # ~/resume alone: after a halt, or when the arm ran away
    NEVER = 3  # nothing but deactivate and activate: after a defect, and at the end


class Why(NamedTuple):
    """Why the mode changed."""

    cause: Cause = Cause.NONE
    fault: str = ""  # why the arm is held still, for people; "" if it is not
    remedy: str = ""  # what to do about it
    note: str = ""  # what happened, for people, where the arm is not held still
    at: float = 0.0  # when [s], by the clock of the controller


class ModeEvent(Enum):
    """What changes the mode of a controller."""

    REFERENCE = auto()  # one may be followed
    RESTART = auto()  # of the states, after a silence or a jump of the stamps
    DISTRUST = auto()  # the states jumped to those of another arm
    TRUST = auto()  # they have gone on steadily
    FAULT = auto()
    DEFECT = auto()
    HALT = auto()
    END = auto()  # of control: the arm is brought to rest, and then let alone
    RESUME = auto()
    RUNS_AWAY = auto()
    FROZEN = auto()
    RECOVERED = auto()  # the arm is at rest again, or its positions change again


# The events that stop an arm: the mode they lead to, and what leads out of it.
_STOPS = {
    ModeEvent.FAULT: (Mode.STOPPED, Latch.PAUSE),
    ModeEvent.DEFECT: (Mode.STOPPED, Latch.NEVER),
    ModeEvent.HALT: (Mode.STOPPED, Latch.RESUME),
    ModeEvent.END: (Mode.STOPPED, Latch.NEVER),
    ModeEvent.RUNS_AWAY: (Mode.RELEASING, Latch.RESUME),  # nothing restarts by itself: ISO 10218
    ModeEvent.FROZEN: (Mode.RELEASING, Latch.PAUSE),
}
_ENDS = {event: mode for event, (mode, _) in _STOPS.items()} | {
    ModeEvent.DISTRUST: Mode.DISTRUSTING,
    ModeEvent.REFERENCE: Mode.FOLLOWING,
}

TRANSITIONS: dict[Mode, dict[ModeEvent, Mode]] = {
    Mode.WAITING: {ModeEvent.REFERENCE: Mode.FOLLOWING},
    Mode.HOLDING: _ENDS,
    Mode.FOLLOWING: _ENDS | {ModeEvent.RESTART: Mode.HOLDING},
    Mode.STOPPED: _ENDS | {ModeEvent.RESUME: Mode.HOLDING},
    Mode.RELEASING: {
        ModeEvent.RECOVERED: Mode.STOPPED,
        ModeEvent.DISTRUST: Mode.DISTRUSTING,
        ModeEvent.REFERENCE: Mode.FOLLOWING,  # where the encoders were frozen
    },
    Mode.DISTRUSTING: {ModeEvent.TRUST: Mode.HOLDING},  # or what it held back
}
"""Which mode an event leads to; an event that is not in a row leaves the mode as it is."""


@dataclass
class ModeState:
    """A mode, and what it keeps."""

    mode: Mode
    why: Why = Why()  # noqa: RUF009  it is frozen; of a stop that goes on, when it began
    latch: Latch = Latch.NONE  # what leads out of it, if the arm is stopped
    # of RELEASING: the arm has to come to rest before it is commanded again; of STOPPED: nothing is
    # commanded, for it ran away before
    ran_away: bool = False
    until: float = 0.0  # [s] on the steady clock until when there are no commands; of DISTRUSTING
    inner: "ModeState | None" = None  # the mode that is held back meanwhile
    _place: Array | None = None  # where an arm that ran away rests, and for how long [s]
    _rested: float = 0.0

    @property
    def is_led(self) -> bool:
        """Whether the law alone says what is commanded."""
        return self.mode in (Mode.HOLDING, Mode.FOLLOWING)

    @property
    def is_halted(self) -> bool:
        """Whether the arm is held still instead of moved."""
        return (self.inner or self).mode in _STILL

    @property
    def is_runaway(self) -> bool:
        """Whether the arm runs away, or has not come to rest since."""
        return self.ran_away and (self.inner or self).mode is Mode.RELEASING

    @property
    def remedy(self) -> str:
        """What to do about it."""
        if self.latch is Latch.RESUME and self.why.fault:
            return f"{self.why.remedy}; {CALL_RESUME}"
        return self.why.remedy

    def after(self, event: ModeEvent, why: Why) -> "ModeState":
        """Return the mode after an event, by :data:`TRANSITIONS`."""
        if self.inner is not None:
            if event is ModeEvent.TRUST:
                return self.inner
            if event is ModeEvent.DISTRUST:
                return self.inner.distrusted(why.at)
            return self.inner.after(event, why).distrusted(self.until)
        to, latch = TRANSITIONS[self.mode].get(event, self.mode), self.latch
        if event in (ModeEvent.REFERENCE, ModeEvent.RESUME) and latch is not Latch.NEVER:
            latch = Latch.NONE
        elif event in _STOPS:
            latch = max(latch, _STOPS[event][1])
        if to is Mode.DISTRUSTING:
            return self.distrusted(why.at)
        if to is self.mode is Mode.STOPPED and event not in (ModeEvent.FAULT, ModeEvent.DEFECT):
            return replace(self, latch=latch)
        if self.why.cause is Cause.DEFECT or (to in _STILL and self.is_halted and not why.fault):
            why = self.why
        elif to in _STILL and self.is_halted:
            why = why._replace(at=self.why.at)
        ran_away = to in _STILL and (self.ran_away or event is ModeEvent.RUNS_AWAY)
        if to is self.mode is Mode.RELEASING:
            return replace(self, why=why, latch=latch, ran_away=ran_away)
        return ModeState(to, why, latch, ran_away)

    def distrusted(self, until: float) -> "ModeState":
        """Return the mode that holds back this one until a time [s]."""
        return replace(self, mode=Mode.DISTRUSTING, until=until, inner=self)

    def rests(self, dt: float, q: Array) -> bool:
        """Return whether an arm that ran away has been at rest for long, at q (n,) now."""
        if self._place is None or (np.abs(q - self._place) > _SAME_PLACE).any():
            self._place, self._rested = q, 0.0
        self._rested += dt
        return self._rested > _REST_TIME


_CAUSES = (
    (SingularityError, Cause.SINGULARITY),
    (ContactError, Cause.CONTACT_OSCILLATES),
    (OverloadError, Cause.CONTACT_TOO_LARGE),
    (LoadError, Cause.OVERLOADED),
    (FollowingError, Cause.NOT_FOLLOWING),
    (UnsafeCommandError, Cause.UNSAFE_COMMAND),
)

SEND_AGAIN = "send the reference again"
CALL_RESUME = "call ~/resume"
REPORT_IT = "report it; deactivate and activate to start again"  # a defect

HALTED = Why(Cause.HALT, remedy=CALL_RESUME, note="a halt")
DEACTIVATED = Why(Cause.DEACTIVATED, remedy="activate to start again", note="deactivation")
STAMP_JUMP = Why(Cause.STAMP_JUMP, remedy=SEND_AGAIN)
SILENCE = Why(Cause.SILENCE, remedy=SEND_AGAIN)
COMMAND_SILENCE = Why(Cause.COMMAND_SILENCE, remedy=SEND_AGAIN, note="a silence of its commands")
STREAM_ENDED = Why(Cause.STREAM_ENDED, remedy="see to the node that sends them")
NEVER_BEGINS = Why(
    Cause.NEVER_BEGINS,
    "set-points come, but none begins: their stamps are more than a second ahead of joint_states",
    f"see to the clocks, or stamp them 0; then {SEND_AGAIN}",
)
ARM_MOVED = Why(
    Cause.ARM_MOVED, "the arm moved before the reference began; send it again", SEND_AGAIN
)
FROZEN_ENCODER = Why(
    Cause.FROZEN_ENCODER,
    "joint_states reports speeds, but positions that stay the same to the bit",
    f"see to the robot's driver or encoders, then {SEND_AGAIN}",
)
REFERENCE_LEAPS = Why(
    Cause.REFERENCE_LEAPS,
    remedy="begin where the arm is, or raise max_jump_position and max_jump_rotation",
)
MODEL_MISMATCH = Why(
    Cause.MODEL_MISMATCH,
    remedy="see to gravity, the mount and the effort limits of the URDF, and tool_mass",
)
RUNAWAY = Why(
    Cause.RUNAWAY,
    remedy=f"see to delays and to the model of the arm, or lower the gains; then {CALL_RESUME}",
)
NO_STATES = Why(
    Cause.NO_STATES,
    remedy="see to the robot and the network; when they are back the arm is held where it is",
)
STIFFNESS_WAITS = Why(
    Cause.STIFFNESS_WAITS,
    remedy="bring the desired frame nearer to the arm, or raise stiffness_energy",
    note="the stiffness waits: more of it would add energy to the arm, which is displaced",
)


def waiting(behind: str) -> Why:
    """Return why the time of a motion stands; ``behind``: why the arm does not follow."""
    return Why(
        Cause.WAITING,
        remedy="free the arm if something holds it, or send a nearer or slower reference",
        note=f"the motion waits for the arm: {behind}",
    )


def stuck(fault: str) -> Why:
    """Return why an arm is held whose states have a stamp that stays."""
    remedy = f"let the driver give each state the time at which it was measured; then {SEND_AGAIN}"
    return Why(Cause.STAMP_STUCK, fault, remedy)


def calmed(times: float) -> Why:
    """Return why the damping is so many times that of the parameters."""
    return Why(
        Cause.CONTACT_OSCILLATES,
        remedy=ContactError.remedy,
        note=f"the contact oscillated: {times:g} times the damping until the tool is free",
    )


def contested(names: str) -> Why:
    """Return why an arm is not commanded whose states nodes of these names publish."""
    return Why(
        Cause.TWO_PUBLISHERS,
        f"joint_states of the arm came from two publishers, of {names}; expected one",
        f"end all but the driver of the robot; then {SEND_AGAIN}",
    )


def replaced(names: str) -> Why:
    """Return why an arm is not commanded whose states another publisher sends now."""
    return Why(
        Cause.TWO_PUBLISHERS,
        "of two publishers of joint_states the one is left that was not believed before, of "
        f"{names}",
        "if it is the driver of the robot call ~/resume, else end it and start the driver",
    )


def why_of(error: EulerParamsError) -> Why:
    """Return why an arm is held after an error of its law, or of its command."""
    cause = next(cause for kind, cause in _CAUSES if isinstance(error, kind))
    return Why(cause, str(error), error.remedy)
