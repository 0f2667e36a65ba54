"""The modes of a controller, what changes them, and the table of transitions."""

from enum import Enum, StrEnum, auto
from typing import NamedTuple

from eulerparams_control.errors import (
    EulerParamsError,
    FollowingError,
    SingularityError,
    UnsafeCommandError,
)


class Mode(StrEnum):
    """What a controller does."""

    WAITING = "waiting"  # for its first reference; it commands nothing
    HOLDING = "holding"  # the law at a frame at rest
    FOLLOWING = "following"  # the law along a motion
    STOPPED = "stopped"  # the joints are held, because of a fault or when told to
    RELEASING = "releasing"  # gravity compensation, then no efforts: only the brakes act
    DISTRUSTING = "distrusting"  # no commands: it is not known whose states these are


class Cause(StrEnum):
    """Why a controller does not do what it was asked for."""

    NONE = ""
    # holding or following otherwise than asked
    NO_STATES = "no_states"  # joint_states have stopped: nothing is commanded
    SILENCE = "silence"  # of joint_states, which are back
    STAMP_JUMP = "stamp_jump"
    COMMAND_SILENCE = "command_silence"  # states came, but had no answer for a while
    STREAM_ENDED = "stream_ended"
    # held still
    HALT = "halt"
    SINGULARITY = "singularity"
    NOT_FOLLOWING = "not_following"  # the arm does not follow its commands
    UNSAFE_COMMAND = "unsafe_command"
    ARM_MOVED = "arm_moved"  # before the motion began
    STAMP_STUCK = "stamp_stuck"  # states change, or go on, under one stamp
    FROZEN_ENCODER = "frozen_encoder"
    RUNAWAY = "runaway"
    DEFECT = "defect"


class Why(NamedTuple):
    """Why the mode changed.

    Attributes:
        cause: for programs.
        fault: why the arm is held still, for people; "" if it is not.
        remedy: what to do about it.
        note: what happened, for people, where the arm is not held still.
        at: when [s], by the clock of the controller.
    """

    cause: Cause = Cause.NONE
    fault: str = ""
    remedy: str = ""
    note: str = ""
    at: float = 0.0


class ModeEvent(Enum):
    """What changes the mode of a controller."""

    REFERENCE = auto()  # one may be followed
    RESTART = auto()  # of the states, after a silence or a jump of the stamps
    DISTRUST = auto()  # the states jumped to those of another arm
    TRUST = auto()  # they have gone on steadily
    FAULT = auto()
    DEFECT = auto()
    HALT = auto()
    RUNS_AWAY = auto()
    FROZEN = auto()
    RECOVERED = auto()  # the arm is at rest again, or its positions change again


_ENDS = {
    ModeEvent.FAULT: Mode.STOPPED,
    ModeEvent.DEFECT: Mode.STOPPED,
    ModeEvent.HALT: Mode.STOPPED,
    ModeEvent.RUNS_AWAY: Mode.RELEASING,
    ModeEvent.FROZEN: Mode.RELEASING,
    ModeEvent.DISTRUST: Mode.DISTRUSTING,
    ModeEvent.REFERENCE: Mode.FOLLOWING,
}

TRANSITIONS: dict[Mode, dict[ModeEvent, Mode]] = {
    Mode.WAITING: {ModeEvent.REFERENCE: Mode.FOLLOWING},
    Mode.HOLDING: _ENDS,
    Mode.FOLLOWING: _ENDS | {ModeEvent.RESTART: Mode.HOLDING},
    Mode.STOPPED: _ENDS,
    Mode.RELEASING: {
        ModeEvent.RECOVERED: Mode.STOPPED,
        ModeEvent.DISTRUST: Mode.DISTRUSTING,
        ModeEvent.REFERENCE: Mode.FOLLOWING,  # where the encoders were frozen
    },
    Mode.DISTRUSTING: {ModeEvent.TRUST: Mode.HOLDING},  # or what it held back
}
"""Which mode an event leads to; an event that is not in a row leaves the mode as it is."""


def transition(mode: Mode, event: ModeEvent) -> Mode:
    """Return the mode after an event."""
    return TRANSITIONS[mode].get(event, mode)


AGAIN = "send the reference again"

REPORT_IT = "report it; deactivate and activate to begin anew"
"""What to do about a defect."""

ARM_MOVED = Why(
    Cause.ARM_MOVED, "the arm moved before the reference began; send it again", AGAIN
)
FROZEN_ENCODER = Why(
    Cause.FROZEN_ENCODER,
    "joint_states reports speeds, but positions that stay the same to the bit",
    f"see to the robot's driver or encoders, then {AGAIN}",
)
SILENT = Why(Cause.COMMAND_SILENCE, remedy=AGAIN, note="a silence of its commands")


def stuck(fault: str) -> Why:
    """Return why an arm is held whose states have a stamp that stays."""
    return Why(Cause.STAMP_STUCK, fault, AGAIN)


def runs_away(joint: str, speed: float) -> Why:
    """Return why an arm is let go that runs away."""
    return Why(
        Cause.RUNAWAY,
        f"the arm runs away, {joint} at {speed:.3g} rad/s: no commands until it stands",
        f"see to delays and to the model of the arm, or lower the gains; then {AGAIN}",
    )


def why_of(error: EulerParamsError) -> Why:
    """Return why an arm is held after an error of its law, or of its command."""
    causes = (
        (SingularityError, Cause.SINGULARITY),
        (FollowingError, Cause.NOT_FOLLOWING),
        (UnsafeCommandError, Cause.UNSAFE_COMMAND),
    )
    cause = next(cause for kind, cause in causes if isinstance(error, kind))
    return Why(cause, str(error), error.remedy)


def restarted(dt: float, silence: float, has_jumped: bool) -> Why:
    """Return why an arm is held after its stamps jumped by dt [s], or a silence [s]."""
    if has_jumped:
        return Why(Cause.STAMP_JUMP, remedy=AGAIN, note=f"a jump of the stamps by {dt:.3g} s")
    note = f"a silence of joint_states of {silence:.3g} s"
    return Why(Cause.SILENCE, remedy=AGAIN, note=note)
