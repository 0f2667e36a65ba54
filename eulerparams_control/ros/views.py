"""Views of a control node: ~/markers, and frames on /tf, at a low rate and only on request."""

from importlib import import_module
from importlib.util import find_spec

from builtin_interfaces.msg import Time
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.markers import Stiffness, markers_to_ros, transforms_to_ros
from eulerparams_control.robot.robot import Robot

PERIOD = 0.1
"""Time [s] between two views."""

HAS_TF = find_spec("tf2_msgs") is not None
"""Whether frames can be published; tf2_msgs is none of the common interfaces."""


class Views:
    """The views of a control node.

    Args:
        node: that shows them.
        on_tf: whether its frames are published on /tf, too.
    """

    def __init__(self, node: Node, on_tf: bool) -> None:
        self._name = node.get_fully_qualified_name().strip("/")  # two arms share /tf
        self._markers = node.create_publisher(MarkerArray, "~/markers", 10)
        self._transforms = None
        if on_tf and HAS_TF:
            self._message = import_module("tf2_msgs.msg").TFMessage
            self._transforms = node.create_publisher(self._message, "/tf", 100)

    @property
    def is_watched(self) -> bool:
        """Whether anything is to be shown."""
        return self._transforms is not None or self._markers.get_subscription_count() > 0

    def show(
        self,
        tick: Tick,
        robot: Robot,
        stamp: Time,
        stiffness: Stiffness | None,
        poles: tuple[int, int] | None,
        *,
        is_stopped: bool,
    ) -> None:
        """Show a tick, of a stopped arm where it is only; see :func:`markers_to_ros`."""
        if self._markers.get_subscription_count():
            array = markers_to_ros(tick, stiffness, poles, stamp, robot.base_frame)
            if is_stopped:
                array.markers = [marker for marker in array.markers if marker.ns == "actual"]
            self._markers.publish(array)
        if self._transforms is not None:
            frames = transforms_to_ros(tick, self._name, stamp, robot.base_frame)
            if is_stopped:
                frames = [msg for msg in frames if msg.child_frame_id.endswith("/actual")]
            self._transforms.publish(self._message(transforms=frames))
