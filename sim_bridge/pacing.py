"""When the simulated robot steps: with the wall clock, or as its commands come."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from numpy.typing import ArrayLike

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import SimulationError
from eulerparams_control.events import ExitCode
from eulerparams_control.messages.from_ros import ns_from_ros
from sim_bridge.drive import GIVEN_UP, Drive
from sim_bridge.drive_modes import DriveCause, DriveMode, DriveReply
from sim_bridge.simulator import SimulatorState

# In real time, more steps than this behind the wall clock are given up, not caught up.
_MAX_CATCH_UP = 50

# Time waits for a late command no longer than this [s]: its controller may be gone.
_PATIENCE = 1.0

# Key on /diagnostics: how long time stands still already, if longer than a second; else 0.
STANDS_STILL = "time stands still for [s]"


class Tally:
    """Counts from one report to the next.

    Args:
        now: steady clock [s].

    Attributes:
        last: when the last command was taken, steady clock [s].
    """

    def __init__(self, now: float) -> None:
        self.last = self._since = now
        self._t = 0.0
        self._clear()

    def _clear(self) -> None:
        self._count, self._gap, self._age = 0, 0.0, 0

    def take(self, now: float, age: int) -> None:
        """Count a command that came at ``now`` [s] for a state that was ``age`` [ns] old."""
        self._count += 1
        if now - self.last > self._gap:
            self._gap = now - self.last
        if age > self._age:
            self._age = age
        self.last = now

    def report(self, now: float, t: float) -> Mapping[str, float]:
        """Return what /diagnostics shows of the time since the last report, and restart.

        Args:
            now: steady clock [s].
            t: time of the simulation [s].
        """
        passed = max(now - self._since, 1e-9)
        values = {
            "commands per second": self._count / passed,
            "worst gap between commands [ms]": 1e3 * max(self._gap, now - self.last),
            "worst command age [ms]": 1e-6 * self._age,
            "real-time factor": (t - self._t) / passed,
        }
        self._since, self._t = now, t
        self._clear()
        return values


class WallClock:
    """Makes the steps that are due by the wall clock.

    Args:
        drive: the robot.
        publish: called with each state and its stamp [ns].
        rate: steps per second.
        duration: ends after [s]; 0: never.
        clock: steady [s].
        max_command_age: time stands still while the last command answers a state that is older [s]
            than this; 0: it goes on.

    Attributes:
        done: whether it is over.
        error: why, if it failed.
    """

    def __init__(
        self,
        drive: Drive,
        publish: Callable[[SimulatorState, int], None],
        rate: float,
        duration: float = 0.0,
        clock: Callable[[], float] = lambda: steady.now(),
        max_command_age: float = 0.0,
    ) -> None:
        self._drive, self._publish, self._rate, self._clock = drive, publish, rate, clock
        self._duration = duration or math.inf
        self._started = clock()
        self._tally = Tally(self._started)
        self._lost = 0  # steps that were given up
        self._stamp = self._commanded = 0  # of the present state, and of that commanded last [ns]
        self._moved = self._started  # when time went on last
        self._max_age = round(1e9 * max_command_age)
        self.done = False
        self.error: SimulationError | None = None

    @property
    def now(self) -> float:
        """The time by which messages age [s]."""
        return self._clock()

    def turn(self) -> int:
        """Make the steps that are due; return how many are so if they are too many.

        Those that are given up are missing in the stamps: no state is older than it says.
        """
        passed = int((self._clock() - self._started) * self._rate)
        due = behind = passed - self._drive.state.step - self._lost
        if self._max_age and (behind > _MAX_CATCH_UP or self._waits):
            self._started += behind / self._rate
            return 0
        if behind > _MAX_CATCH_UP:
            self._drive.count(GIVEN_UP, behind - 1)
            self._lost += behind - 1
            due = 1
        for _ in range(due):
            if self._waits:
                break
            self._step()
            if self._drive.state.t >= self._duration:
                self._end(DriveCause.FINISHED)
        return behind if behind > _MAX_CATCH_UP else 0

    @property
    def _waits(self) -> bool:
        """Whether time stands still until a newer command comes."""
        is_late = self._max_age and self._stamp - self._commanded > self._max_age
        is_obeying = self._drive.status.mode is DriveMode.OBEYING
        return bool(is_late and is_obeying and self._clock() - self._tally.last < _PATIENCE)

    def command(self, msg: Any, number: int) -> DriveReply:
        """Take a command, or not."""
        reply = self._drive.command(msg, number, self.now)
        if reply is DriveReply.TAKEN:
            stamp = ns_from_ros(msg.header.stamp)
            self._commanded = stamp or self._stamp  # 0: it names none, and answers what is there
            self._tally.take(self._clock(), self._stamp - stamp if stamp else 0)
        return reply

    def push(self, wrench: ArrayLike, _stamp: int) -> None:
        """Push the tool from now on."""
        self._drive.push(wrench, self.now)

    def review(self) -> None:
        """Bring what /diagnostics shows up to date, once a second."""
        self._drive.values.update(self._tally.report(self._clock(), self._drive.state.t))
        if self._max_age:
            still = 0.0 if self.done else self._clock() - self._moved
            self._drive.values[STANDS_STILL] = round(still, 1) if still > _PATIENCE else 0.0
        self._drive.review(self.now)

    def brake(self) -> bool:
        """Brake for good; return whether the robot is at rest."""
        status = self._drive.status
        obeys = status.mode is DriveMode.OBEYING
        cause = DriveCause.SHUTDOWN if obeys else status.cause or DriveCause.FINISHED
        self._drive.end(self.now, cause)
        return self.done or self._drive.is_standing

    def _step(self) -> None:
        if self.done:
            return
        try:
            self._drive.step(self.now)
        except SimulationError as error:
            self._end(DriveCause.DIVERGED, error)
        else:
            self._show()

    def _show(self) -> None:
        self._moved = self._clock()
        state = self._drive.state
        self._stamp = round((state.step + self._lost) * 1e9 / self._rate)
        self._publish(state, self._stamp)

    def _end(self, cause: DriveCause, error: SimulationError | None = None) -> None:
        self._drive.end(self.now, cause, str(error or ""))
        self.error, self.done = self.error or error, True


class LockStep(WallClock):
    """Steps when the present state is answered; repeats the first one until then.

    Args:
        *args: as of :class:`WallClock`.
        timeout: without an answer it fails [s].
        is_watched: whether all who are to see the first state are there.
    """

    def __init__(self, *args: Any, timeout: float, is_watched: Callable[[], bool]) -> None:
        super().__init__(*args)
        self._timeout, self._is_watched = timeout, is_watched
        self._heard = self._answered = False

    @property
    def now(self) -> float:
        """The time by which messages age [s]: that of the simulation."""
        return self._drive.state.t

    def turn(self) -> int:
        """Repeat the first state until it is answered; give up on a silent controller."""
        if not self._answered:
            self._heard = self._is_watched()
            self._show()
        elif self._clock() - self._tally.last > self._timeout and not self.done:
            rejection = self._drive.rejection
            text = (
                f"no command for the state stamped {self.now:.3f} s within {self._timeout:g} s; is "
                "the controller alive and active?"
                + (f" The last command was rejected: {rejection}" if rejection else "")
            )
            self._end(DriveCause.STALLED, SimulationError(text, ExitCode.STALLED))
        return 0

    def command(self, msg: Any, number: int) -> DriveReply:
        """Take a command, or not; step if it answers the present state."""
        if not (self._heard and ns_from_ros(msg.header.stamp) == self._stamp):
            self._drive.hear(number, self.now)
            return DriveReply.UNASKED
        reply = super().command(msg, number)
        if reply is not DriveReply.REJECTED:
            self._tally.last = self._clock()  # time goes on, though the robot may be at rest
            self._answered = True
            if self._drive.state.step + 0.5 > self._duration * self._rate:
                self._end(DriveCause.FINISHED)
            else:
                self._step()
        return reply

    def push(self, wrench: ArrayLike, stamp: int) -> None:
        """Push the tool as of a stamp [ns]; as of now if that is 0 or in the future."""
        t = stamp / 1e9
        self._drive.push(wrench, t if 0.0 < t < self.now else self.now)

    def brake(self) -> bool:
        """Brake for good; time has stopped anyway."""
        super().brake()
        return True
