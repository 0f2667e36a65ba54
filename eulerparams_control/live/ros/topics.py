"""Topics of the page: the newest message of each, and publishers that are there while in use."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.type_support import check_for_type_support

from eulerparams_control.control.clock import steady
from eulerparams_control.ros.qos import QOS

_LATE = 1.0  # [s] after which a message that nobody has heard is dropped
_RESTS = 2.0  # [s] after which a publisher is taken back
_LAST = Duration(seconds=0.5)  # for the last messages to arrive


class Newest:
    """The newest message of a topic, taken when it is looked at: no callback for each of them."""

    def __init__(self, node: Node, kind: type[Any], topic: str, depth: int = 1) -> None:
        self._kind, self._message, self.came = kind, None, -math.inf
        check_for_type_support(kind)  # which loads it
        qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT).get_c_qos_profile()
        with node.handle:
            self._handle = rclpy_implementation.Subscription(node.handle, kind, topic, qos)

    def look(self, concerns: Callable[[Any], bool] = lambda _: True) -> Any:
        """Return the newest of those that concern us; None before the first."""
        with self._handle:
            while found := self._handle.take_message(self._kind, False):
                if concerns(found[0]):
                    self._message, self.came = found[0], steady.now()
        return self._message


class Outlet:
    """A publisher that is there while it is used: others may lead the arm after it."""

    def __init__(self, node: Node, kind: type[Any], topic: str) -> None:
        self._node, self._make = node, partial(node.create_publisher, kind, topic, QOS)
        self._publisher: Any = None
        self._used, self._unheard = -math.inf, None

    def send(self, msg: Any) -> None:
        """Publish a message, later if nobody hears it yet."""
        self._publisher = self._publisher or self._make()
        self._used, self._unheard = steady.now(), msg
        self.turn()

    def forget(self) -> None:
        """Drop a message that nobody has heard yet."""
        self._unheard = None

    def turn(self) -> None:
        """Send what nobody has heard yet; take the publisher back if it is not used."""
        if steady.now() - self._used > _LATE:
            self.forget()
        if self._unheard is not None and self._publisher.get_subscription_count():
            self._publisher.publish(self._unheard)
            self._unheard = None
        if self._publisher is not None and steady.now() - self._used > _RESTS:
            self._node.destroy_publisher(self._publisher)
            self._publisher = self._unheard = None

    def close(self, msg: Any) -> None:
        """Publish a last message, if it is used."""
        if self._publisher is not None:
            self._publisher.publish(msg)
            self._publisher.wait_for_all_acked(_LAST)
