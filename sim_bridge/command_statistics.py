"""What happened to the commands of the last second, and how fast time went."""

from collections.abc import Mapping


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
        """Return what /diagnostics shows of the time since the last report, and begin anew.

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
