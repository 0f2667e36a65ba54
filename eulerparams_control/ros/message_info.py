"""The number of a message among those of its publisher."""

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

NUMBER = "publication_sequence_number"
"""Key of the info: the publisher counts its messages from 1."""


def with_info(callback: Callable[[Any, Mapping[str, Any]], None]) -> Callable[..., None]:
    """Return a callback of a subscription that gets a message and its info.

    Most executors pass two arguments to such a callback, EventsExecutor one pair.
    """

    @wraps(callback)  # whose signature says to rclpy that it gets both
    def received(*message: Any) -> None:
        callback(*(message if len(message) == 2 else message[0]))

    return received
