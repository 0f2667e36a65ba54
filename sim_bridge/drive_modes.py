"""The modes of a simulated robot: their causes, their transitions, its policy."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum


class DriveMode(StrEnum):
    """What the robot does."""

    STANDBY = "standby"  # braked, until the first command
    OBEYING = "obeying"
    BRAKED = "braked"  # until the next command
    STOPPING = "stopping"  # braked, and refuses commands until it is at rest, or unlocked
    CONTESTED = "contested"  # braked, and refuses the commands of several controllers
    ENDED = "ended"  # braked for good


class DriveCause(StrEnum):
    """Why it does that."""

    NONE = ""
    CLIPPED = "clipped"
    REJECTED = "rejected"
    SILENCE = "silence"
    PROTECTIVE_STOP = "protective_stop"
    ACCELERATION = "acceleration"  # asked for too much: a protective stop, until it is unlocked
    CONTESTED = "contested"
    CONTEST_OVER = "contest_over"
    SHUTDOWN = "shutdown"
    FINISHED = "finished"
    DIVERGED = "diverged"
    STALLED = "stalled"


class DriveEvent(StrEnum):
    """What changes the mode."""

    COMMAND = "command"
    SILENCE = "silence"
    VIOLATION = "violation"
    STANDSTILL = "standstill"
    CONTEST = "contest"
    SETTLED = "settled"
    END = "end"


class OnSilence(StrEnum):
    """What it does without commands."""

    BRAKE = "brake"
    HOLD_LAST = "hold_last"  # the last command acts for ever


class DriveReply(StrEnum):
    """What becomes of a command."""

    TAKEN = "taken"
    REFUSED = "refused"  # it is good, but must not act now
    REJECTED = "rejected"  # it cannot be used
    UNASKED = "unasked"  # in lock-step: it does not answer the present state


_M, _E = DriveMode, DriveEvent
_FROM_ANY = {_E.VIOLATION: _M.STOPPING, _E.CONTEST: _M.CONTESTED, _E.END: _M.ENDED}
TRANSITIONS: dict[DriveMode, dict[DriveEvent, DriveMode]] = {
    _M.STANDBY: {_E.COMMAND: _M.OBEYING, **_FROM_ANY},
    _M.OBEYING: {_E.SILENCE: _M.BRAKED, **_FROM_ANY},
    _M.BRAKED: {_E.COMMAND: _M.OBEYING, **_FROM_ANY},
    # who sends is judged again when it is at rest
    _M.STOPPING: {_E.STANDSTILL: _M.BRAKED, _E.VIOLATION: _M.STOPPING, _E.END: _M.ENDED},
    _M.CONTESTED: {_E.SETTLED: _M.BRAKED, **_FROM_ANY},
    _M.ENDED: {},
}
"""The mode after each event that matters in a mode; the others change nothing."""


@dataclass(frozen=True)
class DriveStatus:
    """What the robot does, why, and since when.

    Attributes:
        mode, cause: for programs.
        since: when it began to obey, or ceased to [s].
        violation: which joint made it stop.
        clipped: the first command of several that were cut to a limit.
        rejected: why commands cannot be used that come while it is braked.
        names: of the nodes that publish commands, where they are several.
        text: why it ended.
    """

    mode: DriveMode
    cause: DriveCause = DriveCause.NONE
    since: float = 0.0
    violation: str = ""
    clipped: str = ""
    rejected: str = ""
    names: tuple[str, ...] = ()
    text: str = ""


@dataclass(frozen=True)
class DrivePolicy:
    """How patient the robot is.

    Attributes:
        command_timeout: it brakes when it has had no command for longer [s].
        command_delay: steps until a command acts.
        push_timeout: how long a push lasts that is not repeated [s].
        changes_at_once: whether a new controller is obeyed without waiting for the silence of
            the one before.
        on_silence: what it does when it has had no command for longer than command_timeout.
        max_joint_acceleration: [rad/s^2] that commands in position control may ask for, one, or
            one a joint; 0 or empty: any.  See :mod:`sim_bridge.acceleration`.
    """

    command_timeout: float = 0.1
    command_delay: int = 0
    push_timeout: float = math.inf
    changes_at_once: bool = False
    on_silence: OnSilence = OnSilence.BRAKE
    max_joint_acceleration: Sequence[float] = ()
