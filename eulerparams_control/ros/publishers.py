"""Publishers of a topic: who they are, and whether they are heard."""

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
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
    is_known = info.node_name != UNKNOWN_NAME
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}" if is_known else ""


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
    """Raise InvalidMessageError if nodes of two names publish what a node takes."""
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
    infos, faults, remedies = node.get_publishers_info_by_topic(topic), [], []
    for policy, (less, more) in _LESS.items():
        names = [_name_of(info) for info in infos if getattr(info.qos_profile, policy) == less]
        if names and getattr(wanted, policy) == more:
            faults.append(
                f"{listed(names)} {'publishes' if len(names) == 1 else 'publish'} {topic} with the "
                f"{policy} {less.short_key}, but it is read with {more.short_key}: nothing comes"
            )
            remedies.append(qos_remedy(node.get_fully_qualified_name(), topic, policy))
    # none is found of one that was discovered a moment ago
    return Why(Cause.INCOMPATIBLE_QOS, "; ".join(faults), "; ".join(remedies)) if faults else Why()


def qos_remedy(reader: str, topic: str, policy: str) -> str:
    """Return what lets a node receive what is published with less of a policy than it asks for."""
    less, more = _LESS[policy]
    return (
        f"set the parameter qos_overrides.{topic}.subscription.{policy} to {less.short_key} at the "
        f"start of {reader}, or let the publisher offer {more.short_key}"
    )
