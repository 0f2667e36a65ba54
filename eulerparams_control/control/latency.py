"""How late states come, by clocks that need not agree.

What a stamp is behind the steady clock has an unknown part, which is constant but for a drift,
and a delay.  The least of it that was seen is taken for the constant, so a state is as late as
it is behind the best one.
"""

# The clocks may drift apart by this [s/s].
_DRIFT = 1e-4

# An arm that takes positions is controlled again when its states have been late for so long [s],
# without a pause of so long [s]: that is how late they are from now on.
_PATIENCE, _PAUSE = 1.0, 0.2


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
