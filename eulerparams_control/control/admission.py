"""Which measured states are believed, and what they say of the time between them."""

from typing import NamedTuple

import numpy as np

from eulerparams_control.control.clock import Clock, Instant
from eulerparams_control.control.mode import Why, restarted
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import Robot

AT_REST = 0.01
"""Slower than this [rad/s or m/s] a joint is at rest."""

# A measured position may be this far [rad or m] from where the last one could have led, a speed
# this many times its limit: further, it is the measurement that is wrong.
_MOST_ASTRAY, _MOST_SPEED = 0.1, 3.0

# So many stamps in a row that are behind, but rise, are those of a clock that was set back.
_SET_BACK = 3

# Measured positions that stay the same to the bit, while the measured speeds would have led this
# far [rad or m] away, are not measured any more.
_FROZEN = 0.01

# After a jump of the stamps an arm farther [rad or m] from where it was is another one, or a
# simulation that was started again: no command acts on it yet.
_SAME_ARM = 0.03

# Two clocks may drift apart by this [s/s].
_DRIFT = 1e-4

# An arm that takes positions is controlled again when its states have been late for so long [s],
# without a pause of so long [s]: that is how late they are from now on.
_PATIENCE, _PAUSE = 1.0, 0.2


class Repeat(NamedTuple):
    """A state with the stamp of the last one.

    Attributes:
        is_same: whether it says the same.
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
    """

    why: Why
    is_silence: bool
    is_same_arm: bool
    acts: bool


class Accept(NamedTuple):
    """A new state.

    Attributes:
        dt: [s] since the last one; 0 at the first, and after a restart.
        acted: [s] for which the command before has acted.
        is_first: whether it is the first.
        restart: what happened before it; None if it follows the last one.
        is_frozen: whether its positions are not measured ones: they stay although the arm moves.
    """

    dt: float
    acted: float
    is_first: bool
    restart: Restart | None
    is_frozen: bool


class Latency:
    """Tells which states are too old to control by, by clocks that need not agree.

    What a stamp is behind the steady clock has an unknown part, which is constant but for a
    drift, and a delay.  The least of it that was seen is taken for the constant, so a state is as
    late as it is behind the best one.

    Args:
        most: [s] by which a state may be later than the best one.
    """

    def __init__(self, most: float) -> None:
        self.most = most
        self.forget()

    def forget(self) -> None:
        """Start again: another clock makes the stamps."""
        self._least: float | None = None
        self._at = self._late_since = 0.0  # [s] when a state came last, and the first late one

    def of(self, t: int, now: float, *, patient: bool) -> float:
        """Return how late [s] the state stamped t [ns] is that comes at ``now`` [s].

        Args:
            t: stamp [ns].
            now: when it came, steady clock [s].
            patient: whether states that stay late are those of a clock that was set back.
        """
        behind = now - t / 1e9
        if self._least is None:
            self._least, self._at = behind, now
        pause = now - self._at
        self._least, self._at = min(behind, self._least + _DRIFT * pause), now
        late = behind - self._least
        if late <= self.most or pause > _PAUSE:
            self._late_since = now
        elif patient and now - self._late_since > _PATIENCE:
            self._least = behind
            return 0.0
        return late


class Admission:
    """Refuses states that the robot cannot have reached, and those that come too late.

    Args:
        robot: the arm.
        timeout: [s] gap in the stamps, or silence, after which the arm may be anywhere.
        max_latency: [s] by which a state may come later than the best one did.
        strict: whether positions and speeds are checked; else stamps and ages only.

    Attributes:
        clock: of the states that were taken.
    """

    def __init__(self, robot: Robot, timeout: float, max_latency: float, strict: bool) -> None:
        self.clock = Clock()
        self._robot, self._timeout, self._strict = robot, timeout, strict
        self._latency = Latency(max_latency)
        self._q, self._dq = np.zeros(robot.n), np.zeros(robot.n)  # of the last state
        self._back, self._back_at = 0, 0  # stamps in a row that are behind, and the last [ns]
        self._unmoved = np.zeros(robot.n)  # how far [rad or m] positions that stay should be

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
            raise InvalidMessageError(
                f"the stamp goes back by {-dt:g} s; is there a second publisher of joint_states?"
            )
        if self._back >= _SET_BACK:  # stamps that are behind, but go on: nothing is late
            self._latency.forget()
        self._back = 0
        if self._strict:
            self._refuse_impossible(dt, q, dq)
        if at.receipt is not None and (dt != 0 or self.clock.last is None):
            self._refuse_late(at.stamp, dt, at.receipt, patient)

    def admit(self, at: Instant, q: Array, dq: Array) -> Accept | Repeat:
        """Say what a state is that is not refused: q, dq (n,) measured at an instant."""
        clock, timeout = self.clock, self._timeout
        (dt, silence), last, restart = clock.step(at), clock.last, None
        if last is not None and at.stamp == last.stamp:
            return Repeat(np.array_equal(q, self._q) and np.array_equal(dq, self._dq), silence)
        if not (0 <= dt <= timeout and silence <= timeout):
            moved = self._robot.limits.deviation(q, self._q)
            # by the stamps alone a silence and a clock that was set forward look the same
            is_heard = silence <= timeout and (dt < 0 or at.receipt is not None)
            is_same = bool((moved <= _SAME_ARM).all())
            why = restarted(dt, silence, not 0 <= dt <= timeout)
            restart = Restart(why, silence > timeout, is_same, is_heard and is_same)
            dt = 0.0
        is_frozen = last is not None and self._strict and self._is_frozen(dt, q, dq)
        acted = dt
        if at.receipt is not None:
            acted = min(dt, silence) if dt > 0 else silence
        return Accept(dt, acted, last is None, restart, is_frozen)

    def take(self, at: Instant, q: Array, dq: Array) -> None:
        """Take a state for the last one; what it brings about has happened."""
        self.clock.last, self._q, self._dq = at, q, dq

    def _is_frozen(self, dt: float, q: Array, dq: Array) -> bool:
        if (q != self._q).any():
            self._unmoved = np.zeros(self._robot.n)
            return False
        self._unmoved = self._unmoved + dt * np.where(np.abs(dq) > AT_REST, dq, 0.0)
        return bool(np.abs(self._unmoved).max() > _FROZEN)

    def _refuse_impossible(self, dt: float, q: Array, dq: Array) -> None:
        """Raise InvalidMessageError for a state that is too fast or too far away."""
        robot = self._robot
        fast = np.abs(dq) > _MOST_SPEED * robot.limits.velocity
        if fast.any():
            i = int(np.argmax(fast))
            raise InvalidMessageError(
                f"the joint {robot.joints[i]} moves at {dq[i]:.3g} rad/s, more than "
                f"{_MOST_SPEED:g} times its limit"
            )
        if self.clock.last is None or not 0 <= dt <= self._timeout:
            return
        moved = robot.limits.deviation(q, self._q)
        far = moved > _MOST_ASTRAY + _MOST_SPEED * dt * robot.limits.velocity
        if far.any():
            i = int(np.argmax(far))
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
