"""One node too many: a second publisher of a topic, for a time."""

from typing import Any

import rclpy
from rclpy.node import Node

from eulerparams_control.lab.faults import SecondPublisher
from eulerparams_control.ros.qos import QOS_STREAM

NAME = "intruder"
"""Of the node, as those see it who list the publishers of the topic."""


class Intruder:
    """A node that publishes to a topic what is a little beside what another publishes.

    Args:
        beside: a node in whose context and namespace it is.
        fault: what it does.
        kind: of the messages.
        topic: its full name.
    """

    def __init__(self, beside: Node, fault: SecondPublisher, kind: Any, topic: str) -> None:
        self._fault = fault
        self._node = rclpy.create_node(
            NAME,
            context=beside.context,
            namespace=beside.get_namespace(),
            use_global_arguments=False,  # its name is its own
            start_parameter_services=False,
        )
        self._publisher = self._node.create_publisher(kind, topic, QOS_STREAM)
        self._due = fault.at

    def publish(self, t: float, last: Any) -> None:
        """Publish, if it is time to at t [s], after the last true message."""
        if t >= self._due:
            self._due = t + 1.0 / self._fault.rate
            self._publisher.publish(self._fault.message(last))

    def close(self) -> None:
        """Go away."""
        self._node.destroy_node()
