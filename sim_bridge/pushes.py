"""A push at the tool, as a hand would: for how long it lasts if it is not repeated."""

import math
from typing import Any

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import ns_from_ros, wrench_from_ros

STRONGEST = 1e5
"""Nothing pushes an arm so strongly [N, Nm]: it is a mistake."""

# Of sums of times [s].
_ROUNDING = 1e-9


class PushInput:
    """Reads pushes, and knows when the last one is over.

    Args:
        frame: the sensor frame, which a push must be in.
        timeout: how long a push lasts [s]; 0: for ever.
    """

    def __init__(self, frame: str, timeout: float) -> None:
        self._frame, self._timeout = frame, timeout or math.inf
        self._end = math.inf

    def from_ros(self, msg: Any, now: float, *, has_stamps: bool) -> Array:
        """Return force and moment (6,) [N, Nm] of a message that came at ``now`` [s].

        Args:
            msg: the message.
            now: by the clock of ``is_over``.
            has_stamps: whether the message is stamped by that clock, so that it lasts from its
                stamp on; one of 0, or of the future, counts from ``now``.

        Raises:
            InvalidMessageError: if the frame is another, or a value not finite or impossible.
        """
        wrench = wrench_from_ros(msg, self._frame)
        if abs(wrench).max() > STRONGEST:
            raise InvalidMessageError(
                f"the wrench {wrench.tolist()} is impossible; expected up to {STRONGEST:g}"
            )
        stamp = ns_from_ros(msg.header.stamp) / 1e9 if has_stamps else 0.0
        begin = stamp if 0.0 < stamp < now else now
        self._end = begin + self._timeout
        return wrench

    def forget(self) -> None:
        """Wait for the end of no push."""
        self._end = math.inf

    def is_over(self, now: float) -> bool:
        """Return whether the push ends at ``now`` [s]; true once for each push."""
        if now < self._end - _ROUNDING:
            return False
        self._end = math.inf
        return True
