"""How often states come, how soon they are answered, and which gaps there were."""

from collections import deque
from statistics import quantiles

from eulerparams_control.control.clock import steady

# Of so many answers the latencies are remembered.
_REMEMBERED = 2000

# A step of the stamps [ns] that is longer is a jump of the clock, not a loss of messages.
_LONGEST_GAP = 500_000_000

# The usual step follows the steps by this part of the difference.
_SMOOTHING = 0.01


class Meter:
    """Counts over the time since it was read last.

    Attributes:
        missed: states that never came: gaps in their stamps, in usual steps.
        answers: how many states were answered between the last two readings.
    """

    def __init__(self) -> None:
        self._latencies: deque[float] = deque(maxlen=_REMEMBERED)
        self._states, self._since = 0, steady()
        self._came: float | None = None
        self._longest = 0.0
        self._stamp: int | None = None
        self._usual = 0.0  # step of the stamps [ns]
        self.missed = self.answers = 0

    def state(self, stamp: int, now: float) -> None:
        """Count a state stamped so [ns] that came at ``now`` [s]."""
        self._states += 1
        if self._came is not None:
            self._longest = max(self._longest, now - self._came)
        self._came = now
        step = stamp - self._stamp if self._stamp is not None else 0
        self._stamp = stamp
        if 0 < step < _LONGEST_GAP:
            self._usual = self._usual or step
            self.missed += max(round(step / self._usual) - 1, 0)
            self._usual += _SMOOTHING * (min(step, 2 * self._usual) - self._usual)

    def answered(self, came: float) -> None:
        """Count the answer to a state that came at ``came`` [s]."""
        self._latencies.append(steady() - came)

    def read(self) -> dict[str, float | int]:
        """Return the figures since it was read last, and begin anew."""
        now = steady()
        seconds = max(now - self._since, 1e-9)
        figures: dict[str, float | int] = {
            "joint_states per second": self._states / seconds,
            "answers per second": len(self._latencies) / seconds,
            "longest gap of joint_states [ms]": 1e3 * self._longest,
            "joint_states missed": self.missed,
        }
        if len(self._latencies) > 1:
            cuts = quantiles(self._latencies, n=100)
            figures |= {"latency p50 [ms]": 1e3 * cuts[49], "latency p99 [ms]": 1e3 * cuts[98]}
        self.answers = len(self._latencies)
        self._latencies.clear()
        self._states, self._since, self._longest = 0, now, 0.0
        return figures
