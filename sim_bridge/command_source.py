"""The order of commands."""


class StampOrder:
    """Tells commands that come too late by their stamps, which grow from one to the next.

    Stamps that stay older for longer than ``patience`` are those of a clock that went back,
    and are taken from then on.  The stamp 0 says nothing.  A command of the same stamp as the
    last one replaces it: the last word of a controller answers a state that it has answered.

    Args:
        patience: [s].
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._newest = 0
        self._since: float | None = None  # when the first of the older stamps came [s]

    def is_late(self, stamp: int, now: float) -> bool:
        """Return whether a command stamped so [ns], which came at ``now`` [s], is too late."""
        if stamp == 0:
            return False
        if stamp < self._newest:
            if self._since is None:
                self._since = now
            if now - self._since <= self._patience:
                return True
        self._newest, self._since = stamp, None
        return False
