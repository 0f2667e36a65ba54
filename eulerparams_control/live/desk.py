"""Orders of the people at the open pages, one page at a time, and how long each lasts.

The callbacks of the pages run in threads of their own: they only put orders here. All else is
done by the thread that takes them.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from eulerparams_control.control.clock import steady
from eulerparams_control.laws.rotations import Array

HELD = 0.25
"""Time [s] for which a button counts as held after the page said so, 20 times a second."""

KEPT = 30.0
"""A push that is kept ends after this time [s]."""

_OWNED = 1.0  # [s] that the arm stays with a page after its last order
_LATE = 1.0  # [s] after which an order is dropped unless it ends a motion
_ENDING = 0.3  # [s] for which the end of a push is repeated
_NOTHING = np.zeros(6)


class Deed(StrEnum):
    """A kind of order."""

    HALT = "halt"
    RESUME = "resume"
    SET = "set"  # a parameter
    LEFT = "left"  # the page was closed
    RELEASE = "release"  # ends a jog or a push
    DRAG = "drag"
    JOG = "jog"
    PUSH = "push"
    KEEP = "keep"  # pushing
    HOME = "home"
    APPROACH = "approach"  # the pole
    PASS = "pass"  # through it

    @property
    def is_far(self) -> bool:
        """Whether it is for a simulated arm only: nobody watches the way."""
        return self in (Deed.HOME, Deed.APPROACH, Deed.PASS)

    @property
    def is_held(self) -> bool:
        """Whether it lasts while a button is held."""
        return self in (Deed.JOG, Deed.PUSH)

    @property
    def moves(self) -> bool:
        """Whether it moves the arm."""
        return self.is_far or self.is_held or self in (Deed.DRAG, Deed.KEEP)

    @property
    def ends(self) -> bool:
        """Whether it ends a motion, so that it is never too late."""
        return self in (Deed.HALT, Deed.LEFT, Deed.RELEASE)


@dataclass(frozen=True)
class Order:
    """An action of a person on a page.

    Attributes:
        page: its number.
        deed: the kind of order.
        value: what belongs to it.
        at: when it came, steady clock [s].
    """

    page: int
    deed: Deed
    value: Any = None
    at: float = field(default_factory=lambda: steady.now(), compare=False)

    def is_late(self, now: float) -> bool:
        """Return whether it is too old at ``now`` [s] to be obeyed."""
        return not self.deed.ends and now - self.at > (HELD if self.deed.is_held else _LATE)


@dataclass
class _Lasting:
    """A vector (6,) that is asked for until a time [s]."""

    value: Array
    until: float = -math.inf


class Desk:
    """Arbiter between the pages: which of them moves the arm, and what is asked for now.

    Attributes:
        owner: the number of the page that moves the arm, or moved it last; None before the first.
    """

    def __init__(self) -> None:
        self.owner: int | None = None
        self._owned = -math.inf
        self._orders: SimpleQueue[Order] = SimpleQueue()
        self._jog, self._push = _Lasting(_NOTHING), _Lasting(_NOTHING)
        self._jogged = False
        self._gone: set[int] = set()
        self._held: tuple[int, Deed, float] | None = None  # page, kind, which button
        self._asked: Any = None  # when it was pressed
        self._last = -math.inf

    def put(self, order: Order) -> None:
        """Leave an order; any thread may."""
        self._orders.put(order)

    def taken(self) -> Iterator[Order]:
        """Yield the orders that have come since; of pages that are gone only a halt."""
        while True:
            try:
                order = self._orders.get_nowait()
            except Empty:
                return
            if order.page not in self._gone or order.deed is Deed.HALT:
                yield order

    def may(self, page: int, now: float) -> bool:
        """Return whether a page may move the arm at the time ``now`` [s]; it has it then."""
        busy = max(self._owned, self._jog.until, self._push.until)
        if page != self.owner and now < busy:
            return False
        self.owner, self._owned = page, now + _OWNED
        return True

    def holds(self, order: Order, now: float) -> bool:
        """Return whether a held button asks for what it asked for when it was pressed.

        The first of its values says which button it is. If another changes, which any page may
        do, it asks for nothing until it is pressed again.
        """
        button = order.page, order.deed, order.value[0]
        if button != self._held or now >= self._last + _OWNED:  # a slow page may pause
            self._held, self._asked = button, order.value
        elif order.value != self._asked:
            self._asked = None
        self._last = now
        return self._asked is not None

    def jog(self, twist: Array, now: float) -> None:
        """Ask for a twist (6,) [m/s, rad/s] while a button is held."""
        self._jog = _Lasting(twist, now + HELD)

    def push(self, wrench: Array, now: float, lasts: float = HELD) -> None:
        """Ask for a force and a moment (6,) [N, Nm] on the tool."""
        self._push = _Lasting(wrench, now + lasts)

    def let_go(self, now: float) -> None:
        """End jog and push."""
        self._jog.until, self._push.until = (min(x.until, now) for x in (self._jog, self._push))

    def end_jog(self) -> None:
        """Ask for no twist any more, not even one of zeros: a goal leads the arm."""
        self._jog.until, self._jogged = -math.inf, False

    def left(self, page: int, now: float) -> None:
        """End what a page asked for that was closed."""
        self._gone.add(page)
        if page == self.owner:
            self.let_go(now)
            self._owned = now

    def twist(self, now: float) -> Array | None:
        """Return the twist to send now: zeros once at its end, then None."""
        if now < self._jog.until:
            self._jogged = True
            return self._jog.value
        if self._jogged:
            self._jogged = False
            return _NOTHING
        return None

    def wrench(self, now: float) -> Array | None:
        """Return the wrench to send now: zeros for a while at its end, then None."""
        if now < self._push.until:
            return self._push.value
        return _NOTHING if now < self._push.until + _ENDING else None
