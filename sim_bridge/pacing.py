"""When the simulated robot steps: with the wall clock, or as its commands come."""

import math
from collections.abc import Callable
from typing import Any

from numpy.typing import ArrayLike

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import SimulationError
from eulerparams_control.events import ExitCode
from eulerparams_control.messages.from_ros import ns_from_ros
from sim_bridge.command_statistics import Tally
from sim_bridge.drive import GIVEN_UP, Drive, DriveCause, DriveMode, DriveReply
from sim_bridge.simulator import SimulatorState

# In real time, more steps than this behind the wall clock are given up, not caught up.
_MAX_CATCH_UP = 50

Publish = Callable[[SimulatorState, int], None]
"""Takes a state and its stamp [ns]."""


class _Pacing:
    """What both ways of stepping share.

    Args:
        drive: the robot.
        publish: called with each state and its stamp [ns].
        rate: steps per second.
        duration: ends after [s]; 0: never.
        clock: steady [s].

    Attributes:
        done: whether it is over.
        error: why, if it failed.
        stamp: of the present state [ns].
    """

    def __init__(
        self,
        drive: Drive,
        publish: Publish,
        rate: float,
        duration: float = 0.0,
        clock: Callable[[], float] = steady,
    ) -> None:
        self._drive, self._publish, self._rate, self._clock = drive, publish, rate, clock
        self._duration = duration or math.inf
        self._tally = Tally(clock())
        self._lost = 0  # steps that were given up
        self.done, self.stamp = False, 0
        self.error: SimulationError | None = None

    @property
    def now(self) -> float:
        """The time by which messages age [s]."""
        return self._clock()

    def push(self, wrench: ArrayLike, stamp: int) -> None:
        """Push the tool with a wrench that came now, stamped so [ns]."""
        self._drive.push(wrench, self.now)

    def review(self) -> None:
        """Bring what /diagnostics shows up to date, once a second."""
        self._drive.values.update(self._tally.report(self._clock(), self._drive.state.t))
        self._drive.review(self.now)

    def brake(self) -> bool:
        """End: brake, and return whether the robot is at rest."""
        obeys = self._drive.status.mode is DriveMode.OBEYING
        self._drive.end(self.now, DriveCause.SHUTDOWN if obeys else DriveCause.FINISHED)
        return self.done or self._drive.is_standing

    def _step(self) -> None:
        if self.done:
            return
        try:
            self._drive.step(self.now)
        except SimulationError as error:
            self.error, self.done = error, True
        else:
            self._show()

    def _show(self) -> None:
        state = self._drive.state
        self.stamp = round((state.step + self._lost) * 1e9 / self._rate)
        self._publish(state, self.stamp)

    def _finish(self) -> None:
        self._drive.end(self.now, DriveCause.FINISHED)
        self.done = True


class WallClock(_Pacing):
    """Makes the steps that are due by the wall clock."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._started = self._clock()

    def turn(self) -> int:
        """Make the steps that are due; return how many are so if they are too many.

        Those that are given up are missing in the stamps: no state is older than it says.
        """
        passed = int((self._clock() - self._started) * self._rate)
        due = behind = passed - self._drive.state.step - self._lost
        if behind > _MAX_CATCH_UP:
            self._drive.count(GIVEN_UP, behind - 1)
            self._lost += behind - 1
            due = 1
        for _ in range(due):
            self._step()
            if not self.done and self._drive.state.t >= self._duration:
                self._finish()
        return behind if behind > _MAX_CATCH_UP else 0

    def command(self, msg: Any, number: int) -> DriveReply:
        """Take a command, or not."""
        reply = self._drive.command(msg, number, self.now)
        if reply is DriveReply.TAKEN:
            stamp = ns_from_ros(msg.header.stamp)
            self._tally.take(self._clock(), self.stamp - stamp if stamp else 0)
        return reply


class LockStep(_Pacing):
    """Steps when the present state is answered; repeats the first one until then.

    Args:
        *args: as of :class:`WallClock`.
        timeout: without an answer it fails [s].
        is_watched: whether all who are to see the first state are there.
        **kwargs: as of :class:`WallClock`.
    """

    def __init__(
        self, *args: Any, timeout: float, is_watched: Callable[[], bool], **kwargs: Any
    ) -> None:
        super().__init__(*args, **kwargs)
        self._timeout, self._is_watched = timeout, is_watched
        self._heard = self._answered = False

    @property
    def now(self) -> float:
        """The time by which messages age [s]: that of the simulation."""
        return self._drive.state.t

    def push(self, wrench: ArrayLike, stamp: int) -> None:
        """Push the tool as of a stamp [ns]; as of now if that is 0 or in the future."""
        t = stamp / 1e9
        self._drive.push(wrench, t if 0.0 < t < self.now else self.now)

    def turn(self) -> int:
        """Repeat the first state until it is answered; give up on a silent controller."""
        if not self._answered:
            self._heard = self._is_watched()
            self._show()
        elif not self.done and self._clock() - self._tally.last > self._timeout:
            self._stall()
        return 0

    def _stall(self) -> None:
        rejection = self._drive.rejection
        self.error = SimulationError(
            f"no command for the state stamped {self.now:.3f} s within {self._timeout:g} s; is "
            "the controller alive and active?"
            + (f" The last command was rejected: {rejection}" if rejection else ""),
            ExitCode.STALLED,
        )
        self._drive.end(self.now, DriveCause.STALLED, str(self.error))
        self.done = True

    def command(self, msg: Any, number: int) -> DriveReply:
        """Take a command, or not; step if it answers the present state."""
        if not (self._heard and ns_from_ros(msg.header.stamp) == self.stamp):
            self._drive.hear(number, self.now)
            return DriveReply.UNASKED
        reply = self._drive.command(msg, number, self.now)
        if reply is DriveReply.REJECTED:
            return reply
        if reply is DriveReply.TAKEN:
            self._tally.take(self._clock(), 0)
        self._tally.last = self._clock()  # time goes on, though the robot may stand
        self._answered = True
        if self._drive.state.step + 0.5 > self._duration * self._rate:
            self._finish()
        else:
            self._step()
        return reply

    def brake(self) -> bool:
        """End: brake; time stands still anyway."""
        super().brake()
        return True
