"""Views of a control node: ~/markers, ~/target, and frames on /tf, at a low rate, on request."""

from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import NamedTuple

from builtin_interfaces.msg import Time
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from eulerparams_control.control.controller import Controller
from eulerparams_control.errors import defect
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.markers import Stiffness, markers_to_ros, transforms_to_ros
from eulerparams_control.messages.to_ros import stamp_to_ros
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.ros.diagnostics import Health
from eulerparams_control.ros.interactive_target import InteractiveTarget
from eulerparams_control.ros.state_input import State

# Times [s] between two views, and between two updates of the place of the target.
_PERIOD, _TARGET_PERIOD = 0.1, 0.2

HAS_TF = find_spec("tf2_msgs") is not None
"""Whether frames can be published; tf2_msgs is none of the common interfaces."""


class ArmView(NamedTuple):
    """What is to be seen.

    Attributes:
        controller: of the arm.
        state: measured last: stamp [ns], q, dq (n,).
        stamp: of the last command.
        is_silent: whether no state comes any more.
        parameters: of the node.
    """

    controller: Controller
    state: State
    stamp: Time
    is_silent: bool
    parameters: ControlParameters


class Views:
    """The views of a control node.

    Args:
        node: that shows them.
        health: of the node.
        on_tf: whether its frames are published on /tf, too.
        look: returns what is to be seen; None while nothing is.
        stiffness_of: returns the translational stiffness of a tick, if it has one.

    Attributes:
        target: the interactive marker.
    """

    def __init__(
        self,
        node: Node,
        health: Health,
        on_tf: bool,
        look: Callable[[], ArmView | None],
        stiffness_of: Callable[[Tick], Stiffness | None],
    ) -> None:
        self._health, self._look, self._stiffness_of = health, look, stiffness_of
        self._drawn: tuple[int, Tick | None] = -1, None  # stamp [ns], tick
        self._name = node.get_fully_qualified_name().strip("/")  # two arms share /tf
        self._markers = node.create_publisher(MarkerArray, "~/markers", 10)
        self._transforms = None
        if on_tf and HAS_TF:
            self._message = import_module("tf2_msgs.msg").TFMessage
            self._transforms = node.create_publisher(self._message, "/tf", 100)
        elif on_tf:
            health.complain("publish_tf: tf2_msgs is not installed; no frames on /tf")
        self.target = InteractiveTarget(node)
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_PERIOD, partial(self._show, "~/markers", self._draw), clock=clock)
        place = partial(self._show, "~/target", self._place_target)
        node.create_timer(_TARGET_PERIOD, place, clock=clock)

    def _show(self, what: str, show: Callable[[ArmView], None]) -> None:
        """Show something: a failure must not end the node that controls the arm."""
        try:
            if (view := self._look()) is not None:
                show(view)
        except Exception as error:
            self._health.complain(f"{defect(error)}, of {what}", error=True, about=what)

    def _draw(self, view: ArmView) -> None:
        """Show the last tick to who watches; where the law makes none, where the arm is."""
        controller, (t, q, dq) = view.controller, view.state
        tick = controller.guidance.of_law
        last_t, last_tick = self._drawn
        is_watched = self._transforms is not None or self._markers.get_subscription_count() > 0
        if view.is_silent or tick is None or t == last_t or not is_watched:
            return
        is_stopped, self._drawn = bool(controller.fault) or tick is last_tick, (t, tick)
        robot, stamp = controller.scheme.robot, Time(sec=view.stamp.sec, nanosec=view.stamp.nanosec)
        stiffness, poles = self._stiffness_of(tick), view.parameters.poles
        if is_stopped:
            tick, stamp = tick._replace(arm=robot.arm(q, dq)), stamp_to_ros(t)
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

    def _place_target(self, view: ArmView) -> None:
        """Show the target where the arm is led to, or is held."""
        if not self.target.is_watched:
            return
        controller = view.controller
        frame = controller.guidance.motion.last
        if controller.fault:
            frame = controller.scheme.frame_at(view.state[1])
        self.target.place(frame, controller.scheme.robot.base_frame)
