"""The accelerations that position commands ask for: beyond its own, a robot stops by itself.

A robot that is sent q and dq sees a speed in two ways: as commanded, and as the difference of two
positions over the time between them.  Either that changes faster than ``limit`` is too sudden:

    |dq_k - dq_k-1| / T_k,    |v_k - v_k-1| / ((T_k + T_k-1) / 2),    v_k = (q_k - q_k-1) / T_k.

T_k is the difference of the stamps, the states that both answer, so that how late a command comes
does not matter; without stamps, that of their arrivals.  Where states were missed it is open for
how long the robot went on in between: T_k is at most ``BRIDGED`` longer than the usual period, or
what is best for the command down to the period, and the next command may go on from either.  So a
controller that steps over a long gap is found, one that leaves out what was missed is not.
"""

from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.rotations import Array

BRIDGED = 0.02
"""Time [s] for which a robot without commands goes on as if they came: as UR and Franka do."""

# Part of a limit that is rounding.
_ROUNDING = 1e-6

_TURN = 2.0 * np.pi


class _Asked(NamedTuple):
    """A command that was judged: its stamp [ns], when it came and what time it took [s]; (n,).

    Its speed, and the age of that, one for all joints or (n,), are known in m ways.
    """

    stamp: int
    now: float
    elapsed: float  # between its stamp and the one before
    q: Array
    dq: Array
    speeds: Sequence[Array]  # v
    ages: Sequence[Array | float]  # of v, twice: T, or more where it is still that before


class CommandAcceleration:
    """Judges position commands one after the other: those that act, one a step of the robot.

    Args:
        joints: names of the n joints.
        limit: (n,) [rad/s^2 or m/s^2]; inf is none.
        turning: (n,) whether a joint takes positions modulo a turn.
        prismatic: whether each joint slides.
        dt: shortest time between two commands without stamps [s].
    """

    def __init__(
        self,
        joints: Sequence[str],
        limit: Array,
        turning: Array,
        prismatic: Sequence[bool],
        dt: float,
    ) -> None:
        self._joints, self._limit, self._dt = tuple(joints), limit, dt
        self._turning, self._prismatic = turning, tuple(prismatic)
        self._may_turn = bool(turning.any())
        self._zero = np.zeros(len(limit))
        self.rest()

    def rest(self) -> None:
        """Judge the next command as the first one of an arm at rest."""
        self._last: _Asked | None = None
        self._before: _Asked | None = None

    def judge(self, q: Array, dq: Array, stamp: int, now: float, standing: Array) -> str:
        """Return which joint a command asks for too much of; "" if none.

        Args:
            q, dq: (n,) the command [rad, rad/s].
            stamp: of it [ns]; 0 says nothing.
            now: when it came [s].
            standing: (n,) where the arm is [rad], if this is the first command.
        """
        last = self._last
        if last is not None and stamp == last.stamp != 0:
            last = self._before  # whose state was answered before: this one takes its place
        asked, acceleration = self._compare(last, standing, q, dq, stamp, now)
        self._before, self._last = last, asked
        excess = acceleration / self._limit
        worst = int(excess.argmax())
        if excess[worst] <= 1.0 + _ROUNDING:
            return ""
        unit = "m/s^2" if self._prismatic[worst] else "rad/s^2"
        return (
            f"joint '{self._joints[worst]}' was asked for {acceleration[worst]:.4g} {unit}; "
            f"the most is {self._limit[worst]:.4g} {unit}"
        )

    def _compare(
        self, last: _Asked | None, standing: Array, q: Array, dq: Array, stamp: int, now: float
    ) -> tuple[_Asked, Array]:
        """Return a command, and the acceleration (n,) that it asks for after the last one."""
        zero = self._zero
        before = last or _Asked(0, now, self._dt, standing, zero, [zero], [BRIDGED])
        elapsed = self._elapsed(before, stamp, now)
        short = min(elapsed, before.elapsed)
        long = max(short, min(elapsed, short + BRIDGED))
        change = np.abs(dq - before.dq) / long
        if last is None:  # what is measured of an arm at rest may be noisy; the period is unknown
            long, elapsed = short + BRIDGED, np.inf
        step = q - before.q
        if self._may_turn:
            step = np.where(self._turning, step - _TURN * np.round(step / _TURN), step)
        times: list[Array | float] = [long]
        ages: list[Array | float] = [long]
        if short < long:
            speed, age = np.array(before.speeds), np.array([zero + age for age in before.ages])
            same, way = np.full_like(speed, long), step * speed > 0.0
            same = np.clip(np.divide(step, speed, out=same, where=way), short, long)
            bends = np.abs(step / same - speed) / (0.5 * (same + age))
            least = bends.argmin(axis=0), np.arange(len(q))
            times.append(same[least])
            ages.append(age[least] + 2.0 * same[least])
        speeds = [step / time for time in times]
        bend = reduce(
            np.minimum,
            (
                np.abs(v - v_before) / (0.5 * (time + age))
                for v, time in zip(speeds, times, strict=True)
                for v_before, age in zip(before.speeds, before.ages, strict=True)
            ),
        )
        return _Asked(stamp, now, elapsed, q, dq, speeds, ages), np.maximum(change, bend)

    def _elapsed(self, before: _Asked, stamp: int, now: float) -> float:
        """Return the time [s] since a command; as usual where the clock went back."""
        if not (stamp and before.stamp):
            return max(self._dt, now - before.now)
        elapsed = (stamp - before.stamp) / 1e9
        return elapsed if elapsed > 0.0 else before.elapsed
