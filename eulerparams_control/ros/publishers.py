"""Publishers of a topic."""

from rclpy.node import Node
from rclpy.subscription import Subscription

from eulerparams_control.errors import InvalidMessageError

# How the graph calls a node whose name it has not learnt yet.
_UNKNOWN = "_NODE_NAME_UNKNOWN_"


def names_of_publishers(node: Node, topic: str) -> list[str]:
    """Return the full name of the node of each publisher on a topic; "" if it is not known yet."""
    return [
        f"{info.node_namespace.rstrip('/')}/{info.node_name}" if info.node_name != _UNKNOWN else ""
        for info in node.get_publishers_info_by_topic(topic)
    ]


def publishers_of(node: Node, topic: str) -> set[str]:
    """Return the full names of the nodes that publish on a topic, as far as they are known."""
    return set(names_of_publishers(node, topic)) - {""}


def refuse_two_publishers(node: Node, subscription: Subscription | None) -> None:
    """Raise InvalidMessageError, naming them, if nodes of two names publish what is taken.

    A node that was killed stays in the graph for some 20 s; its successor has its name, and is
    for a moment without one.
    """
    if subscription is None or subscription.get_publisher_count() < 2:
        return
    topic = subscription.topic_name
    names = publishers_of(node, topic)
    if len(names) > 1:
        raise InvalidMessageError(
            f"two publishers on '{topic.lstrip('/')}': {', '.join(sorted(names))}; expected one; "
            "end the other (one that was killed is gone after some 20 s)"
        )
