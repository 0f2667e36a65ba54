"""Markers of a controller for RViz and Foxglove."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, TransformStamped
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.to_ros import quaternion_to_ros, vector_to_ros
from eulerparams_control.motion.drawing import ellipsoid, pole_axes
from eulerparams_control.motion.frames import DesiredFrame

# Lengths [m] of axes and of the longest semi-axis of the stiffness; of 1 N, of 1 Nm.
_AXES, _STIFFEST, _OF_FORCE, _OF_MOMENT = 0.1, 0.1, 0.005, 0.05

# What is not drawn again vanishes after this time [ns].
_LASTS = 500_000_000

type _Color = tuple[float, float, float, float]
_RED, _GREEN, _BLUE = (0.9, 0.2, 0.2, 1.0), (0.2, 0.7, 0.2, 1.0), (0.2, 0.4, 0.9, 1.0)
_YELLOW, _PURPLE, _GREY = (0.9, 0.7, 0.1, 1.0), (0.6, 0.3, 0.8, 0.3), (0.6, 0.6, 0.6, 1.0)


class Stiffness(NamedTuple):
    """A translational stiffness and where it acts.

    Attributes:
        K: (3, 3) [N/m] base frame.
        p: (3,) [m] base frame.
    """

    K: Array
    p: Array


def frames_of(tick: Tick) -> dict[str, DesiredFrame]:
    """Return the desired, the compliant (if there is one) and the actual frame of a tick."""
    arm = tick.state
    found = {"desired": tick.desired, "actual": DesiredFrame(arm.p_e, arm.R_e)}
    return found if tick.command.frame is None else found | {"compliant": tick.command.frame}


def markers_to_ros(
    tick: Tick,
    stiffness: Stiffness | None,
    poles: tuple[int, int] | None,
    stamp: Time,
    frame_id: str,
) -> MarkerArray:
    """Return what is to be seen of a tick.

    Args:
        tick: of a scheme.
        stiffness: that pulls the compliant frame; None if there is none.
        poles: first and last axis (0, 1, 2) of the Euler angles; None with other representations.
        stamp: of the state.
        frame_id: the base frame.
    """
    frames, thin = frames_of(tick), {"desired": 0.002, "compliant": 0.004, "actual": 0.006}
    markers = [_axes(name, frame, thin[name]) for name, frame in frames.items()]
    p_e, R_e = tick.state.p_e, tick.state.R_e
    if tick.wrench is not None:
        force, moment = tick.wrench[:3], tick.wrench[3:]
        markers.append(_arrow("force", p_e, _OF_FORCE * force, _YELLOW))
        markers.append(_arrow("moment", p_e, _OF_MOMENT * moment, _GREY))
    if stiffness is not None:
        markers.append(_ellipsoid(stiffness))
    if poles is not None:
        markers += _poles(*poles, p_e, R_e)
    for marker in markers:
        marker.header.stamp, marker.header.frame_id = stamp, frame_id
        marker.lifetime = Duration(nanosec=_LASTS)
    return MarkerArray(markers=markers)


def transforms_to_ros(tick: Tick, name: str, stamp: Time, frame_id: str) -> list[TransformStamped]:
    """Return the frames of a tick in the base frame ``frame_id``; they are called NAME/desired."""
    found = []
    for which, frame in frames_of(tick).items():
        msg = TransformStamped(child_frame_id=f"{name}/{which}")
        msg.header.stamp, msg.header.frame_id = stamp, frame_id
        msg.transform.translation = vector_to_ros(frame.p_d)
        msg.transform.rotation = quaternion_to_ros(frame.R_d)
        found.append(msg)
    return found


def _marker(name: str, kind: int, scale: Iterable[float], color: _Color) -> Marker:
    marker = Marker(ns=name, type=kind, color=_color(color))
    marker.scale.x, marker.scale.y, marker.scale.z = map(float, scale)
    return marker


def _color(color: _Color) -> ColorRGBA:
    r, g, b, a = color
    return ColorRGBA(r=r, g=g, b=b, a=a)


def _point(p: Array) -> Point:
    x, y, z = map(float, p)
    return Point(x=x, y=y, z=z)


def _axes(name: str, frame: DesiredFrame, width: float) -> Marker:
    """Return the axes of a frame as lines."""
    marker = _marker(name, Marker.LINE_LIST, (width, 0.0, 0.0), _GREY)
    for axis, color in zip(frame.R_d.T, (_RED, _GREEN, _BLUE), strict=True):
        marker.points += [_point(frame.p_d), _point(frame.p_d + _AXES * axis)]
        marker.colors += [_color(color)] * 2
    return marker


def _arrow(name: str, p: Array, way: Array, color: _Color) -> Marker:
    marker = _marker(name, Marker.ARROW, (0.008, 0.016, 0.02), color)
    marker.points = [_point(p), _point(p + way)]
    return marker


def _ellipsoid(stiffness: Stiffness) -> Marker:
    shape = ellipsoid(stiffness.K, _STIFFEST)
    marker = _marker("stiffness", Marker.SPHERE, 2 * shape.radii, _PURPLE)
    marker.pose.position = _point(stiffness.p)
    marker.pose.orientation = quaternion_to_ros(shape.R)
    return marker


def _poles(i: int, k: int, p: Array, R: Array) -> list[Marker]:
    """Return the poles of Euler angles, and the axis of the tool that must not come there."""
    of_base, of_tool = pole_axes(i, k, R)
    ends = np.outer((1.0, -1.0), 1.2 * _AXES * of_base) + p
    poles = _marker("poles", Marker.SPHERE_LIST, (0.015, 0.015, 0.015), _RED)
    poles.points = [_point(end) for end in ends]
    return [poles, _arrow("axis at a pole", p, 1.2 * _AXES * of_tool, _RED)]
