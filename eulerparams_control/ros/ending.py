"""The end of control: the arm comes to rest first, though a transition cannot wait for it."""

import math
from collections.abc import Callable

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller

LONGEST = 3.0
"""[s] that an arm is given to come to rest, beside twice the time that its limits need for it; then
it is let alone where it is."""


class Ending:
    """Brings an arm to rest, and then releases it.

    Args:
        is_followed: whether the arm still tells its state, so that it can be brought to rest.
        release: sends the last command; called once.
    """

    def __init__(self, is_followed: Callable[[], bool], release: Callable[[], None]) -> None:
        self._is_followed, self._release = is_followed, release
        self._controller: Controller | None = None
        self._deadline = -math.inf
        self._then: list[Callable[[], None]] = []

    def begin(self, controller: Controller | None, *then: Callable[[], None]) -> None:
        """End a controller, if there is one; call ``then`` when its arm is released."""
        if controller is not None and self._controller is None:
            self._controller = controller
            self._deadline = steady.now() + LONGEST + 2 * controller.guidance.stop_time
            controller.end()
        self._then += then
        self.review()

    def review(self) -> None:
        """Release the arm that ends, if it is at rest, or cannot be brought to it."""
        controller = self._controller
        if controller is not None:
            in_time = self._is_followed() and steady.now() < self._deadline
            if in_time and not controller.is_at_rest:
                return
        self.finish()

    def finish(self) -> None:
        """Release the arm that ends now, and do what was to come then."""
        if self._controller is not None:
            self._controller = None
            self._release()
        while self._then:
            self._then.pop(0)()
