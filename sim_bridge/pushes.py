"""A push at the tool, as a hand would."""

from typing import Any

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import wrench_from_ros

STRONGEST = 1e5
"""Nothing pushes an arm so strongly [N, Nm]: it is a mistake."""


def push_from_ros(msg: Any, frame: str) -> Array:
    """Return force and moment (6,) [N, Nm] of a message, which must be in the sensor frame.

    Raises:
        InvalidMessageError: if the frame is another, or a value not finite or impossible.
    """
    wrench = wrench_from_ros(msg, frame)
    if abs(wrench).max() > STRONGEST:
        raise InvalidMessageError(
            f"the wrench {wrench.tolist()} is impossible; expected up to {STRONGEST:g}"
        )
    return wrench
