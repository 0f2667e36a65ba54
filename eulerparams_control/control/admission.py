"""Which measured states are believed, and what they say of the time between them."""

from collections import deque
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from eulerparams_control.control.clock import Clock, Instant, Latency, NominalPeriod
from eulerparams_control.control.mode import Why, restarted, too_rare, too_slow
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import LoopGain
from eulerparams_control.robot.robot import Robot

AT_REST = 0.01
"""Slower than this [rad/s or m/s] a joint is at rest."""

# A measured position may be this far [rad or m] from where the last one could have led, a speed
# this many times its limit: further, it is the measurement that is wrong.
_MOST_ASTRAY, _MOST_SPEED = 0.1, 3.0

# States that contradict so many others within this time [s] are those of two robots.
_CONFLICTS, _CONTEST = 3, 1.0

# So many stamps in a row that are behind, but rise, are those of a clock that was set back.
_SET_BACK = 3

# Measured positions that stay the same to the bit, while the measured speeds would have led this
# far [rad or m] away, are not measured any more.
_FROZEN = 0.01

# After a jump of the stamps an arm farther [rad or m] from where it was is another one, or a
# simulation that was started again: no command acts on it yet.
_SAME_ARM = 0.03

# The loop of a gain may turn by so much within a period: beyond the first it is not stable, but
# for what the measurement of the period is worth; beyond the second it is another loop.  A period
# may be this part of the timeout of silence.  A verdict is left at this part of its bound.
_MOST_TURN, _FINE_TURN, _OF_TIMEOUT, _CLEAR = 1.05, 0.5, 0.9, 0.85

# No law integrates over more than so many usual periods at once.
_LONGEST_STEP = 3.0


class Repeat(NamedTuple):
    """A state with the stamp of the last one.

    Attributes:
        is_same: whether it says the same, or is another one, by a clock that was set back.
        silence: [s] since the stamp went on.
    """

    is_same: bool
    silence: float


class Restart(NamedTuple):
    """The stamps jumped, or no state came for long.

    Attributes:
        why: which of them, and by how much.
        is_silence: whether no state came for long.
        is_same_arm: whether the arm is where it was.
        acts: whether the last command still acts.
        step: [s] that the arm has gone on since, if it does: the usual period; 0: not known.
        jump: [ns] of the stamps beyond that.
    """

    why: Why
    is_silence: bool
    is_same_arm: bool
    acts: bool
    step: float
    jump: int


class Accept(NamedTuple):
    """A new state.

    Attributes:
        dt: [s] since the last one; 0 at the first, and after a restart.
        lost: [s] of it that no law is to integrate over: states are missing.
        leapt: [s] of it by which the stamps alone went on: no time has passed; below 0: by which
            they were set back, and more has.
        acted: [s] for which the command before has acted.
        is_first: whether it is the first.
        restart: what happened before it; None if it follows the last one.
        is_frozen: whether its positions are not measured ones: they stay although the arm moves.
    """

    dt: float
    lost: float
    leapt: float
    acted: float
    is_first: bool
    restart: Restart | None
    is_frozen: bool


class Rate(Enum):
    """Whether states come often enough."""

    FINE = auto()
    LOW = auto()  # the law is not what it would be in continuous time
    TOO_LOW = auto()  # the law is not stable
    TOO_RARE = auto()  # each state comes after a silence


class RateCheck:
    """Whether the states come often enough for the gains, and for the timeout of silence.

    A loop of the rate k bears steps dt of k dt < 1; below 0.5 it does what it would in continuous
    time.  A verdict is left only when it is clear of its bound, so that jitter does not toggle it.

    Args:
        period: of the states.
        timeout: [s] of silence.

    Attributes:
        rate: the verdict.
        why: the arm is to be held, or a warning; Why() where the rate is fine.
    """

    def __init__(self, period: NominalPeriod, timeout: float) -> None:
        self._period, self._timeout = period, timeout
        self.rate, self.why = Rate.FINE, Why()
        self._is_known = False  # the period, when this was said

    @property
    def is_too_low(self) -> bool:
        """Whether nothing may move."""
        return self.rate in (Rate.TOO_LOW, Rate.TOO_RARE)

    def judge(self, gain: LoopGain | None, hold_rate: float) -> None:
        """Judge the rate for the fastest gain of the law, and for that of what holds the arm.

        Args:
            gain: the fastest; None if the law closes no loop.
            hold_rate: [1/s] of the loop that holds the arm; what does not even bear that is told
                before the period is known.
        """
        period, least = self._period.seconds, self._period.least
        if period == 0 and hold_rate * least > 1:
            period = least
        turn, rate = 0.0 if gain is None else gain.rate * period, Rate.FINE
        is_clear = turn <= _CLEAR * _FINE_TURN and period <= _CLEAR * _OF_TIMEOUT * self._timeout
        if is_clear and self.rate is rate and self._is_known:
            return
        if period > self._bound(Rate.TOO_RARE, _OF_TIMEOUT * self._timeout):
            rate = Rate.TOO_RARE
        elif turn > self._bound(Rate.TOO_LOW, _MOST_TURN):
            rate = Rate.TOO_LOW
        elif turn > self._bound(Rate.LOW, _FINE_TURN):
            rate = Rate.LOW
        is_known = self._period.seconds > 0
        if (rate, is_known) == (self.rate, self._is_known):
            return
        self.rate, self._is_known, self.why = rate, is_known, Why()
        if rate is Rate.TOO_RARE:
            self.why = too_rare(period, self._timeout)
        elif rate is not Rate.FINE and gain is not None:
            self.why = too_slow(period, gain, _FINE_TURN, is_held=rate is Rate.TOO_LOW)

    def _bound(self, rate: Rate, bound: float) -> float:
        """Return the bound of a verdict, which is lower while it lasts."""
        return _CLEAR * bound if rate is self.rate else bound


