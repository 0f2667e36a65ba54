"""The drive of a robot: it obeys, brakes, stops, refuses commands, and says why.

The one policy of the simulated robot, free of ROS and of clocks: the bridge and the
tests drive it by ``reset``, ``command``, ``step`` and ``close``.  Every time ``now`` [s] is
given: of the steady clock in real time, of the simulation in lock-step.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eulerparams_control.errors import InvalidMessageError, SimulationError
from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.ros.senders import Senders
from sim_bridge.acceleration import CommandAcceleration
from sim_bridge.command_source import StampOrder
from sim_bridge.commands import Command, CommandInput
from sim_bridge.drive_modes import (
    TRANSITIONS,
    DriveCause,
    DriveEvent,
    DriveMode,
    DrivePolicy,
    DriveReply,
    DriveStatus,
    OnSilence,
)
from sim_bridge.parameters import each_joint
from sim_bridge.simulator import Simulator, SimulatorState

# Older stamps are refused for this part of the timeout of commands, and for this time [s] at most:
# a clock that restarts is believed before silence brakes the robot.
_OF_TIMEOUT, _LONGEST_MEMORY = 0.3, 1.0

# Silence [s] after which one of two controllers has gone.
_QUIET = 5.0

# Longest reason of a rejection that is shown [characters].
_LONGEST_REASON = 300

# Of sums of times [s].
_ROUNDING = 1e-9

# These events find the robot braked already, and what was rejected is still worth knowing.
_RELEASES = (DriveEvent.STANDSTILL, DriveEvent.SETTLED)

COUNTED = REJECTED, CLIPPED, LATE, OTHER, IN_STOP, STOPS, GIVEN_UP = (
    *("commands rejected", "commands clipped", "commands out of order"),
    *("commands of a second controller", "commands refused in a stop"),
    *("protective stops", "steps given up"),
)
"""Keys on /diagnostics of what is counted."""

PUSHES_OVER = "external_wrench timed out"


class Drive:
    """A simulated robot and its policy.

    Args:
        simulator: the robot, braked.
        policy: how patient it is.
        on_change: called with each new status.
        publishers: returns the names of the nodes that publish commands, one a publisher.

    Attributes:
        status: what it does.
        state: what its sensors measure.
        values: counters and texts, by their keys on /diagnostics.
        rejection: why the last command was rejected, if none was taken after it.
        topic: of the commands.

    Raises:
        ConfigurationError: if max_joint_acceleration is neither empty, nor one number, nor n.
    """

    def __init__(
        self,
        simulator: Simulator,
        policy: DrivePolicy,
        on_change: Callable[[DriveStatus], None] = lambda _: None,
        publishers: Callable[[], Sequence[str]] = tuple,
    ) -> None:
        self._simulator, self._policy = simulator, policy
        self._on_change, self._publishers = on_change, publishers
        self._reader = CommandInput(simulator.robot.joints, simulator.parameters.control)
        position = simulator.parameters.control == "position"
        self._act: Callable[..., None] = (
            simulator.command_position if position else simulator.command_effort
        )
        self._acceleration = _acceleration(simulator, policy) if position else None
        self.topic = self._reader.topic
        self.values: dict[str, str | int | float] = dict.fromkeys(COUNTED, 0)
        self._begin(0.0)

    def reset(self, q0: ArrayLike | None = None, now: float = 0.0) -> SimulatorState:
        """Stand by at ``q0`` (n,) [rad], default the home; return the state there."""
        self._simulator.reset(q0)
        self._begin(now)
        return self.state

    def _begin(self, now: float) -> None:
        timeout = self._policy.command_timeout
        self._senders = Senders(timeout, _QUIET, at_once=self._policy.changes_at_once)
        self._order = StampOrder(min(_OF_TIMEOUT * timeout, _LONGEST_MEMORY))
        self._forget_commands()
        self._heard = now  # when the last command was taken
        self._push_end = math.inf
        self._clipped = ""  # the last command clipped since the last review
        self.rejection: InvalidMessageError | None = None
        self.status = DriveStatus(DriveMode.STANDBY, since=now)
        self.state = self._simulator.read()

    def _forget_commands(self) -> None:
        """Let the next command be the first one."""
        self._delayed: deque[tuple[Command, int]] = deque()  # with their stamps [ns]
        self._acting: tuple[Command, int] | None = None  # since the last step
        if self._acceleration is not None:
            self._acceleration.rest()

    # --- commands ----------------------------------------------------------------------

    def hear(self, number: int, now: float) -> bool:
        """Note who sent a message by its number; return whether to heed the sender."""
        accepted = self._senders.hear(number, now)
        if self._senders.contested != (self.status.mode is DriveMode.CONTESTED):
            self._judge(now)
        return accepted

    def command(self, msg: Any, number: int, now: float) -> DriveReply:
        """Take a command, or not.

        Args:
            msg: names, positions and velocities, or efforts of the joints.
            number: of the message among those of its publisher.
            now: when it came.
        """
        accepted = self.hear(number, now)
        try:
            command = self._reader.from_ros(msg)
        except InvalidMessageError as error:
            self.rejection = error
            self.values["last command rejected"] = self._reason()
            self.count(REJECTED)
            return DriveReply.REJECTED
        stamp = ns_from_ros(msg.header.stamp)
        if not self._may_take(stamp, now, accepted=accepted):
            return DriveReply.REFUSED
        self._heard, self.rejection = now, None
        self._go(DriveEvent.COMMAND, now)
        self._delayed.append((command, stamp))
        if len(self._delayed) > self._policy.command_delay:
            self._acting = acting, _ = self._delayed.popleft()
            self._act(*acting)
            if self._simulator.clipped is not None:
                self._clip(str(self._simulator.clipped))
        return DriveReply.TAKEN

    def _may_take(self, stamp: int, now: float, *, accepted: bool) -> bool:
        """Whether a good command may act; count it if not."""
        if not accepted:
            self.count(OTHER)
        elif self.status.mode in (DriveMode.STOPPING, DriveMode.ENDED):
            self.count(IN_STOP)
        elif self._order.is_late(stamp, now):
            self.count(LATE)
        else:
            return True
        return False

    def _clip(self, text: str) -> None:
        """Warn of a command that was cut to a limit, once while it goes on."""
        self._clipped = text
        self.count(CLIPPED)
        if self.status.cause is not DriveCause.CLIPPED:
            self.values["last command clipped"] = text
            self._set(replace(self.status, cause=DriveCause.CLIPPED, clipped=text))

    def push(self, wrench: ArrayLike | None, since: float = math.inf) -> None:
        """Push the tool with ``wrench`` (6,) [N, Nm] as of ``since`` [s]; None ends it."""
        self._simulator.set_external_wrench(wrench)
        self._push_end = since + self._policy.push_timeout

    # --- time --------------------------------------------------------------------------

    def step(self, now: float) -> SimulatorState:
        """Go on by one step of the simulation; return the state after it.

        Raises:
            SimulationError: if the state is not finite any more.
        """
        is_silent = now - self._heard > self._policy.command_timeout
        if is_silent and self._policy.on_silence is OnSilence.BRAKE:
            self._go(DriveEvent.SILENCE, now, DriveCause.SILENCE)
        self._judge_acceleration(now)
        if now >= self._push_end - _ROUNDING:
            self.push(None)
            self.count(PUSHES_OVER)
        try:
            self._simulator.step()
        except SimulationError as error:
            self.end(now, DriveCause.DIVERGED, str(error))
            raise
        self.state = self._simulator.read()
        if violation := self._simulator.violation:
            self.count(STOPS)
            if not self._is_locked:
                cause = DriveCause.PROTECTIVE_STOP
                self._go(DriveEvent.VIOLATION, now, cause, violation=violation)
            if not self._simulator.is_pushed:
                self._push_end = math.inf
        elif self.status.mode is DriveMode.STOPPING and self.is_standing and not self._is_locked:
            self._release(now)
        return self.state

    def _judge_acceleration(self, now: float) -> None:
        """Stop if the command that acts in this step asks for too much after that of the last."""
        if self._acceleration is None or self._acting is None:
            return
        ((q, dq), stamp), self._acting = self._acting, None
        if sudden := self._acceleration.judge(q, dq, stamp, now, self.state.q):
            self.count(STOPS)
            self._go(DriveEvent.VIOLATION, now, DriveCause.ACCELERATION, violation=sudden)

    @property
    def _is_locked(self) -> bool:
        """Whether it does not leave a stop by itself."""
        status = self.status
        return status.mode is DriveMode.STOPPING and status.cause is DriveCause.ACCELERATION

    def unlock(self, now: float) -> bool:
        """Leave a protective stop at rest; return whether the next command may be taken now."""
        if self.is_standing:
            self._release(now)
        return self.status.mode in (DriveMode.STANDBY, DriveMode.OBEYING, DriveMode.BRAKED)

    def _release(self, now: float) -> None:
        """Be at rest: a stop is over."""
        cause, violation = self.status.cause, self.status.violation
        self._go(DriveEvent.STANDSTILL, now, cause, violation=violation)

    def review(self, now: float) -> None:
        """Bring the status up to date, once a second."""
        self._senders.review(now)
        self._senders.see(self._publishers())
        self._judge(now)
        status, is_obeying = self.status, self.status.mode is DriveMode.OBEYING
        self.values["braked for [s]"] = 0.0 if is_obeying else now - status.since
        if status.cause is DriveCause.CLIPPED:
            self.values["last command clipped"] = self._clipped
            if not self._clipped:
                self._set(replace(status, cause=DriveCause.NONE, clipped=""))
        self._clipped = ""
        if self.rejection and not is_obeying and status.mode is not DriveMode.ENDED:
            cause = status.cause or DriveCause.REJECTED
            self._set(replace(self.status, cause=cause, rejected=self._reason()))

    def end(self, now: float, cause: DriveCause, text: str = "") -> None:
        """Brake for good."""
        self._go(DriveEvent.END, now, cause, text=text)

    def close(self) -> None:
        """End the simulation."""
        self._simulator.close()

    # --- modes -------------------------------------------------------------------------

    @property
    def is_standing(self) -> bool:
        """Whether all joints are at rest."""
        return self._simulator.is_standing

    def count(self, name: str, number: int = 1) -> None:
        """Add to a counter."""
        self.values[name] = int(self.values.get(name, 0)) + number

    def _reason(self) -> str:
        return str(self.rejection)[:_LONGEST_REASON]

    def _judge(self, now: float) -> None:
        """Brake because several controllers command, or see that all but one have gone."""
        if not self._senders.contested:
            self._go(DriveEvent.SETTLED, now, DriveCause.CONTEST_OVER)
        elif DriveEvent.CONTEST in TRANSITIONS[self.status.mode]:
            names = tuple(self._publishers())
            self._go(DriveEvent.CONTEST, now, DriveCause.CONTESTED, names=names)

    def _go(
        self, event: DriveEvent, now: float, cause: DriveCause = DriveCause.NONE, **about: Any
    ) -> None:
        """Let an event change the mode, and do what the new one asks for."""
        before = self.status
        mode = TRANSITIONS[before.mode].get(event)
        if mode is None:
            return
        if event not in _RELEASES:
            self.rejection = None
            if mode is not DriveMode.OBEYING:
                self._simulator.brake()
                self._forget_commands()
        since = now if DriveMode.OBEYING in (mode, before.mode) else before.since
        self._set(DriveStatus(mode, cause, since, **about))

    def _set(self, status: DriveStatus) -> None:
        if status != self.status:
            self.status = status
            self._on_change(status)


def _acceleration(simulator: Simulator, policy: DrivePolicy) -> CommandAcceleration | None:
    """Return what judges the position commands; None if all may be asked for."""
    names = simulator.robot.joints
    given = each_joint(
        "max_joint_acceleration", policy.max_joint_acceleration, np.zeros(len(names))
    )
    if not given.any():
        return None
    limit = np.where(given > 0.0, given, np.inf)
    dt = 1.0 / simulator.parameters.rate
    return CommandAcceleration(names, limit, simulator.turning, simulator.prismatic, dt)
