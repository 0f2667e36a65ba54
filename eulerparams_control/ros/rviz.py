"""RViz: ~/markers of a control node, and ~/target of the protocol of interactive_markers."""

import math
from typing import Any

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, PoseStamped, Quaternion
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs import msg as viz
from visualization_msgs.srv import GetInteractiveMarkers

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.to_ros import pose_to_ros, quaternion_to_ros, stamp_to_ros
from eulerparams_control.motion.drawing import ellipsoid
from eulerparams_control.ros.state_input import State

FEEDBACK, UPDATE = "~/target/feedback", "~/target/update"

# Widths of the axes of the frames, and the length of all; semi-axis of the stiffest; of 1 N, 1 Nm.
_WIDTHS, _AXES = {"desired": 0.002, "compliant": 0.004, "actual": 0.006}, 0.1  # [m]
_STIFFEST, _PER_NEWTON, _PER_NEWTON_METRE = 0.1, 0.005, 0.05  # [m]
_SHAFT = 0.008, 0.016, 0.02  # [m] of an arrow: its diameter, that of its head, its length
_LASTS = Duration(nanosec=500_000_000)  # what is not drawn again vanishes
_VANISHED = 1.0  # [s] of silence: a mouse that drags says so four times a second
_RED, _GREEN, _BLUE = (0.9, 0.2, 0.2, 1.0), (0.2, 0.7, 0.2, 1.0), (0.2, 0.4, 0.9, 1.0)
_YELLOW, _PURPLE, _GREY = (0.9, 0.7, 0.1, 1.0), (0.6, 0.3, 0.8, 0.3), (0.6, 0.6, 0.6, 1.0)
_S = math.sqrt(0.5)  # an axis of a control is the x axis of its orientation
_CONTROLS = {"x": (_S, 0.0, 0.0), "y": (0.0, 0.0, _S), "z": (0.0, _S, 0.0)}


