"""Time: how states age, how often they come, and which clock counts.

Where time is real a state ages by when it came, on the steady clock.  Where time is simulated,
in lock-step say, only its stamp counts.  :class:`Instant` alone knows which.
"""

import math
import time
from collections.abc import Callable
from enum import IntEnum
from statistics import median
from typing import NamedTuple

from eulerparams_control.control.mode import SEND_AGAIN, Cause, Why
from eulerparams_control.laws.scheme import LoopGain, Scheme

# Steps after which a period is known, and after which its lower bound is; the factor of jitter of
# that bound; the part of the difference by which a period follows further steps.
_FIRST, _FEW, _JITTER, _SMOOTHING = 9, 3, 1.5, 0.02

# A step of the stamps [s] that is longer is a jump of the clock, not a loss of messages; one that
# is longer than the other is not the period of a robot.
_LONGEST_LOSS, _LONGEST_PERIOD = 0.5, 10.0

# Two clocks may drift apart by this [s/s], a slewed one included.
_DRIFT = 1.5e-3

# States that have come late for the first time [s], without a pause of the second time [s], are the
# new normal: the clock of the robot was set, or the network is slower now.
_PATIENCE, _PAUSE = 1.0, 0.2

# Efforts tolerate no delay: for them the lateness has to last for the first time [s], and to be
# constant within the second [s].  That of a clock is; that of an overloaded network is not.
_LONG_PATIENCE, _STEADY = 10.0, 0.02

# Largest angles [rad] by which the loop of a gain may turn within a period: beyond the first it is
# not stable, with some room for the error of the measured period; beyond the second it is another
# loop.  Then the part of the timeout of silence that a period may last, and the part of its bound
# at which a verdict ends.
_MOST_TURN, _FINE_TURN, _OF_TIMEOUT, _CLEAR = 1.05, 0.5, 0.9, 0.85


class SteadyClock:
    """The clock that never jumps; a simulation in one process may make its time."""

    def __init__(self) -> None:
        self.now: Callable[[], float] = time.monotonic  # returns the time [s]

    def go_by(self, now: Callable[[], float] = time.monotonic) -> None:
        """Let ages go by another clock; without one, by that of the computer again."""
        self.now = now


steady = SteadyClock()


class Instant(NamedTuple):
    """When a state was."""

    stamp: int  # [ns]
    receipt: float | None  # when it came, steady clock [s]; None where time is simulated

    @property
    def seconds(self) -> float:
        """The time [s] that counts."""
        return self.stamp / 1e9 if self.receipt is None else self.receipt


class _Verdict(IntEnum):
    FINE = 0
    BLIND = 1  # a hand that lets go may make the tip too fast
    LOW = 2  # the law is not what it would be in continuous time
    TOO_LOW = 3  # the law is not stable
    TOO_RARE = 4  # each state comes after a silence


class Rate:
    """How often states come, and whether that is enough for the gains and the timeout of silence.

    A loop of the rate k is stable with steps dt of k dt < 1; below 0.5 it does what it would in
    continuous time.  A verdict is left only when it is clear of its bound, so that jitter does not
    toggle it.

    Attributes:
        period: [s] the usual time between two stamps, whatever is lost or late; 0 until it is
            known.
        least: [s] it is no shorter than that; 0 while nothing is known.
        missed: states that never came: gaps in their stamps, in usual periods.
        why: the arm is to be held, or a warning; Why() where the rate is fine.
    """

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout  # of silence [s]
        self.period = self.least = 0.0
        self.missed = 0
        self.why = Why()
        self._steps: list[float] = []  # the first ones
        self._verdict = _Verdict.FINE, False  # and whether the period was known

    def take(self, step: float) -> None:
        """Follow a step [s] of the stamps."""
        if not 0.0 < step < _LONGEST_PERIOD:
            return
        if len(self._steps) < _FIRST:
            self._steps.append(step)
            if len(self._steps) == _FIRST:
                self.period = self.least = median(self._steps)
            elif len(self._steps) >= _FEW:
                self.least = min(self._steps) / _JITTER
            return
        usual = self.period
        if 1.5 * usual <= step < _LONGEST_LOSS:
            self.missed += round(step / usual) - 1
        step = min(max(step, usual / 2.0), 2.0 * usual)
        self.period = self.least = usual + _SMOOTHING * (step - usual)

    @property
    def is_too_low(self) -> bool:
        """Whether nothing may move."""
        return self._verdict[0] >= _Verdict.TOO_LOW

    def judge(self, scheme: Scheme) -> None:
        """Judge the period for the fastest gain of a law, and for what holds the arm.

        A rate that is too low even for the latter is reported before the period is known.
        """
        period, verdict, is_known = self.period, _Verdict.FINE, self.period > 0
        if not is_known and scheme.hold_rate * self.least > 1:
            period = self.least
        turn = scheme.loop_rate * period
        if period > self._bound(_Verdict.TOO_RARE, _OF_TIMEOUT * self._timeout):
            verdict = _Verdict.TOO_RARE
        elif turn > self._bound(_Verdict.TOO_LOW, _MOST_TURN):
            verdict = _Verdict.TOO_LOW
        elif turn > self._bound(_Verdict.LOW, _FINE_TURN):
            verdict = _Verdict.LOW
        elif scheme.release_rate * period > self._bound(_Verdict.BLIND, 1.0):
            verdict = _Verdict.BLIND
        if (verdict, is_known) == self._verdict:
            return
        self._verdict, self.why, gain = (verdict, is_known), Why(), scheme.fastest_gain
        if verdict is _Verdict.TOO_RARE:
            self.why = too_rare(period, self._timeout)
        elif verdict is _Verdict.BLIND:
            self.why = blind(period, scheme.release_rate)
        elif verdict is not _Verdict.FINE and gain is not None:
            self.why = too_slow(period, gain, is_held=self.is_too_low)

    def _bound(self, verdict: _Verdict, bound: float) -> float:
        """Return the bound of a verdict, which is lower while it lasts."""
        return _CLEAR * bound if verdict is self._verdict[0] else bound


