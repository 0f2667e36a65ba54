"""Publishers of a topic: who they are, and whether they are heard."""

from collections.abc import Iterator, Mapping

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from eulerparams_control.control.mode import Cause, Why
from eulerparams_control.errors import InvalidMessageError, listed

# How the graph calls a node whose name it has not learnt yet.
UNKNOWN_NAME = "_NODE_NAME_UNKNOWN_"

# What is offered, and what is asked for, where nothing is received.
_LESS = {
    "reliability": (ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE),
    "durability": (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL),
}


def names_of_publishers(node: Node, topic: str) -> list[str]:
    """Return the full name of the node of each publisher on a topic; "" if it is not known yet."""
    return [_name_of(info) for info in node.get_publishers_info_by_topic(topic)]


def _name_of(info: TopicEndpointInfo) -> str:
    if info.node_name == UNKNOWN_NAME:
        return ""
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def rivals(node: Node, topic: str) -> list[str]:
    """Return the full names of the nodes that publish on a topic, if they are several; else none.

    A node that was killed stays in the graph for some 20 s; its successor has its name, and is for
    a moment without one.
    """
    if node.count_publishers(topic) < 2:
        return []
    names = sorted({*names_of_publishers(node, topic)} - {""})
    return names if len(names) > 1 else []


def refuse_two_publishers(node: Node, subscription: Subscription | None) -> None:
    """Raise InvalidMessageError, naming them, if nodes of two names publish what is taken.

    One whose QoS does not match counts, too.
    """
    if subscription is not None and (names := rivals(node, subscription.topic_name)):
        raise InvalidMessageError(
            f"two publishers on '{subscription.topic_name.lstrip('/')}': {', '.join(names)}; "
            "expected one; end the other (one that was killed is gone after some 20 s)"
        )


def unheard(node: Node, subscription: Subscription) -> Why:
    """Return which publishers a subscription cannot hear, and what mends it; Why() if none."""
    topic, wanted = subscription.topic_name, subscription.qos_profile
    if node.count_publishers(topic) <= subscription.get_publisher_count():
        return Why()
    found: dict[tuple[str, str, str], list[str]] = {}
    for info in node.get_publishers_info_by_topic(topic):
        for mismatch in _mismatches(info.qos_profile, wanted):
            found.setdefault(mismatch, []).append(_name_of(info) or "a node")
    # none is found of one that was discovered a moment ago
    return incompatible(topic, node.get_fully_qualified_name(), found) if found else Why()


def incompatible(topic: str, reader: str, found: Mapping[tuple[str, str, str], list[str]]) -> Why:
    """Return why nothing is received of publishers.

    Args:
        topic: its full name.
        reader: the node that reads it.
        found: the names of the publishers by a policy, what they offer and what is asked for.
    """
    faults = [
        f"{listed(names)} {'publishes' if len(names) == 1 else 'publish'} {topic} with the "
        f"{policy} {offered}, but it is read with {asked}: nothing of it is received"
        for (policy, offered, asked), names in found.items()
    ]
    remedies = [
        f"set the parameter qos_overrides.{topic}.subscription.{policy} to {offered} at the start "
        f"of {reader}, or let the publisher offer {asked}"
        for policy, offered, asked in found
    ]
    return Why(Cause.INCOMPATIBLE_QOS, "; ".join(faults), "; ".join(remedies))


def _mismatches(offered: QoSProfile, asked: QoSProfile) -> Iterator[tuple[str, str, str]]:
    """Yield the policies in which less is offered than asked: name, offered, asked."""
    for policy, less in _LESS.items():
        both = getattr(offered, policy), getattr(asked, policy)
        if both == less:
            yield policy, both[0].short_key, both[1].short_key