class Turns:
    """Counts the turns of continuous joints: many drivers report them within one turn only.

    Args:
        joints: (n,) which turn without an end.
        q: (n,) [rad] measured at first.
    """

    def __init__(self, joints: Array, q: Array) -> None:
        self._joints, self._q = joints, q
        self._turns, self._wraps = np.zeros(len(q)), np.zeros(len(q), dtype=bool)

    def unwound(self, q: Array, near: Array | None, *, is_lost: bool) -> Array:
        """Return measured positions (n,) by whole turns nearest to others.

        Args:
            q: (n,) as they came.
            near: (n,) the others; None: those before.
            is_lost: whether the driver may have lost its count meanwhile.  Then a joint that was
                never seen to jump by a turn is where it says it is: a command a turn away would
                move it there.
        """
        turns = np.round(((self._q if near is None else near) - q) / (2 * np.pi))
        turns[np.logical_not(self._joints)] = 0.0
        if is_lost:
            turns[np.logical_not(self._wraps)] = 0.0
        else:
            self._wraps |= turns != self._turns
        self._turns = turns
        self._q = q + 2 * np.pi * turns if turns.any() else q
        return self._q


class Admission:
    """Refuses states that the robot cannot have reached, and those that come too late.

    Args:
        robot: the arm.
        timeout: [s] gap in the stamps, or silence, after which the arm may be anywhere.
        max_latency: [s] by which a state may come later than the best one did.
        strict: whether positions and speeds are checked; else stamps and ages only.
        q: (n,) measured positions at activation.

    Attributes:
        clock: of the states that were taken.
        period: the usual time between them.
        conflicts: when [s] the last states came that contradict the ones before.
        set_backs: how often the clock of their stamps was set back.
    """

    def __init__(
        self, robot: Robot, timeout: float, max_latency: float, strict: bool, q: Array
    ) -> None:
        self.clock, self.period = Clock(), NominalPeriod()
        self.conflicts: deque[float] = deque(maxlen=_CONFLICTS)
        self.set_backs = 0
        self._robot, self._timeout, self._strict = robot, timeout, strict
        self._fastest = _MOST_SPEED * robot.limits.velocity
        turning = np.logical_not(robot.is_prismatic)
        turning = np.logical_and(turning, np.isinf(robot.limits.upper))
        self._turns = Turns(turning, q) if turning.any() else None
        self._latency = Latency(max_latency)
        self._q, self._dq = np.zeros(robot.n), np.zeros(robot.n)  # of the last state
        self._back, self._back_at = 0, 0  # stamps in a row that are behind, and the last [ns]
        self._unmoved = np.zeros(robot.n)  # how far [rad or m] positions that stay should be

    @property
    def is_contested(self) -> bool:
        """Whether states contradict each other again and again, as those of two robots do."""
        conflicts = self.conflicts
        return len(conflicts) == _CONFLICTS and self.clock.now() - conflicts[0] < _CONTEST

    @property
    def _is_set_back(self) -> bool:
        """Whether stamps are behind, but go on: those of a clock that was set back."""
        return self._back >= _SET_BACK

    def refuse(self, at: Instant, q: Array, dq: Array, *, patient: bool = False) -> None:
        """Raise InvalidMessageError unless the state can be one of the robot, and of now.

        Args:
            at: when it was.
            q, dq: (n,) measured.
            patient: whether states that stay late are taken in the end.
        """
        dt, _ = self.clock.step(at)
        if -self._timeout < dt < 0:
            self._back = self._back + 1 if at.stamp > self._back_at else 1
            self._back_at = at.stamp
            self.conflicts.append(at.seconds)
            raise InvalidMessageError(
                f"the stamp goes back by {-dt:g} s; is there a second publisher of joint_states?"
            )
        if self._is_set_back:  # nothing is late
            self._latency.forget()
        if self._strict:
            self._refuse_impossible(at, dt, q, dq)
        if at.receipt is not None and (dt != 0 or self.clock.last is None):
            self._refuse_late(at.stamp, dt, at.receipt, patient)

    def unwound(self, at: Instant, q: Array, command: Array | None) -> Array:
        """Return measured positions (n,) that go on where joints are continuous.

        Args:
            at: when they were.
            q: (n,) as they came, not refused.
            command: (n,) the last one, to which they are nearest after a gap; None if none is.
        """
        if self._turns is None:
            return q
        dt, silence = self.clock.step(at)
        is_lost = silence > self._timeout or (at.receipt is None and dt > self._timeout)
        near = None if self._goes_on(dt, silence) else command
        return self._turns.unwound(q, near, is_lost=is_lost)

    def _goes_on(self, dt: float, silence: float) -> bool:
        """Whether a state follows the last one: no silence, no jump of the stamps [s]."""
        return 0 <= dt <= self._timeout and silence <= self._timeout

    def admit(self, at: Instant, q: Array, dq: Array) -> Accept | Repeat:
        """Say what a state is that is not refused: q, dq (n,) measured at an instant."""
        clock, timeout = self.clock, self._timeout
        (dt, silence), last, restart = clock.step(at), clock.last, None
        if last is not None and at.stamp == last.stamp:
            is_same = np.array_equal(q, self._q) and np.array_equal(dq, self._dq)
            is_same = is_same or self._is_set_back  # the clock has come to this stamp again
            if not is_same:
                self.conflicts.append(at.seconds)
            return Repeat(is_same, silence)
        usual = self.period.seconds
        longest = _LONGEST_STEP * usual or np.inf
        self.period.take(dt)
        if not self._goes_on(dt, silence):
            moved = self._robot.limits.deviation(q, self._q)
            # by the stamps alone a silence and a clock that was set forward look the same
            is_heard = silence <= timeout and (dt < 0 or at.receipt is not None)
            is_same = bool((moved <= _SAME_ARM).all())
            why = restarted(dt, silence, not 0 <= dt <= timeout)
            if not is_same and silence <= timeout:
                self.conflicts.append(at.seconds)
            jump, acts = round((dt - usual) * 1e9), is_heard and is_same
            restart = Restart(why, silence > timeout, is_same, acts, usual, jump)
            dt = 0.0
        is_frozen = last is not None and self._strict and self._is_frozen(dt, q, dq)
        acted, leapt = dt, 0.0
        if at.receipt is not None:
            acted = min(dt, silence) if dt > 0 else silence
            leapt = 0.0 if restart else self._leapt(dt, silence)
        lost, acted = max(dt - longest, 0.0), min(acted, longest)
        if lost > 0 and at.receipt is not None:  # the stamps may have gone on alone
            lost = dt - min(longest, max(silence, usual))
        return Accept(dt, lost, leapt, acted, last is None, restart, is_frozen)

    def take(self, at: Instant, q: Array, dq: Array) -> None:
        """Take a state for the last one; what it brings about has happened."""
        self.set_backs += self._is_set_back or self.clock.step(at)[0] < 0
        self.clock.last, self._q, self._dq, self._back = at, q, dq, 0

    def _leapt(self, dt: float, silence: float) -> float:
        """Return by how much more [s] the stamps went on than time, lost and late states apart."""
        if self._is_set_back:
            return dt - silence
        usual = self.period.seconds
        leapt = min(self._latency.early, dt - max(silence, usual))
        return leapt if 0 < usual < 2 * leapt else 0.0  # less is jitter

    def _is_frozen(self, dt: float, q: Array, dq: Array) -> bool:
        if True in (q != self._q).tolist():
            self._unmoved = np.zeros(self._robot.n)
            return False
        self._unmoved = self._unmoved + dt * np.where(np.abs(dq) > AT_REST, dq, 0.0)
        return bool(np.abs(self._unmoved).max() > _FROZEN)

    def _refuse_impossible(self, at: Instant, dt: float, q: Array, dq: Array) -> None:
        """Raise InvalidMessageError for a state that is too fast or too far away."""
        robot = self._robot
        fast = np.abs(dq) > self._fastest
        if True in fast.tolist():
            i = int(np.argmax(fast))
            raise InvalidMessageError(
                f"the joint {robot.joints[i]} moves at {dq[i]:.3g} rad/s, more than "
                f"{_MOST_SPEED:g} times its limit"
            )
        if self.clock.last is None or not 0 <= dt <= self._timeout:
            return
        moved = robot.limits.deviation(q, self._q)
        far = moved > _MOST_ASTRAY + dt * self._fastest
        if True in far.tolist():
            i = int(np.argmax(far))
            self.conflicts.append(at.seconds)
            raise InvalidMessageError(
                f"the joint {robot.joints[i]} jumps by {moved[i]:.3g} rad within {dt:g} s"
            )

    def _refuse_late(self, t: int, dt: float, now: float, patient: bool) -> None:
        """Raise InvalidMessageError for a state that comes too late to control by."""
        if dt < 0:
            self._latency.forget()
        late, most = self._latency.of(t, now, patient=patient), self._latency.most
        if late > most:
            raise InvalidMessageError(
                f"the state comes {late:.3f} s later than the best one, more than max_latency "
                f"{most:g} s: is the network or the computer overloaded? If they stay so late, "
                "deactivate and activate; a simulation that is not in real time needs use_sim_time"
            )
