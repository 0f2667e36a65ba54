"""Whether the time of a node is simulated, without asking rclpy for it at each message."""

from rclpy.node import Node


class RosTime:
    """What counts for a node, the stamps or the steady clock.

    Args:
        node: the node.

    Attributes:
        is_simulated: whether time is, so that the stamps count.
    """

    def __init__(self, node: Node) -> None:
        self._clock = node.get_clock()
        self.look()
        node.add_post_set_parameters_callback(lambda _: self.look())

    def look(self) -> None:
        """Ask rclpy again."""
        self.is_simulated = bool(self._clock.ros_time_is_active)
