"""Admission of measured states: which are refused, and how much time each of the others brings.

The numbers of a state are checked in one compiled call, :func:`check_numbers`.  The joints of an
arm, and a state of it, are tables of n columns there, whose rows are named below.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from eulerparams_control.control.clock import Instant, Latency, Rate
from eulerparams_control.control.mode import SILENCE, STAMP_JUMP, Why
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.jit import Array, b1, f8, i8, jit, matrix, new_matrix, types, vector
from eulerparams_control.laws.limits import NONE, difference
from eulerparams_control.robot.robot import Robot

# A speed that is this many times its limit is measured wrongly.
_MOST_SPEED = 3.0

# Number of contradicting states, within this time [s], that are those of two robots.
_CONFLICTS, _CONTEST = 3, 1.0

# Number of stamps in a row that are behind, but rise: those of a clock that was set back.
_SET_BACK = 3

# The longest step that a law integrates over [usual periods].
_LONGEST_STEP = 3.0

# Largest distance [rad or m] of a measured position from where the last one could have led.
_MOST_ASTRAY = 0.1

# Measured positions are stuck if they stay the same to the bit while the measured speeds would have
# led this distance [rad or m] away.
_FROZEN = 0.01

# After a jump of the stamps an arm farther [rad or m] from where it was is another one, or a
# simulation that was started again: no command acts on it yet.
_SAME_ARM = 0.03

AT_REST = 0.01
"""Slower than this [rad/s or m/s] a joint is at rest."""

SAME, AGAIN, FAST, FAR, MOVED, FROZEN = (1 << bit for bit in range(6))
"""Codes of a state: it is the last one, or has its stamp; a joint is too fast, or too far from the
last state; the arm is another one; positions stay although it moves."""

# Rows of a state: positions and speeds, how far [rad or m] positions that stay should be, whole
# turns that were added to what the driver says, and whether it was seen to jump by a turn.
_Q, _DQ, _UNMOVED, _TURNS, _WRAPS = range(5)

# Rows of the joints: speeds that none has, which ones have no limit, and which of these turn.
_FASTEST, _ENDLESS, _TURNING = range(3)


class Accept(NamedTuple):
    """A new state."""

    q: Array  # (n,) positions, which go on where joints are continuous
    code: int  # what the numbers say
    dt: float = 0.0  # [s] since the last one; 0 at the first, and after a restart
    # [s] for which the command before has acted; of a state that repeats the stamp of the last one,
    # how long that has stayed
    acted: float = 0.0
    lost: float = 0.0  # [s] of dt that no law is to integrate over: states are missing
    # [s] of dt by which the stamps alone went on: no time has passed; below 0: by which they were
    # set back, and more has
    leapt: float = 0.0
    restart: Why | None = None  # a jump of the stamps, or a silence; None if it follows the last
    is_another_arm: bool = False  # the stamps jumped to an arm elsewhere
    acts: bool = False  # the last command still acts, on an arm that is where it was, after that
    step: float = 0.0  # [s] that this arm has gone on: the usual period; 0: not known
    jump: int = 0  # [ns] of the stamps beyond that


class Admission:
    """Refuses states that the robot cannot have reached, and those that come too late.

    After a gap of ``timeout`` [s] in the stamps, or a silence, the arm may be anywhere.  Unless
    ``strict`` only stamps and ages are checked.

    Attributes:
        last: when the state was that was taken last; None before the first.
        rate: of their stamps.
        set_backs: how often the clock of their stamps was set back.
    """

    def __init__(
        self, robot: Robot, timeout: float, max_latency: float, strict: bool, q: Array
    ) -> None:
        self.last: Instant | None = None
        self.rate, self.set_backs = Rate(timeout), 0
        # when [s] the last states came that contradict the ones before
        self._conflicts: deque[float] = deque(maxlen=_CONFLICTS)
        self._robot, self._timeout = robot, timeout
        self._believed = ~0 if strict else ~(FAST | FAR | FROZEN)
        endless = np.isinf(robot.limits.upper)
        fastest = _MOST_SPEED * robot.limits.velocity
        self._joints = np.array([fastest, endless, endless & ~robot.is_prismatic])
        self._before = np.zeros((_WRAPS + 1, robot.n))
        self._before[_Q] = q
        self._this = self._before  # the state that was judged, which may be taken
        self._latency = Latency(max_latency)
        self._back, self._back_at = 0, 0  # stamps in a row that are behind, and the last [ns]

    @property
    def now(self) -> float:
        """The time [s] of the last state; 0 before the first."""
        return 0.0 if self.last is None else self.last.seconds

    @property
    def is_contested(self) -> bool:
        """Whether states contradict each other again and again, as those of two robots do."""
        times = self._conflicts
        return len(times) == _CONFLICTS and self.now - times[0] < _CONTEST

    def admit(
        self, at: Instant, q: Array, dq: Array, q_c: Array | None, *, patient: bool
    ) -> Accept:
        """Return what the state q, dq (n,) measured at an instant is.

        After a gap continuous joints are nearest to q_c (n,) of the last command.  ``patient``:
        whether states that stay late are taken in the end.

        Raises:
            InvalidMessageError: unless it can be one of the robot, and of now.
            RobotError: if q or dq has not n elements.
        """
        timeout, last, receipt = self._timeout, self.last, at.receipt
        if len(q) != self._robot.n or len(dq) != self._robot.n:
            self._robot.refuse_size(q, dq)
        # how far the stamps went on, and how long no state came [s]; 0 if that is not known
        dt = 0.0 if last is None else (at.stamp - last.stamp) / 1e9
        before = None if last is None else last.receipt
        silence = 0.0 if receipt is None or before is None else receipt - before
        if -timeout < dt < 0:
            self._refuse_older(at, dt)
        is_set_back = self._back >= _SET_BACK
        if is_set_back or dt < 0:  # by another clock nothing is late
            self._latency.forget()
        is_near = 0 <= dt <= timeout
        goes_on = is_near and silence <= timeout
        is_lost = silence > timeout or (receipt is None and dt > timeout)
        near = NONE if goes_on or q_c is None else q_c
        follows = is_near and last is not None, goes_on, is_lost
        code, self._this = check_numbers(q, dq, near, self._before, self._joints, dt, follows)
        code &= self._believed
        if code & (FAST | FAR):
            self._refuse_impossible(at, dt, q, dq, code)
        if receipt is not None and (dt != 0 or last is None):
            self._refuse_late(at.stamp, receipt, patient)
        if last is not None and at.stamp == last.stamp:
            if is_set_back:  # its clock was here before
                code |= SAME
            elif not code & SAME:
                self._conflicts.append(at.seconds)
            return Accept(q, code | AGAIN, acted=silence)
        usual = self.rate.period
        self.rate.take(dt)
        q = self._this[_Q]
        acted = dt if receipt is None or 0 < dt < silence else silence
        longest = _LONGEST_STEP * usual if usual else math.inf
        if not goes_on:
            again = Accept(q, code, acted=min(silence, longest))
            return self._restarted(again, at, dt, silence, usual)
        lost = max(dt - longest, 0.0)
        if lost > 0 and receipt is not None:  # the stamps may have gone on alone
            lost = dt - min(longest, max(silence, usual))
        leapt = 0.0 if receipt is None else self._leap(dt, silence, is_set_back)
        return Accept(q, code, dt, min(acted, longest), lost, leapt)

    def take(self, at: Instant | None) -> None:
        """Take the state for the last one, as what it brings about has happened.

        Without an instant it does not count, but for the turns of its joints.
        """
        last = self.last
        if self._back >= _SET_BACK or (at and last and at.stamp < last.stamp):
            self.set_backs += 1
        self.last, self._back, self._before = at, 0, self._this

    def _leap(self, dt: float, silence: float, is_set_back: bool) -> float:
        """Return by how much more [s] the stamps went on than time, lost and late states apart."""
        if is_set_back:
            return dt - silence
        early, usual = self._latency.early, self.rate.period
        leapt = min(early, dt - max(silence, usual))
        return leapt if 0 < usual < 2 * early and usual < 2 * leapt else 0.0  # less is jitter

    def _restarted(
        self, state: Accept, at: Instant, dt: float, silence: float, usual: float
    ) -> Accept:
        """Return the state with what happened before it; its stamp is dt [s] after the last one."""
        is_silence, is_same_arm = silence > self._timeout, not state.code & MOVED
        # two robots jump to and fro, also where both are in the same place
        if not is_silence and (dt < 0 or not is_same_arm):
            self._conflicts.append(at.seconds)
        why = SILENCE._replace(note=f"a silence of joint_states of {silence:.3g} s")
        if not 0 <= dt <= self._timeout:
            why = STAMP_JUMP._replace(note=f"a jump of the stamps by {dt:.3g} s")
        return state._replace(
            restart=why,
            is_another_arm=at.receipt is not None and not (is_silence or is_same_arm),
            # by the stamps alone a silence and a clock that was set forward look the same
            acts=is_same_arm and not is_silence and (dt < 0 or at.receipt is not None),
            step=usual,
            jump=round((dt - usual) * 1e9),
        )

    def _refuse_older(self, at: Instant, dt: float) -> None:
        self._back = self._back + 1 if at.stamp > self._back_at else 1
        self._back_at = at.stamp
        self._conflicts.append(at.seconds)
        raise InvalidMessageError(
            f"the stamp goes back by {-dt:g} s: is there a second publisher of joint_states, "
            "or was its clock set?"
        )

    def _refuse_impossible(self, at: Instant, dt: float, q: Array, dq: Array, code: int) -> None:
        robot, fastest = self._robot, self._joints[_FASTEST]
        if code & FAST:
            i = int((np.abs(dq) > fastest).argmax())
            raise InvalidMessageError(
                f"the joint {robot.joints[i]} moves at {dq[i]:.3g} rad/s, more than "
                f"{_MOST_SPEED:g} times its limit"
            )
        ways = np.abs(robot.limits.difference(q, self._before[_Q]))
        i = int((ways > _MOST_ASTRAY + dt * fastest).argmax())
        self._conflicts.append(at.seconds)
        raise InvalidMessageError(
            f"the joint {robot.joints[i]} jumps by {ways[i]:.3g} rad within {dt:g} s"
        )

    def _refuse_late(self, t: int, receipt: float, patient: bool) -> None:
        delay = self._latency.of(t, receipt, patient=patient)
        if delay > self._latency.most:
            raise InvalidMessageError(
                f"the state comes {delay:.3f} s later than the best one, more than max_latency "
                f"{self._latency.most:g} s: is the network or the computer overloaded? If they "
                "stay so late, deactivate and activate; a simulation that is not in real time "
                "needs use_sim_time"
            )


_flags = types.UniTuple(b1, 3)


@jit(types.Tuple((i8, new_matrix))(vector, vector, vector, matrix, matrix, f8, _flags))
def check_numbers(
    q: Array,
    dq: Array,
    near: Array,
    before: Array,
    joints: Array,
    dt: float,
    follows: tuple[bool, bool, bool],
) -> tuple[int, Array]:
    """Return the code of the state q, dq (n,), dt [s] after the last one by the stamps; its rows.

    Joints that turn are taken nearest to ``near`` (n,); without, to the last state.  ``follows``:
    whether there is a last state, and ``dt`` is short enough to compare with it; whether there was
    no silence, either; and whether the driver may have lost its count of turns.  Then a joint that
    was never seen to jump by a turn is where it says it is: a command a turn away would move it.
    """
    code, stays, now = SAME, True, np.zeros(before.shape)
    is_next, goes_on, is_lost = follows
    for i in range(len(q)):
        is_endless = joints[_ENDLESS, i] != 0.0
        way = abs(difference(q[i], before[_Q, i], is_endless))
        if abs(dq[i]) > joints[_FASTEST, i]:
            code |= FAST
        if is_next and way > _MOST_ASTRAY + dt * joints[_FASTEST, i]:
            code |= FAR
        turns, wraps = 0.0, before[_WRAPS, i]
        if joints[_TURNING, i]:
            place = near[i] if len(near) else before[_Q, i]
            turns = np.rint((place - q[i]) / (2 * math.pi))
            if is_lost and not wraps:
                turns = 0.0
            elif not is_lost and turns != before[_TURNS, i]:
                wraps = 1.0
        now[_Q, i], now[_DQ, i] = q[i] + 2 * math.pi * turns, dq[i]
        now[_TURNS, i], now[_WRAPS, i] = turns, wraps
        stays = stays and now[_Q, i] == before[_Q, i]
        if abs(difference(now[_Q, i], before[_Q, i], is_endless)) > _SAME_ARM:
            code |= MOVED
        if not (stays and dq[i] == before[_DQ, i]):
            code &= ~SAME
    for i in range(len(q)):
        now[_UNMOVED, i] = before[_UNMOVED, i] if stays else 0.0
        if stays and goes_on and abs(dq[i]) > AT_REST:
            now[_UNMOVED, i] += dt * dq[i]
        if abs(now[_UNMOVED, i]) > _FROZEN:
            code |= FROZEN
    return code, now
