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

from eulerparams_control.control.mode import Why, contested, replaced
from eulerparams_control.errors import InvalidMessageError, listed

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
    ``pause`` [s], unless newcomers are accepted ``at_once``.  If the first speaks again within
    ``pause`` of the second, or they take turns with longer pauses, both are sending: the robot is
    contested, and nobody is accepted until all but one have been silent for ``quiet`` [s].
    More messages in a row than ``lost`` are not lost on the way.

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

    Args:
        publishers: returns the names of the nodes that publish the states, one a publisher.
        on_dispute: called when ``dispute`` has changed.

    Attributes:
        is_believed: whether something may be commanded that is made from the states.
        dispute: two speak, or the one that is left was not believed before; else Why().
    """

    def __init__(
        self, publishers: Callable[[], Sequence[str]], on_dispute: Callable[[Why], None]
    ) -> None:
        self._publishers, self._on_dispute = publishers, on_dispute
        self._senders = Senders(LOOK, QUIET, at_once=False, lost=_LOST_STATES)
        self.forget()

    def forget(self) -> None:
        """Know nobody."""
        self._senders.forget()
        self._one: object = None  # who is listened to
        self._before: object = None  # who was believed before the dispute
        self._due, self._looked_long = math.inf, False
        self.is_believed, self.dispute = False, Why()

    def hear(self, number: int, now: float) -> None:
        """Raise InvalidMessageError if a state that came at ``now`` [s] is another publisher's."""
        is_accepted, one = self._senders.hear(number, now), self._senders.accepted
        if self._senders.contested:
            self._begin_dispute(math.inf)
        elif is_accepted and self.dispute.fault and one is not None:
            is_accepted = self._before in (None, one)
            if is_accepted:
                self._listen_to(one, now, is_known=True)
        elif is_accepted and (self._due == math.inf or one is not self._one):
            self._listen_to(one, now + LOOK)
        if not is_accepted:
            other = "another publisher of joint_states is listened to"
            raise InvalidMessageError(self.dispute.fault or other)

    def contradict(self, now: float) -> None:
        """Note that what came at ``now`` [s] cannot be of the robot of the state before."""
        if self.is_believed or self.dispute.fault:
            self._begin_dispute(now + QUIET)
        else:
            self._due = now + LOOK

    def see_contest(self, now: float) -> None:
        """Note that states go on contradicting each other: without numbers nothing else tells."""
        if self._senders.accepted is None and len(self._publishers()) > 1:
            self.contradict(now)

    def look(self, now: float) -> bool:
        """Return whether the states are believed at ``now`` [s], steady clock."""
        if self.is_believed or now < self._due:
            return self.is_believed
        if not (self._looked_long or self.dispute.fault) and len(self._publishers()) > 1:
            self._due, self._looked_long = self._due + LONG_LOOK - LOOK, True
        if now >= self._due:
            self.is_believed = True
            self._tell(Why())
        return self.is_believed

    def accept(self, now: float) -> None:
        """Believe the one that a dispute has left; raises InvalidMessageError if two are."""
        if self.dispute.fault and self._senders.accepted is not None:
            self._listen_to(self._senders.accepted, now, is_known=True)
        self.review()
        self.refuse_in_dispute()

    def refuse_in_dispute(self) -> None:
        """Raise InvalidMessageError while it is not known whose the states are."""
        if self.dispute.fault:
            raise InvalidMessageError(f"{self.dispute.fault}; {self.dispute.remedy}")

    def review(self) -> None:
        """Look again who publishes the states, if that is in dispute."""
        if not self.dispute.fault:
            return
        names = self._publishers()
        if self._senders.accepted is not None:
            self._tell(replaced(listed(names)))
        elif len(names) > 1:  # else one has ended, but is named still
            self._tell(contested(listed(names)))

    def _listen_to(self, one: object, due: float, *, is_known: bool = False) -> None:
        """Believe one from a time on [s], without a longer look if it is known."""
        self._one, self._due, self._looked_long = one, due, is_known
        self.is_believed = False
        self._tell(Why())

    def _begin_dispute(self, due: float) -> None:
        """Believe nobody until a time [s]."""
        if self.is_believed:
            self._before = self._one
        self.is_believed, self._due = False, due
        if not self.dispute.fault:
            self._tell(contested(listed(self._publishers())))

    def _tell(self, dispute: Why) -> None:
        if dispute != self.dispute:
            self.dispute = dispute
            self._on_dispute(dispute)
