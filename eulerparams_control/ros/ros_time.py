"""Whether the time of a node is simulated, without asking rclpy for it at each message."""

from rclpy.node import Node


class RosTime:
    """What counts for a node, the stamps or the steady clock.

    Args:
        node: the node.

    Attributes:
        ros_time_is_active: whether time is simulated, so that the stamps count.
    """

    def __init__(self, node: Node) -> None:
        self._clock = node.get_clock()
        self._look()
        node.add_post_set_parameters_callback(lambda _: self._look())

    def _look(self) -> None:
        self.ros_time_is_active = bool(self._clock.ros_time_is_active)
