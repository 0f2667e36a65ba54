"""Messages over DDS within one process, one at a time, each acted on before the next.

No executor spins: a message is published, taken from the subscription that it is for, and its
callback called, before anything else happens.  So the order of all that happens is that of the
program, and a run repeats to the bit.
"""

import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from eulerparams_control.errors import SimulationError

# A guard against hanging, not a measure [s]: within a process a message is there at once.
_PATIENCE = 20.0


class Crash(Exception):
    """A controller has raised an error that nothing catches."""


class Counting:
    """Mixin for the class of a node: counts what it publishes on each topic.

    Attributes:
        sent: messages by topic.
    """

    def __init__(self) -> None:
        self.sent: Counter[str] = Counter()
        super().__init__()

    def create_publisher(self, *args: Any, **keywords: Any) -> Publisher:
        """Return a publisher that counts."""
        publisher = super().create_publisher(*args, **keywords)  # type: ignore[misc]
        send, topic = publisher.publish, publisher.topic_name

        def publish(msg: Any) -> None:
            self.sent[topic] += 1
            send(msg)

        publisher.publish = publish
        return publisher


def until(condition: Any, what: str) -> None:
    """Wait until a condition on DDS holds; raise SimulationError if it never does."""
    deadline = time.monotonic() + _PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            raise SimulationError(f"{what}: has not happened within {_PATIENCE:g} s")
        time.sleep(0.0005)


def subscription_of(node: Node | None, topic: str) -> Subscription | None:
    """Return the subscription of a node to a topic; None if it has none."""
    if node is None:
        return None
    return next((s for s in node.subscriptions if s.topic_name == topic), None)


def deliver(publisher: Publisher, msg: Any, node: Node | None) -> bool:
    """Publish a message and call the node's callback; return whether the node subscribes to it."""
    subscription = subscription_of(node, publisher.topic_name)
    listeners = 0 if subscription is None else 1
    until(
        lambda: publisher.get_subscription_count() == listeners,
        f"{listeners} subscribers of {publisher.topic_name}",
    )
    publisher.publish(msg)
    if subscription is None:
        return False
    act(subscription, *take(subscription))
    return True


def take(subscription: Subscription) -> tuple[Any, Any]:
    """Return the next message of a subscription with its info; wait for it."""
    found: tuple[Any, Any] | None = None

    def is_there() -> bool:
        nonlocal found
        with subscription.handle:
            found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        return found is not None

    until(is_there, f"a message on {subscription.topic_name}")
    assert found is not None
    return found


def act(subscription: Subscription, msg: Any, info: Any) -> None:
    """Call the callback of a subscription as an executor does."""
    if subscription._callback_type is Subscription.CallbackType.MessageOnly:
        call(subscription.callback, msg)
    else:
        call(subscription.callback, msg, info)


def call(callback: Callable[..., Any], *args: Any) -> None:
    """Call a callback of a controller; raise Crash where it would have ended its process."""
    try:
        callback(*args)
    except Exception as error:  # of any kind
        where = traceback.extract_tb(error.__traceback__)[-1]
        raise Crash(f"{error!r} in {where.name}, {Path(where.filename).name}") from error


def drain(subscription: Subscription) -> None:
    """Discard the waiting messages."""
    with subscription.handle:
        while subscription.handle.take_message(subscription.msg_type, subscription.raw):
            pass
