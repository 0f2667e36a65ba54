"""Sources of commands: one controller is obeyed, two are not; and the order of commands.

The graph does not tell: a controller that was killed stays in it for 20 s, one that is
inactive for ever, and two may have the same name.  The messages do: each publisher numbers
its own 1, 2, 3 ..., and a number that does not follow on is that of another publisher.
Where the middleware does not tell the numbers, two names in the graph are two that send.
"""

from collections.abc import Sequence
from dataclasses import dataclass

UNNUMBERED = 2**64 - 1
"""The number of a message where the middleware does not tell it."""

# More messages in a row are not lost on the way: at 1 kHz, those of a command_timeout of 0.1 s.
_LOST = 100

# Who returns so often after another one, with pauses between, has not been switched back to.
_RETURNS = 2

# Number of senders that are told apart.
_MOST = 8


@dataclass(slots=True)
class _Sender:
    """One sequence of numbers: the last of them, and when it came [s]."""

    number: int
    heard: float


class Senders:
    """Tells apart who sends, by the numbers of the messages.

    One is listened to, the heeded; a second one is not, until the first has been silent for
    ``pause``.  If the first speaks again within ``pause`` of the second, or they take turns
    with longer pauses, both are sending: the robot is contested, and nobody is heeded until
    all but one have been silent for ``quiet``.

    Args:
        pause: [s].
        quiet: [s].
        at_once: heed who is new without waiting for the silence of the first.

    Attributes:
        contested: whether two are sending.
    """

    def __init__(self, pause: float, quiet: float, *, at_once: bool) -> None:
        self._pause, self._quiet, self._at_once = pause, quiet, at_once
        self.forget()

    def forget(self) -> None:
        """Know nobody."""
        self._known: list[_Sender] = []
        self._last: _Sender | None = None  # who spoke last
        self._heeded: _Sender | None = None
        self._returns = 0
        self._unnumbered = False
        self.contested = False

    def see(self, names: Sequence[str]) -> None:
        """Take the names of the nodes, one a publisher, that the graph shows at present."""
        if len(names) < 2:
            self.forget()
        if self._unnumbered:
            self.contested = len(set(names)) > 1

    def hear(self, number: int, now: float) -> bool:
        """Return whether to heed the message of this number that came at ``now`` [s]."""
        last = self._last
        if last is not None and last is self._heeded and number == last.number + 1:
            last.number, last.heard = number, now
            return True
        return self._distinguish(number, now)

    def review(self, now: float) -> None:
        """Forget who has been silent for long at ``now`` [s]."""
        self._known = [s for s in self._known if now - s.heard <= self._quiet][-_MOST:]
        if len(self._known) < 2 and not self._unnumbered:
            self.contested, self._returns = False, 0

    def _distinguish(self, number: int, now: float) -> bool:
        """Do as ``hear`` where it is not plain that the last sender goes on."""
        if number == UNNUMBERED:
            self._unnumbered = True
            return not self.contested
        self.review(now)
        sender = self._sender_of(number, now)
        if sender is None:
            sender = _Sender(number, now)
            self._known.append(sender)
        elif sender is not self._last and self._last is not None:
            self._returns += 1
            soon = now - self._last.heard <= self._pause
            self.contested |= soon or self._returns >= _RETURNS
        sender.number, sender.heard = number, now
        self._last = sender
        if self.contested:
            self._heeded = None
        elif self._may_follow(self._heeded, sender, now):
            self._heeded = sender
        return self._heeded is sender

    def _may_follow(self, first: _Sender | None, sender: _Sender, now: float) -> bool:
        """Whether a sender may be heeded instead of, or as, the first."""
        if first is None or first is sender or self._at_once:
            return True
        return now - first.heard > self._pause

    def _sender_of(self, number: int, now: float) -> _Sender | None:
        """Return whose last number is the nearest below this one; of equals, who spoke last.

        Who has been silent for a while, and perhaps is dead, has lost nothing since.
        """

        def may_be(s: _Sender) -> bool:
            return 0 < number - s.number <= (_LOST if now - s.heard <= self._pause else 1)

        near = [s for s in self._known if may_be(s)]
        return max(near, key=lambda s: (s.number, s is self._last), default=None)


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
