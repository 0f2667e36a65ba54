"""Record of a sequence: the messages on the wire, and the motion of the arm itself.

Times ``t`` are seconds of the sequence, on the clock that never jumps; stamps are what the
messages say.
"""

import hashlib
import math
import struct
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import NamedTuple

from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.robot.robot import Robot

Values = tuple[float, ...]
Span = tuple[float, float]
"""From when to when [s]."""

OK, WARN, ERROR = range(3)
"""Levels of a diagnostic status."""

STARTS, KILLED = "the controller starts", "the controller is killed"
STOPS = "the robot makes a protective stop"
"""Events."""


class Command(NamedTuple):
    """A command as it was published.

    Attributes:
        t: [s] when.
        life: the number of the controller's start; each has no memory of the one before.
        stamp: [s] of the state that it answers.
        names: of the joints.
        q, dq, effort: [rad], [rad/s], [Nm]; empty where it has none.
    """

    t: float
    life: int
    stamp: float
    names: tuple[str, ...]
    q: Values = ()
    dq: Values = ()
    effort: Values = ()


class State(NamedTuple):
    """A message of joint_states as it came to the controller.

    Attributes:
        t: [s] when it was delivered.
        stamp: [s] of its header.
        q, dq: (n,) [rad], [rad/s]; empty where it cannot be read.
    """

    t: float
    stamp: float
    q: Values
    dq: Values

    @property
    def is_valid(self) -> bool:
        """Whether it can be read."""
        return bool(self.q)


class Truth(NamedTuple):
    """Where the arm really is: q, dq (n,) at the time t [s]."""

    t: float
    q: Values
    dq: Values


class Said(NamedTuple):
    """Status of the controller: its level and its words, its mode and why."""

    t: float
    level: int
    message: str
    mode: str = ""
    cause: str = ""

    @property
    def is_holding(self) -> bool:
        """Whether it says that it moves nothing, because of a fault."""
        is_still = self.mode in (Mode.STOPPED, Mode.RELEASING)
        return self.level == ERROR and is_still and self.cause != Cause.NO_STATES


class SequenceEvent(NamedTuple):
    """Event: something done to the controller, or by its user."""

    t: float
    what: str


@dataclass(frozen=True)
class AskedLimits(MotionLimits):
    """Limits that commands must keep, as the parameters ``max_...`` of a controller say; inf: none.

    Attributes:
        joint_acceleration: one, or one a joint [rad/s^2].
    """

    joint_acceleration: tuple[float, ...] = (math.inf,)


@dataclass
class SequenceRecord:
    """Everything observed in a sequence.

    Attributes:
        model: of the arm.
        max_effort_rate: [Nm/s].
        state_timeout: [s] after which a controller has to be silent.
        period: [s] of joint_states.
        end: [s] of the sequence.
        commands, states, truth, said, events: in the order of their times.
        contact: [N], [Nm] that may be felt along each axis.
        shaken: when a fault moves the arm, or what is measured of it.
        disturbed: when it is moved although nothing is measured.
        tip_error: [m], [deg] between the tip at the end and where it was sent at last.
        crash: how the controller ended that was not to end; "" if it did not.
        asked: limits that commands must keep; None where that is not judged.
    """

    model: Robot
    max_effort_rate: float
    state_timeout: float
    period: float
    end: float = 0.0
    commands: list[Command] = field(default_factory=list)
    states: list[State] = field(default_factory=list)
    truth: list[Truth] = field(default_factory=list)
    said: list[Said] = field(default_factory=list)
    events: list[SequenceEvent] = field(default_factory=list)
    contact: tuple[float, float] = (0.0, 0.0)
    shaken: list[Span] = field(default_factory=list)
    disturbed: list[Span] = field(default_factory=list)
    tip_error: tuple[float, float] = (0.0, 0.0)
    crash: str = ""
    asked: AskedLimits | None = None

    @property
    def joints(self) -> tuple[str, ...]:
        """Their names, base to tip."""
        return tuple(self.model.joints)

    @property
    def limits(self) -> JointLimits:
        """Limits of the URDF."""
        return self.model.limits

    def lives(self) -> list[Span]:
        """Return from when to when [s] the controller was there."""
        starts = [event.t for event in self.events if event.what == STARTS]
        ends = [event.t for event in self.events if event.what == KILLED]
        return list(zip_longest(starts, ends, fillvalue=self.end))

    def digest(self) -> str:
        """Return a hash of all commands, to the bit."""
        digest = hashlib.sha256()
        for command in self.commands:
            values = (*command.q, *command.dq, *command.effort)
            digest.update(",".join(command.names).encode())
            digest.update(struct.pack("<did", command.t, command.life, command.stamp))
            digest.update(struct.pack(f"<{len(values)}d", *values))
        return digest.hexdigest()
