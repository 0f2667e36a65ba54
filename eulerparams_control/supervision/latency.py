"""How late states come, by clocks that need not agree.

What a stamp is behind the steady clock has an unknown part, which is constant but for a drift,
and a delay.  The least of it that was seen is taken for the constant, so a state is as late as
it is behind the best one.
"""

# The clocks may drift apart by this [s/s].
_DRIFT = 1e-3

# States that have all been late for this long [s] are what there is from now on.
_PATIENCE = 1.0


class Latency:
    """Tells which states are too old to control by.

    Args:
        most: [s] by which a state may be later than the best one.
    """

    def __init__(self, most: float) -> None:
        self.most = most
        self.forget()

    def forget(self) -> None:
        """Begin anew: another clock makes the stamps."""
        self._least: float | None = None
        self._at = 0.0  # when that was seen, or when states were last in time
        self._in_time = 0.0

    def of(self, t: int, now: float) -> float:
        """Return how late [s] the state stamped t [ns] is that comes at ``now`` [s]."""
        behind = now - t / 1e9
        if self._least is None:
            self._least, self._at, self._in_time = behind, now, now
        self._least = min(behind, self._least + _DRIFT * (now - self._at))
        self._at = now
        late = behind - self._least
        if late <= self.most:
            self._in_time = now
        elif now - self._in_time > _PATIENCE:
            self._least, self._in_time = behind, now
            return 0.0
        return late
