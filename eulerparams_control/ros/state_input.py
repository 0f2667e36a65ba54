"""The newest joint_states: read, aged, counted, and answered once."""

from collections import deque
from statistics import quantiles
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState

from eulerparams_control.control.clock import steady
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import JointStateReader

# joint_states that came within this time [s] at least are fresh.
_FRESH = 0.1

# In simulated time joint_states have stopped after so much [s] of the steady clock.
_SIMULATION_STANDS = 0.5

# Of so many answers the latencies are remembered.
_REMEMBERED = 2000

# A step of the stamps [ns] that is longer is a jump of the clock, not a loss of messages.
_LONGEST_GAP = 500_000_000

# The usual step follows the steps by this part of the difference.
_SMOOTHING = 0.01


class StateInput:
    """Takes joint_states, and knows whether they still come.

    Attributes:
        measured: stamp [ns], q, dq (n,) of the last valid ones; None before the first.
        unanswered: their stamp as it came; None when they are answered.
        came: when the last valid ones came, steady clock [s].
        repeats: whether the last ones said the same as those before, stamp included.
        is_commanded: whether a command has answered one since it was forgotten.
        missed: states that never came: gaps in their stamps, in usual steps.
        answers: how many states were answered between the last two readings.
    """

    def __init__(self) -> None:
        self._reader: JointStateReader | None = None
        self.came = 0.0
        self._latencies: deque[float] = deque(maxlen=_REMEMBERED)
        self._count, self._longest, self._read_at = 0, 0.0, steady()
        self._usual = 0.0  # step of the stamps [ns]
        self.missed = self.answers = 0
        self.forget()

    def expect(self, joints: tuple[str, ...], needs_velocity: bool) -> None:
        """Read these joints from now on."""
        self._reader = JointStateReader(joints, needs_velocity)

    def forget(self) -> None:
        """Forget the last state."""
        self.measured: tuple[int, Array, Array] | None = None
        self.unanswered: Time | None = None
        self.is_commanded = self.repeats = False
        self._answered = self._before = 0.0  # when those came that were answered last [s]

    def take(self, msg: JointState) -> tuple[int, Array, Array]:
        """Return stamp [ns], q and dq (n,) of a message; raises InvalidMessageError."""
        assert self._reader is not None
        now, last = steady(), self.measured
        t, q, _ = self.measured = self._reader.from_ros(msg)
        self.repeats = last is not None and t == last[0] and np.array_equal(q, last[1])
        self.unanswered = msg.header.stamp
        self._count += 1
        if self.came:
            self._longest = max(self._longest, now - self.came)
        step = t - last[0] if last is not None else 0
        if 0 < step < _LONGEST_GAP:
            self._usual = self._usual or step
            self.missed += max(round(step / self._usual) - 1, 0)
            self._usual += _SMOOTHING * (min(step, 2 * self._usual) - self._usual)
        self._before, self.came = self.came, now
        return self.measured

    def refused(self) -> None:
        """Take the last state for one that never came."""
        self.came = self._before

    def answered(self, *, is_commanded: bool) -> None:
        """Count the answer to the last state, which may be that nothing is commanded."""
        self._answered = self.came
        if is_commanded:
            self.is_commanded = True
            self._latencies.append(steady() - self.came)

    def silence(self) -> float:
        """Return how long no valid ones came [s]."""
        return steady() - self.came

    def timeout(self, timeout: float, is_simulated: bool) -> float:
        """Return after which silence [s] they have stopped; simulated time may stand still."""
        return max(timeout, _SIMULATION_STANDS) if is_simulated else timeout

    def is_silent(self, timeout: float, is_simulated: bool) -> bool:
        """Return whether they have stopped."""
        return self.silence() > self.timeout(timeout, is_simulated)

    def is_stale(self, timeout: float) -> bool:
        """Return whether the last valid ones are not of now."""
        return self.silence() > max(timeout, _FRESH)

    def is_followed(self, timeout: float) -> bool:
        """Return whether a robot that was commanded still tells its state."""
        return self.is_commanded and steady() - self._answered <= max(timeout, _FRESH)

    def read(self) -> dict[str, Any]:
        """Return the figures since it was read last, and start again."""
        now = steady()
        seconds = max(now - self._read_at, 1e-9)
        figures: dict[str, float | int] = {
            "joint_states per second": self._count / seconds,
            "answers per second": len(self._latencies) / seconds,
            "longest gap of joint_states [ms]": 1e3 * self._longest,
            "joint_states missed": self.missed,
        }
        if len(self._latencies) > 1:
            cuts = quantiles(self._latencies, n=100)
            figures |= {"latency p50 [ms]": 1e3 * cuts[49], "latency p99 [ms]": 1e3 * cuts[98]}
        self.answers = len(self._latencies)
        self._latencies.clear()
        self._count, self._read_at, self._longest = 0, now, 0.0
        return figures
