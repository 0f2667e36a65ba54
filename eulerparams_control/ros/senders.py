"""Who sends on a topic: one publisher is believed, two are not.

The graph does not tell: a node that was killed stays in it for 20 s, one that is
inactive for ever, and two may have the same name.  The messages do: each publisher numbers
its own 1, 2, 3 ..., and a number that does not follow on is that of another publisher.
Where the middleware does not tell the numbers, two names in the graph are two that send commands,
and states that contradict each other are those of two.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

UNNUMBERED = 2**64 - 1
"""The number of a message where the middleware does not tell it."""

# More commands in a row are not lost on the way: at 1 kHz, those of a command_timeout of 0.1 s.
_LOST = 100

# The same of joint_states, of which a node misses more while it is busy.
_LOST_STATES = 1000

# Who returns so often after another one, with pauses between, has not been switched back to.
_RETURNS = 2

# Number of senders that are told apart.
_MAX_SENDERS = 8


@dataclass(slots=True)
class _Sender:
    """One sequence of numbers: the last of them, and when it came [s]."""

    number: int
    heard: float


class Senders:
    """Tells apart who sends, by the numbers of the messages.

    One is listened to, the accepted one; a second one is not, until the first has been silent for
    ``pause``.  If the first speaks again within ``pause`` of the second, or they take turns
    with longer pauses, both are sending: the robot is contested, and nobody is accepted until
    all but one have been silent for ``quiet``.

    Args:
        pause: [s].
        quiet: [s].
        at_once: accept a newcomer without waiting for the silence of the first.
        lost: more messages in a row are not lost on the way.

    Attributes:
        contested: whether two are sending.
        accepted: who is; None: nobody.
    """

    def __init__(self, pause: float, quiet: float, *, at_once: bool, lost: int = _LOST) -> None:
        self._pause, self._quiet, self._at_once, self._lost = pause, quiet, at_once, lost
        self.forget()

    def forget(self) -> None:
        """Know nobody."""
        self._known: list[_Sender] = []
        self._last: _Sender | None = None  # who spoke last
        self.accepted: _Sender | None = None
        self._returns = 0
        self._unnumbered = self.contested = False

    def see(self, names: Sequence[str]) -> None:
        """Take the names of the nodes, one a publisher, that the graph shows at present."""
        if len(names) < 2:
            self.forget()
        if self._unnumbered:
            self.contested = len(set(names)) > 1

    def hear(self, number: int, now: float) -> bool:
        """Return whether to use the message of this number that came at ``now`` [s]."""
        last = self._last
        if last is not None and last is self.accepted and number == last.number + 1:
            last.number, last.heard = number, now
            return True
        if number == UNNUMBERED:
            self._unnumbered = True
            return not self.contested
        self.review(now)
        sender = self._sender_of(number, now)
        if sender is None:
            sender = _Sender(number, now)
            self._known.append(sender)
        elif last is not None and sender is not last:
            self._returns += 1
            self.contested |= now - last.heard <= self._pause or self._returns >= _RETURNS
        sender.number, sender.heard = number, now
        self._last, first = sender, self.accepted
        if self.contested:
            self.accepted = None
        elif first is None or self._at_once or now - first.heard > self._pause:
            self.accepted = sender
        return self.accepted is sender

    def review(self, now: float) -> None:
        """Forget who has been silent for long at ``now`` [s]."""
        self._known = [s for s in self._known if now - s.heard <= self._quiet][-_MAX_SENDERS:]
        if len(self._known) < 2 and not self._unnumbered:
            self.contested, self._returns = False, 0

    def _sender_of(self, number: int, now: float) -> _Sender | None:
        """Return whose last number is the nearest below this one; of equals, who spoke last.

        Who has been silent for a while, and perhaps is dead, has lost nothing since.
        """

        def may_be(s: _Sender) -> bool:
            return 0 < number - s.number <= (self._lost if now - s.heard <= self._pause else 1)

        near = filter(may_be, self._known)
        return max(near, key=lambda s: (s.number, s is self._last), default=None)


LOOK, LONG_LOOK = 0.25, 1.0
"""Time [s] for which a publisher of joint_states is listened to before it is believed: another one
at 10 Hz is heard meanwhile; the longer one where the graph shows several publishers."""

QUIET = 2.0
"""Time [s] for which all but one have to be silent before one is believed again."""


class Source:
    """Whose joint_states are believed: those of one publisher that nobody contradicts.

    One is believed after a look of :data:`LOOK`, in which no other is heard.  While two speak, a
    dispute, none is; afterwards the one that was believed before is believed again, another one
    only when it is accepted: the states of a stranger may be those that are left.

    Attributes:
        is_believed: whether something may be commanded that is made from the states.
        is_disputed: whether two speak, or the one that is left was not believed before.
        is_numbered: whether the middleware numbers the messages.
    """

    def __init__(self) -> None:
        self._senders = Senders(LOOK, QUIET, at_once=False, lost=_LOST_STATES)
        self.forget()

    def forget(self) -> None:
        """Know nobody."""
        self._senders.forget()
        self._one: object = None  # who is listened to
        self._before: object = None  # who was believed before the dispute
        self._due, self._looked_long = math.inf, False
        self.is_believed = self.is_disputed = self.is_numbered = False

    @property
    def is_contested(self) -> bool:
        """Whether two speak now; else a dispute may be ended by :meth:`accept`."""
        return self._senders.contested or not self.is_numbered

    def hear(self, number: int, now: float) -> bool:
        """Return whether the state of this number that came at ``now`` [s] may be looked at."""
        senders = self._senders
        is_accepted, one = senders.hear(number, now), senders.accepted
        if senders.contested:
            self._dispute(math.inf)
            return False
        self.is_numbered = one is not None
        if not is_accepted:
            return False
        if self.is_disputed and self.is_numbered:
            if self._before not in (None, one):
                return False
            self._believe(one, now, is_sure=True)
        elif self._due == math.inf or one is not self._one:
            self._believe(one, now + LOOK)
        return True

    def contradict(self, now: float) -> None:
        """Note that what came at ``now`` [s] cannot be of the robot of the state before."""
        if self.is_believed or self.is_disputed:
            self._dispute(now + QUIET)
        else:
            self._due = now + LOOK

    def look(self, now: float, has_several: Callable[[], bool]) -> bool:
        """Return whether the states are believed at ``now`` [s], steady clock.

        ``has_several`` returns whether the graph shows several publishers.
        """
        if self.is_believed:
            return True
        if now < self._due or (self.is_disputed and self.is_numbered):
            return False
        if not self.is_disputed and not self._looked_long and has_several():
            self._due, self._looked_long = self._due + LONG_LOOK - LOOK, True
            return self.look(now, has_several)
        self.is_believed, self.is_disputed = True, False
        return True

    def accept(self, now: float) -> None:
        """Believe the one that is left, although it was not believed before the dispute."""
        if self.is_disputed and not self.is_contested:
            self._believe(self._senders.accepted, now, is_sure=True)

    def _believe(self, one: object, due: float, *, is_sure: bool = False) -> None:
        """Listen to one, and believe it from a time on [s], without a longer look if it is sure."""
        self._one, self._due, self._looked_long = one, due, is_sure
        self.is_believed = self.is_disputed = False

    def _dispute(self, due: float) -> None:
        """Believe nobody until a time [s]."""
        if self.is_believed:
            self._before = self._one
        self.is_believed, self.is_disputed, self._due = False, True, due
