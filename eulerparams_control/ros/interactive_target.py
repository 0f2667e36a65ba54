"""The target as an interactive marker for RViz: dragged there, it is aimed at when it is released.

The protocol is that of the package interactive_markers, whose messages are all that it needs: a
service gives the marker, ~/target/update moves it, ~/target/feedback tells what the mouse does.
"""

import math
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import PoseStamped, Quaternion
from rclpy.node import Node
from visualization_msgs.msg import (
    InteractiveMarker,
    InteractiveMarkerControl,
    InteractiveMarkerFeedback,
    InteractiveMarkerPose,
    InteractiveMarkerUpdate,
)
from visualization_msgs.srv import GetInteractiveMarkers

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.messages.to_ros import pose_to_ros, stamp_to_ros
from eulerparams_control.motion.frames import DesiredFrame

NAME = "target"
FEEDBACK, UPDATE = f"~/{NAME}/feedback", f"~/{NAME}/update"

_SIZE = 0.2  # [m]
_NOW = stamp_to_ros(0)

# An axis of a control is the x axis of its orientation.
_S = math.sqrt(0.5)
_AXES = {"x": (_S, 0.0, 0.0), "y": (0.0, 0.0, _S), "z": (0.0, _S, 0.0)}
_WAYS = {
    "move": InteractiveMarkerControl.MOVE_AXIS,
    "rotate": InteractiveMarkerControl.ROTATE_AXIS,
}


@dataclass
class _Grip:
    """The marker in the grip of a mouse, which took it when ``stops`` was so."""

    stops: Any
    is_dragged: bool = False


class InteractiveTarget:
    """The marker of a control node.  It follows the desired frame while nobody drags it."""

    def __init__(self, node: Node) -> None:
        self._at = PoseStamped()
        self._number, self._is_given = 0, False
        self._grips: dict[str, _Grip] = {}  # by the mouse that has it
        self._updates = node.create_publisher(InteractiveMarkerUpdate, UPDATE, 100)
        service = f"~/{NAME}/get_interactive_markers"
        node.create_service(GetInteractiveMarkers, service, self._give)

    @property
    def is_watched(self) -> bool:
        """Whether anybody shows it."""
        return self._updates.get_subscription_count() > 0

    def place(self, frame: DesiredFrame, base_frame: str) -> None:
        """Show it at a frame, unless somebody drags it."""
        self._at = pose_to_ros(frame.p_d, frame.R_d, _NOW, base_frame)
        if self._grips:
            return
        self._number += 1
        update = InteractiveMarkerUpdate(
            server_id=self._updates.topic_name,
            seq_num=self._number,
            type=InteractiveMarkerUpdate.UPDATE,
        )
        if self._is_given:
            at = self._at
            update.poses = [InteractiveMarkerPose(header=at.header, pose=at.pose, name=NAME)]
        else:  # who asked before could not be told where it is
            update.markers, self._is_given = [_marker(self._at)], True
        self._updates.publish(update)

    def released(self, msg: InteractiveMarkerFeedback, stops: Any) -> PoseStamped | None:
        """Return the pose at which it was released; None while it is dragged, or was not.

        Args:
            msg: what a mouse does.
            stops: what changes when the arm is stopped, or controlled anew.

        Raises:
            InvalidMessageError: if that has changed since the mouse took it.
        """
        kind, mouse = msg.event_type, msg.client_id
        if kind == InteractiveMarkerFeedback.MOUSE_DOWN:
            self._grips[mouse] = _Grip(stops)
        grip = self._grips.get(mouse)
        if grip is None:
            return None
        grip.is_dragged |= kind == InteractiveMarkerFeedback.POSE_UPDATE
        if kind != InteractiveMarkerFeedback.MOUSE_UP:
            return None
        del self._grips[mouse]
        if not grip.is_dragged:
            return None
        if grip.stops != stops:
            raise InvalidMessageError("the arm stopped while its target was dragged: drag it again")
        goal = PoseStamped(pose=msg.pose)  # without a stamp: those of the mouse are not the robot's
        goal.header.frame_id = msg.header.frame_id
        return goal

    def _give(self, _request: Any, answer: Any) -> Any:
        self._grips.clear()  # somebody begins to show it
        answer.sequence_number, self._is_given = self._number, bool(self._at.header.frame_id)
        answer.markers = [_marker(self._at)] if self._is_given else []
        return answer


def _marker(at: PoseStamped) -> InteractiveMarker:
    marker = InteractiveMarker(header=at.header, pose=at.pose, name=NAME)
    marker.scale = _SIZE
    for way, mode in _WAYS.items():
        for axis, (x, y, z) in _AXES.items():
            control = InteractiveMarkerControl(name=f"{way}_{axis}", interaction_mode=mode)
            control.orientation = Quaternion(w=_S, x=x, y=y, z=z)
            marker.controls.append(control)
    return marker