def too_rare(period: float, timeout: float) -> Why:
    """Return why an arm is held whose states come every period [s], one after each timeout [s]."""
    return Why(
        Cause.RATE_TOO_LOW,
        f"joint_states come every {period:.3g} s, but state_timeout is {timeout:g} s: each one "
        "comes after a silence",
        f"let the driver publish {2 / timeout:.3g} times a second or more, or set state_timeout "
        f"to {2 * period:.2g} s; then {SEND_AGAIN}",
    )


def too_slow(period: float, gain: LoopGain, *, is_held: bool) -> Why:
    """Return why an arm is held, or is to be, whose states come every period [s] for a gain."""
    text = (
        f"joint_states come {1 / period:.3g} times a second, too seldom for {gain.name} "
        f"{gain.value:g}, whose loop has {gain.rate:.3g} 1/s"
    )
    remedy = (
        f"let the driver publish {gain.rate / _FINE_TURN:.3g} times a second or more, or set "
        f"{gain.name} to {gain.at(_FINE_TURN / period):.3g} or less"
    )
    if is_held:
        return Why(Cause.RATE_TOO_LOW, text, f"{remedy}; then {SEND_AGAIN}")
    return Why(remedy=remedy, note=text)


def blind(period: float, rate: float) -> Why:
    """Return what an arm is not safe from whose states come every period [s]."""
    return Why(
        remedy=f"let the driver publish {rate:.3g} times a second or more, or set rotor_inertia "
        "where the rotors are known",
        note=f"joint_states come {1 / period:.3g} times a second: until the next one comes a hand "
        "that leaned on the arm with a fifth of what its joints hold, and lets go, may make the "
        "tip faster than max_linear_speed",
    )


class Latency:
    """Tells which states are too old to control by, by clocks that need not agree.

    What a stamp is behind the steady clock has an unknown part, which is constant but for a
    drift, and a delay.  The least of it that was seen is taken for the constant, so a state is as
    late as it is behind the best one.

    Attributes:
        most: [s] by which a state may be later than the best one.
        early: [s] by which the last state was earlier than the best one before: stamps that go on
            alone make it so, but not those of a state that follows on late ones.
    """

    def __init__(self, most: float) -> None:
        self.most = most
        self.forget()

    def forget(self) -> None:
        """Start again: another clock makes the stamps."""
        self.early = 0.0
        self._best, self._at = math.nan, 0.0  # the least that a state was behind; the last receipt
        # since when states are late, and the least and the most that they were behind since
        self._since, self._low, self._high = 0.0, math.inf, -math.inf

    def of(self, t: int, now: float, *, patient: bool) -> float:
        """Return how late [s] the state stamped t [ns] is that comes at ``now`` [s].

        ``patient``: whether states that stay late are accepted soon.
        """
        behind = now - t / 1e9
        if math.isnan(self._best):
            self._best, self._at = behind, now
        pause = now - self._at
        best = self._best + _DRIFT * pause
        self._best, self.early, self._at = min(behind, best), max(best - behind, 0.0), now
        late = behind - self._best
        if late <= self.most or pause > _PAUSE:
            self._since, self._low, self._high = now, math.inf, -math.inf
            return late
        self._low, self._high = min(self._low, behind), max(self._high, behind)
        if not patient and self._high - self._low > _STEADY:
            self._since, self._low, self._high = now, behind, behind
        elif now - self._since > (_PATIENCE if patient else _LONG_PATIENCE):
            self._best = self._low
            return behind - self._low
        return late