class RViz:
    """The views of a node, and its target, which follows the desired frame until it is dragged."""

    def __init__(self, node: Node) -> None:
        self._markers = node.create_publisher(viz.MarkerArray, "~/markers", 10)
        self._updates = node.create_publisher(viz.InteractiveMarkerUpdate, UPDATE, 100)
        node.create_service(GetInteractiveMarkers, "~/target/get_interactive_markers", self._give)
        self._drawn, self._at, self._number, self._is_given = -1, PoseStamped(), 0, False
        self._grips: dict[str, tuple[Any, bool, float]] = {}  # stops before, is dragged, heard [s]

    def show(self, controller: Controller, state: State) -> None:
        """Show to who watches what a controller does with its last state; nothing that is old."""
        guidance, robot, (t, q, dq) = controller.guidance, controller.scheme.robot, state
        if self._updates.get_subscription_count():
            held = controller.scheme.frame_at(q) if controller.fault else guidance.motion.last
            self._place(pose_to_ros(held.p_d, held.R_d, stamp_to_ros(0), robot.base_frame))
        if t == self._drawn or not self._markers.get_subscription_count():
            return
        self._drawn, arm, tick = t, robot.state(q, dq), guidance.tick_now
        p, markers = arm.p_e, [_axes("actual", arm.p_e, arm.R_e)]
        if tick is not None and guidance.ticked == t and not controller.fault:
            markers.append(_axes("desired", tick.desired.p_d, tick.desired.R_d))
            if (frame := tick.command.frame) is not None:
                markers.append(_axes("compliant", frame.p_d, frame.R_d))
            if tick.wrench is not None:
                force, moment = _PER_NEWTON * tick.wrench[:3], _PER_NEWTON_METRE * tick.wrench[3:]
                for name, way, color in (("force", force, _YELLOW), ("moment", moment, _GREY)):
                    markers.append(_marker(name, viz.Marker.ARROW, _SHAFT, color, p, p + way))
            if (K_at := controller.scheme.stiffness(tick)) is not None:
                shape = ellipsoid(K_at[0], _STIFFEST)
                markers.append(_marker("stiffness", viz.Marker.SPHERE, 2 * shape.radii, _PURPLE))
                markers[-1].pose.position = _point(K_at[1])
                markers[-1].pose.orientation = quaternion_to_ros(shape.R)
        for marker in markers:
            marker.header.stamp, marker.header.frame_id = stamp_to_ros(t), robot.base_frame
        self._markers.publish(viz.MarkerArray(markers=markers))

    def _place(self, at: PoseStamped) -> None:
        """Show the target where it is not dragged."""
        self._at = at
        since = steady.now() - _VANISHED
        if any(heard > since for *_, heard in self._grips.values()):
            return
        self._grips.clear()
        self._number += 1
        update = viz.InteractiveMarkerUpdate(seq_num=self._number)
        update.server_id, update.type = self._updates.topic_name, update.UPDATE
        if self._is_given:
            place = viz.InteractiveMarkerPose(header=at.header, pose=at.pose, name="target")
            update.poses = [place]
        else:  # who asked before could not be told where it is
            update.markers, self._is_given = [_target(at)], True
        self._updates.publish(update)

    def _give(self, _request: Any, answer: Any) -> Any:
        self._grips.clear()  # somebody begins to show it
        answer.sequence_number, self._is_given = self._number, bool(self._at.header.frame_id)
        answer.markers = [_target(self._at)] if self._is_given else []
        return answer

    def released(self, msg: viz.InteractiveMarkerFeedback, stops: Any) -> PoseStamped | None:
        """Return where a mouse has released the target; None while it drags it, or did not.

        ``stops`` changes when the arm is stopped: raises InvalidMessageError if it has meanwhile.
        """
        mouse, now = msg.client_id, steady.now()
        if msg.event_type == msg.MOUSE_DOWN:
            self._grips[mouse] = stops, False, now
        before, is_dragged, _ = self._grips.pop(mouse, (None, False, now))
        if msg.event_type != msg.MOUSE_UP:
            if before is not None:
                self._grips[mouse] = before, is_dragged or msg.event_type == msg.POSE_UPDATE, now
            return None
        if is_dragged and before != stops:
            raise InvalidMessageError("the arm stopped while its target was dragged: drag it again")
        goal = PoseStamped(pose=msg.pose)  # without a stamp: that of the mouse is not the robot's
        goal.header.frame_id = msg.header.frame_id
        return goal if is_dragged else None


def _target(at: PoseStamped) -> viz.InteractiveMarker:
    marker = viz.InteractiveMarker(header=at.header, pose=at.pose, name="target", scale=0.2)
    for axis, (x, y, z) in _CONTROLS.items():
        for way in ("MOVE_AXIS", "ROTATE_AXIS"):
            control = viz.InteractiveMarkerControl(name=f"{way} {axis}")
            control.orientation = Quaternion(w=_S, x=x, y=y, z=z)
            control.interaction_mode = getattr(control, way)
            marker.controls.append(control)
    return marker


def _marker(name: str, kind: int, scale: Any, color: Any, *points: Array) -> viz.Marker:
    marker = viz.Marker(ns=name, type=kind, color=_color(color), lifetime=_LASTS)
    marker.scale.x, marker.scale.y, marker.scale.z = map(float, scale)
    marker.points = [_point(p) for p in points]
    return marker


def _axes(name: str, p: Array, R: Array) -> viz.Marker:
    lines = [end for axis in R.T for end in (p, p + _AXES * axis)]
    marker = _marker(name, viz.Marker.LINE_LIST, (_WIDTHS[name], 0.0, 0.0), _GREY, *lines)
    marker.colors = [_color(color) for color in (_RED, _GREEN, _BLUE) for _ in range(2)]
    return marker


def _color(color: tuple[float, ...]) -> ColorRGBA:
    return ColorRGBA(**dict(zip("rgba", color, strict=True)))


def _point(p: Array) -> Point:
    return Point(**dict(zip("xyz", map(float, p), strict=True)))
