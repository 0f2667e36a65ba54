"""The number of a message among those of its publisher."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

NUMBER = "publication_sequence_number"
"""Key of the info: the publisher counts its messages from 1."""


def paired(callback: Callable[[tuple[Any, Mapping[str, Any]]], None]) -> Callable[..., None]:
    """Return a callback of a subscription that gets a message and its info as one pair."""
    return with_info(lambda msg, info: callback((msg, info)))


def with_info(callback: Callable[[Any, Mapping[str, Any]], None]) -> Callable[..., None]:
    """Return a callback of a subscription that gets a message and its info.

    Most executors pass two arguments to such a callback, EventsExecutor one pair.
    """

    def received(first: Any, info: Any = None) -> None:
        if info is None:
            callback(*first)
        else:
            callback(first, info)

    received.__signature__ = inspect.signature(callback)  # type: ignore[attr-defined]
    return received
