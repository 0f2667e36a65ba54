"""Admission of measured states, and the time between them."""

from collections import deque
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from eulerparams_control.control import judge
from eulerparams_control.control.clock import Clock, Instant, Latency, NominalPeriod
from eulerparams_control.control.mode import Why, restarted, too_rare, too_slow
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.jit import Array
from eulerparams_control.laws.limits import NONE
from eulerparams_control.laws.scheme import Scheme
from eulerparams_control.robot.robot import Robot

# A speed that is this many times its limit is measured wrongly.
_MOST_SPEED = 3.0

# Number of contradicting states, within this time [s], that are those of two robots.
_CONFLICTS, _CONTEST = 3, 1.0

# Number of stamps in a row that are behind, but rise: those of a clock that was set back.
_SET_BACK = 3

# Largest angles [rad] by which the loop of a gain may turn within a period: beyond the first it is
# not stable, with some room for the error of the measured period; beyond the second it is another
# loop.  Then the part of the timeout of silence that a period may last, and the part of its bound
# at which a verdict ends.
_MOST_TURN, _FINE_TURN, _OF_TIMEOUT, _CLEAR = 1.05, 0.5, 0.9, 0.85

_NOT_FINE = -1.0, -1.0


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
        q: (n,) positions, which go on where joints are continuous.
        code: what the numbers say, see :mod:`eulerparams_control.control.judge`.
        dt: [s] since the last one; 0 at the first, and after a restart.
        acted: [s] for which the command before has acted; of a state that repeats the stamp of the
            last one, how long [s] it has stayed.
        lost: [s] of dt that no law is to integrate over: states are missing.
        leapt: [s] of it by which the stamps alone went on: no time has passed; below 0: by which
            they were set back, and more has.
        is_first: whether it is the first.
        restart: what happened before it; None if it follows the last one.
    """

    q: Array
    code: int
    dt: float
    acted: float
    lost: float
    leapt: float
    is_first: bool
    restart: Restart | None


class Rate(Enum):
    """Whether states come often enough."""

    FINE = auto()
    LOW = auto()  # the law is not what it would be in continuous time
    TOO_LOW = auto()  # the law is not stable
    TOO_RARE = auto()  # each state comes after a silence


class RateCheck:
    """Whether the states come often enough for the gains, and for the timeout of silence.

    A loop of the rate k is stable with steps dt of k dt < 1; below 0.5 it does what it would in
    continuous time.  A verdict is left only when it is clear of its bound, so that jitter does not
    toggle it.

    Args:
        period: of the states.
        timeout: [s] of silence.

    Attributes:
        rate: the verdict.
        why: the arm is to be held, or a warning; Why() where the rate is fine.
        fine: [s] of the longest period, and angle [rad] in it of a loop, with which a verdict
            stays as it is; below 0 unless the rate is fine.
    """

    def __init__(self, period: NominalPeriod, timeout: float) -> None:
        self._period, self._timeout = period, timeout
        self.rate, self.why = Rate.FINE, Why()
        self.fine = _NOT_FINE
        self._is_known = False  # the period, when this was said

    @property
    def is_too_low(self) -> bool:
        """Whether nothing may move."""
        return self.rate in (Rate.TOO_LOW, Rate.TOO_RARE)

    def judge(self, scheme: Scheme) -> None:
        """Judge the rate for the fastest gain of a law, and for that of what holds the arm.

        A rate that is too low even for the latter is reported before the period is known.
        """
        period, gain = self._period.seconds, scheme.fastest_gain
        turn = 0.0 if gain is None else gain.rate * period
        if period == 0 and scheme.hold_rate * self._period.least > 1:
            period = self._period.least
            turn = 0.0 if gain is None else gain.rate * period
        rate = Rate.FINE
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
        is_fine = is_known and rate is Rate.FINE
        fine = _CLEAR * _OF_TIMEOUT * self._timeout, _CLEAR * _FINE_TURN
        self.fine = fine if is_fine else _NOT_FINE
        if rate is Rate.TOO_RARE:
            self.why = too_rare(period, self._timeout)
        elif rate is not Rate.FINE and gain is not None:
            self.why = too_slow(period, gain, _FINE_TURN, is_held=rate is Rate.TOO_LOW)

    def _bound(self, rate: Rate, bound: float) -> float:
        """Return the bound of a verdict, which is lower while it lasts."""
        return _CLEAR * bound if rate is self.rate else bound


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
        self._robot, self._timeout = robot, timeout
        self._believed = ~0 if strict else ~(judge.FAST | judge.FAR | judge.FROZEN)
        endless = np.isinf(robot.limits.upper)
        turning = np.logical_and(endless, np.logical_not(robot.is_prismatic))
        # the last state, and the one that is judged, which takes its place where it is taken
        self._last, self._this = np.zeros((2, judge.STATE_ROWS, robot.n))
        self._last[judge.Q] = q
        self._joints = np.zeros((judge.JOINT_ROWS, robot.n))
        self._joints[judge.FASTEST] = _MOST_SPEED * robot.limits.velocity
        self._joints[judge.ENDLESS], self._joints[judge.TURNING] = endless, turning
        self._latency = Latency(max_latency)
        self._back, self._back_at = 0, 0  # stamps in a row that are behind, and the last [ns]

    @property
    def is_contested(self) -> bool:
        """Whether states contradict each other again and again, as those of two robots do."""
        conflicts = self.conflicts
        return len(conflicts) == _CONFLICTS and self.clock.now() - conflicts[0] < _CONTEST

    def admit(
        self, at: Instant, q: Array, dq: Array, told: Array | None, velocity: Array | float,
        patient: bool,
    ) -> Accept:  # fmt: skip
        """Say what the state q, dq (n,) measured at an instant is.

        Args:
            at: when it was.
            q, dq: (n,) as they came.
            told: (n,) the last command, to which continuous joints are nearest after a gap.
            velocity: limits (n,) of the speeds under efforts; infinity: there are none.
            patient: whether states that stay late are taken in the end.

        Raises:
            InvalidMessageError: unless it can be one of the robot, and of now.
            RobotError: if q or dq has not n elements.
        """
        timeout, last, receipt = self._timeout, self.clock.last, at.receipt
        latency, period, n = self._latency, self.period, self._robot.n
        if len(q) != n or len(dq) != n:
            self._robot.refuse_size(q, dq)
        dt = 0.0 if last is None else (at.stamp - last.stamp) / 1e9
        # how far the stamps went on, and how long no state came [s]; 0 if that is not known
        before = None if last is None else last.receipt
        silence = 0.0 if receipt is None or before is None else receipt - before
        if -timeout < dt < 0:
            self._back = self._back + 1 if at.stamp > self._back_at else 1
            self._back_at = at.stamp
            self.conflicts.append(at.seconds)
            raise InvalidMessageError(
                f"the stamp goes back by {-dt:g} s: is there a second publisher of joint_states, "
                "or was its clock set?"
            )
        is_set_back = self._back >= _SET_BACK
        if is_set_back:  # nothing is late
            latency.forget()
        is_near = 0 <= dt <= timeout
        goes_on = is_near and silence <= timeout
        is_lost = silence > timeout or (receipt is None and dt > timeout)
        near, is_first = NONE if goes_on or told is None else told, last is None
        follows, self._joints[judge.LIMIT] = (is_near and not is_first, goes_on, is_lost), velocity
        states = self._last, self._this
        code = judge.code_of(q, dq, near, *states, self._joints, dt, follows) & self._believed
        if code & (judge.FAST | judge.FAR):
            self._refuse_impossible(at, dt, q, dq, code)
        if receipt is not None and (dt != 0 or is_first):
            if dt < 0:
                latency.forget()
            delay = latency.of(at.stamp, receipt, patient=patient)
            if delay > latency.most:
                self._refuse_late(delay)
        if last is not None and at.stamp == last.stamp:
            if is_set_back:  # its clock was here before
                code |= judge.SAME
            elif not code & judge.SAME:
                self.conflicts.append(at.seconds)
            return Accept(q, code | judge.AGAIN, 0.0, silence, 0.0, 0.0, False, None)
        if code & judge.WOUND:
            q = self._this[judge.Q].copy()
        usual, restart = period.seconds, None
        period.take(dt)
        if not goes_on:
            restart, dt = self._restart(at, dt, silence, usual, code), 0.0
        acted, lost, leapt = dt, 0.0, 0.0
        if receipt is not None:
            acted = dt if 0 < dt < silence else silence
            # by how much more the stamps went on than time, lost and late states apart
            early, usual_now = latency.early, period.seconds
            if is_set_back:
                leapt = dt - silence
            elif 0 < usual_now < 2 * early:
                leapt = min(early, dt - max(silence, usual_now))
            if restart or not (is_set_back or usual_now < 2 * leapt):  # less is jitter
                leapt = 0.0
        longest = judge.LONGEST_STEP * usual
        if usual and (dt > longest or acted > longest):
            lost, acted = max(dt - longest, 0.0), min(acted, longest)
            if lost > 0 and receipt is not None:  # the stamps may have gone on alone
                lost = dt - min(longest, max(silence, usual))
        return Accept(q, code, dt, acted, lost, leapt, is_first, restart)

    def take(self, at: Instant | None) -> None:
        """Take the state for the last one; what it brings about has happened.

        Args:
            at: when it was; None: it does not count, but for the turns of its joints.
        """
        last = self.clock.last
        if self._back >= _SET_BACK or (at and last and at.stamp < last.stamp):
            self.set_backs += 1
        self.clock.last, self._back = at, 0
        self._last, self._this = self._this, self._last

    def _restart(self, at: Instant, dt: float, silence: float, usual: float, code: int) -> Restart:
        """Return what happened before a state whose stamp is dt [s] after the last one."""
        is_silence, is_same_arm = silence > self._timeout, not code & judge.MOVED
        # by the stamps alone a silence and a clock that was set forward look the same
        is_heard = not is_silence and (dt < 0 or at.receipt is not None)
        # two robots jump to and fro, also where both are in the same place
        if not is_silence and (dt < 0 or not is_same_arm):
            self.conflicts.append(at.seconds)
        why = restarted(dt, silence, not 0 <= dt <= self._timeout)
        jump, acts = round((dt - usual) * 1e9), is_heard and is_same_arm
        return Restart(why, is_silence, is_same_arm, acts, usual, jump)

    def _refuse_impossible(self, at: Instant, dt: float, q: Array, dq: Array, code: int) -> None:
        """Raise InvalidMessageError for a state that is too fast or too far away."""
        i, robot = code >> judge.JOINT, self._robot
        if code & judge.FAST:
            raise InvalidMessageError(
                f"the joint {robot.joints[i]} moves at {dq[i]:.3g} rad/s, more than "
                f"{_MOST_SPEED:g} times its limit"
            )
        way = abs(robot.limits.difference(q, self._last[judge.Q])[i])
        self.conflicts.append(at.seconds)
        raise InvalidMessageError(
            f"the joint {robot.joints[i]} jumps by {way:.3g} rad within {dt:g} s"
        )

    def _refuse_late(self, delay: float) -> None:
        """Raise InvalidMessageError for a state that comes too late to control by."""
        raise InvalidMessageError(
            f"the state comes {delay:.3f} s later than the best one, more than max_latency "
            f"{self._latency.most:g} s: is the network or the computer overloaded? If they stay so "
            "late, deactivate and activate; a simulation that is not in real time needs "
            "use_sim_time"
        )
