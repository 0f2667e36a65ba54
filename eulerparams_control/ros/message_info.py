"""Messages as they come: their number among those of their publisher, and what they say."""

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message

from eulerparams_control.errors import InvalidMessageError

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


def deserialized[M](data: bytes, kind: type[M]) -> M:
    """Return a message of a raw subscription; raises InvalidMessageError if it is broken.

    A subscription that is not raw would end the node.
    """
    try:
        return deserialize_message(data, kind)
    except rclpy_implementation.RMWError as error:
        raise InvalidMessageError(f"{len(data)} bytes are no {kind.__name__}") from error
