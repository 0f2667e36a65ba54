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
from dataclasses import dataclass

import numpy as np

from eulerparams_control.laws.rotations import Array

BRIDGED = 0.02
"""For so long [s] a robot goes on without commands as if they came: as UR and Franka do."""

# Part of a limit that is rounding.
_ROUNDING = 1e-6

_TURN = 2.0 * np.pi


@dataclass(frozen=True, slots=True)
class _Asked:
    """A command that was judged: its stamp [ns], when it came and what time it took [s]; (n,).

    Its speed, and the age of that, are known in m ways (m, n).
    """

    stamp: int
    now: float
    elapsed: float  # between its stamp and the one before
    q: Array
    dq: Array
    speed: Array  # v
    age: Array  # of v at the command, twice: T, or more where it is still that of the one before


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
        zero = np.zeros_like(q)
        rest = zero[None]
        before = last or _Asked(0, now, self._dt, standing, zero, rest, rest + BRIDGED)
        elapsed = self._elapsed(before, stamp, now)
        short = min(elapsed, before.elapsed)
        long = max(short, min(elapsed, short + BRIDGED))
        change = np.abs(dq - before.dq) / long
        if last is None:  # what is measured of an arm at rest may be noisy; the period is unknown
            long, elapsed = short + BRIDGED, np.inf
        step = q - before.q
        step = np.where(self._turning, step - _TURN * np.round(step / _TURN), step)
        times, ages = rest + long, rest + long
        if short < long:
            same, way = np.full_like(before.speed, long), step * before.speed > 0.0
            same = np.clip(np.divide(step, before.speed, out=same, where=way), short, long)
            bends = np.abs(step / same - before.speed) / (0.5 * (same + before.age))
            least = bends.argmin(axis=0), np.arange(len(q))
            times = np.stack((times[0], same[least]))
            ages = np.stack((ages[0], before.age[least] + 2.0 * same[least]))
        speeds = step / times
        turns = np.abs(speeds[:, None] - before.speed) / (0.5 * (times[:, None] + before.age))
        bend = turns.min(axis=(0, 1))
        return _Asked(stamp, now, elapsed, q, dq, speeds, ages), np.maximum(change, bend)

    def _elapsed(self, before: _Asked, stamp: int, now: float) -> float:
        """Return the time [s] since a command; as usual where the clock went back."""
        if not (stamp and before.stamp):
            return max(self._dt, now - before.now)
        elapsed = (stamp - before.stamp) / 1e9
        return elapsed if elapsed > 0.0 else before.elapsed
