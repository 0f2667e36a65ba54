"""What leads the arm: the topics of references and targets, while it is controlled."""

from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.subscription import Subscription
from trajectory_msgs.msg import MultiDOFJointTrajectory
from visualization_msgs.msg import InteractiveMarkerFeedback

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import EulerParamsError, InvalidMessageError, UnknownNameError
from eulerparams_control.messages.from_ros import (
    motion_from_ros,
    ns_from_ros,
    pose_from_ros,
    twist_from_ros,
)
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.common import LATEST, ControlParameters
from eulerparams_control.ros.managed_node import ManagedNode
from eulerparams_control.ros.publishers import refuse_two_publishers
from eulerparams_control.ros.qos import QOS
from eulerparams_control.ros.rviz import FEEDBACK, RViz
from eulerparams_control.ros.state_input import StateInput

# A target whose stamp goes back within this time [s] was overtaken on its way; later, a clock was
# set back.
_OVERTAKEN = 1.0
_ORDERED = "target_pose", "target_twist", "target_stiffness"

Lead = Callable[[Controller, Any], None]
"""What takes a message that leads the arm; it raises EulerParamsError for one that must not."""

Topics = dict[str, tuple[type[Any], Lead]]
"""Topics, their types, and what takes their messages."""


class Leaders:
    """Listens to what leads the arm.

    Args:
        node: the node that listens.
        parameters: of the node; those that count here do not change.
        states: of the arm.
        rviz: whose target is dragged.
        more: topics of the scheme.

    Raises UnknownNameError if a topic in paired_targets does not lead the arm.
    """

    def __init__(
        self,
        node: ManagedNode,
        parameters: ControlParameters,
        states: StateInput,
        rviz: RViz,
        more: Topics,
    ) -> None:
        self._node, self._parameters = node, parameters
        self._states, self._rviz = states, rviz
        self._topics: Topics = {
            "reference": (MultiDOFJointTrajectory, self._follow),
            "target_pose": (PoseStamped, self._aim),
            "target_twist": (TwistStamped, self._jog),
            FEEDBACK: (InteractiveMarkerFeedback, self._drag),
        } | more
        self._controller: Controller | None = None
        self._heard: dict[str, Subscription] = {}
        self._newest: dict[str, tuple[int, float]] = {}  # stamp [ns], receipt [s] of what was taken
        self._here: dict[str, int] = {}  # stamp [ns] of the last one, taken or not
        # each state waits for the messages of these that have its stamp
        self._paired = parameters.paired_targets
        if parameters.reference_pairing != LATEST:
            self._paired = *self._paired, "reference"
        for topic in parameters.paired_targets:
            if topic not in self._topics:
                raise UnknownNameError("topic in paired_targets", topic, self._topics)

    def begin(self, controller: Controller, lead: Callable[[str, Any], None]) -> None:
        """Listen: ``lead`` is called with a topic and its message, to be taken."""
        self._controller = controller
        self._newest.clear()  # what came before does not count
        self._here.clear()
        for topic, (kind, _) in self._topics.items():
            self._heard[topic] = self._node.listen(kind, topic, partial(lead, topic), QOS)

    def end(self) -> None:
        """Listen no more."""
        self._controller = None
        while self._heard:
            self._node.destroy_subscription(self._heard.popitem()[1])

    def are_here(self, t: int) -> bool:
        """Whether all that belongs to the state stamped t [ns] has come, while one listens."""
        return self._controller is None or all(self._here.get(topic) == t for topic in self._paired)

    def take(self, topic: str, msg: Any) -> None:
        """Let a message lead the arm; raises InvalidMessageError if it must not."""
        if self._controller is None:
            raise InvalidMessageError("not active: nothing leads the arm")
        refuse_two_publishers(self._node, self._heard[topic])
        self._refuse_overtaken(topic, msg)
        try:
            self._topics[topic][1](self._controller, msg)
        except EulerParamsError as error:
            raise InvalidMessageError(str(error)) from error
        self._here[topic] = ns_from_ros(msg.header.stamp)
        self._newest[topic] = self._here[topic], steady.now()

    def _refuse_overtaken(self, topic: str, msg: Any) -> None:
        """Raise InvalidMessageError for a target that is older than the one before."""
        stamp, (newest, came) = ns_from_ros(msg.header.stamp), self._newest.get(topic, (0, 0.0))
        if topic in _ORDERED and 0 < stamp < newest and steady.now() - came < _OVERTAKEN:
            raise InvalidMessageError(
                f"the stamp {stamp / 1e9:.3f} s comes after {newest / 1e9:.3f} s: overtaken, or "
                "are there two senders?"
            )

    def skip(self, topic: str, msg: Any) -> bool:
        """Let a state wait no more for a refused message, as no other comes; return whether so."""
        waits = self._controller is not None and self._controller.mode is not Mode.WAITING
        is_paired = waits and topic in self._parameters.paired_targets
        if is_paired:
            self._here[topic] = ns_from_ros(msg.header.stamp)
        return is_paired

    def _follow(self, controller: Controller, msg: MultiDOFJointTrajectory) -> None:
        robot, lasting = controller.scheme.robot, self._parameters.reference_timeout
        motion = motion_from_ros(msg, robot.base_frame, robot.tip_frame, lasting)
        controller.follow(*motion, self._now)

    def _aim(self, controller: Controller, msg: PoseStamped) -> None:
        controller.aim(pose_from_ros(msg, self._carrier(controller, msg)), self._now)

    def _jog(self, controller: Controller, msg: TwistStamped) -> None:
        controller.jog(twist_from_ros(msg, self._carrier(controller, msg).R), self._now)

    def _drag(self, controller: Controller, msg: InteractiveMarkerFeedback) -> None:
        goal = self._rviz.released(msg, (controller, controller.stops))
        if goal is not None:
            self._aim(controller, goal)

    @property
    def _now(self) -> float | None:
        """When a message came [s], steady clock; None where the stamps count."""
        return None if self._states.is_simulated else steady.now()

    def _carrier(self, controller: Controller, msg: Any) -> Placement:
        """Return where the frame of a message is at its receipt, seen from the base."""
        assert self._states.measured is not None
        return controller.scheme.robot.link_at(msg.header.frame_id, self._states.measured[1])
