"""Views of RViz: ~/markers, frames on /tf, and a target that the mouse moves."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from ros_processes import FRAMES, HOME, Controlled, pose, values
from visualization_msgs.msg import InteractiveMarkerFeedback as Feedback
from visualization_msgs.msg import InteractiveMarkerUpdate, Marker, MarkerArray
from visualization_msgs.srv import GetInteractiveMarkers

from eulerparams_control.control.controller import Controller
from eulerparams_control.messages.from_ros import vector_from_ros
from eulerparams_control.messages.to_ros import pose_to_ros, stamp_to_ros

P_E, R_E = pose(HOME)
PUSH = (3.0, -2.0, 4.0, 0.1, 0.2, -0.3)


@pytest.fixture
def shown(world):
    """Return what runs a controller while somebody watches; it returns the last markers by name."""

    def show(controller, *push, **parameters):
        running = Controlled(world, controller, FRAMES | parameters)
        arrays = world.peer.listen(MarkerArray, f"{controller}/markers")
        if push:
            running.arm.tick()
            running.arm.push(*push)

        world.until(lambda: (running.arm.tick(), len(arrays) > 3)[1], "some markers")
        for marker in arrays[-1].markers:
            assert marker.header.frame_id == FRAMES["base_frame"]
        return {marker.ns: marker for marker in arrays[-1].markers}

    return show


def test_frames_are_drawn_where_they_are_and_the_poles_of_euler_angles(shown):
    markers = shown("clik", orientation="euler_angles", euler_sequence="ZYZ")
    assert markers.keys() == {"desired", "actual", "poles", "axis at a pole"}
    for marker in (markers["desired"], markers["actual"]):
        assert marker.type == Marker.LINE_LIST
        starts, ends = (np.array([vector_from_ros(p) for p in marker.points[k::2]]) for k in (0, 1))
        assert starts == pytest.approx(np.array([P_E] * 3), abs=1e-6)
        assert pytest.approx(R_E, abs=1e-6) == (ends - starts).T / 0.1
        assert len(marker.colors) == len(marker.points)
    top, bottom = map(vector_from_ros, markers["poles"].points)
    assert top - P_E == pytest.approx(np.array([0.0, 0.0, 0.12]), abs=1e-6)
    assert top + bottom == pytest.approx(2 * P_E, abs=1e-6)
    start, end = map(vector_from_ros, markers["axis at a pole"].points)
    assert (end - start) / 0.12 == pytest.approx(R_E[:, 2], abs=1e-6)


def test_wrench_and_stiffness_are_drawn(shown):
    K_p = [1000.0, 500.0, 250.0]
    markers = shown("impedance_control", *PUSH, K_p=K_p)
    assert {"desired", "actual", "compliant", "force", "moment", "stiffness"} == markers.keys()
    start, end = map(vector_from_ros, markers["force"].points)
    assert (end - start) / 0.005 == pytest.approx(np.array(PUSH[:3]), abs=1e-6)
    start, end = map(vector_from_ros, markers["moment"].points)
    assert (end - start) / 0.05 == pytest.approx(np.array(PUSH[3:]), abs=1e-6)
    scale = sorted(vector_from_ros(markers["stiffness"].scale))
    assert scale == pytest.approx([0.05, 0.1, 0.2])  # diameters, as the stiffnesses


def test_what_is_shown_is_never_old(world, monkeypatch):
    name = "impedance_control"
    running = Controlled(world, name, FRAMES, namespace="/left")
    views, frames = running.process.node._views, []  # as with tf2_msgs, which pip has not
    views._message, views._transforms = SimpleNamespace, SimpleNamespace(publish=frames.append)
    arrays = world.peer.listen(MarkerArray, f"/left/{name}/markers")

    def seen(count):
        running.arm.tick()
        return len(frames) >= count and len(arrays) >= count

    world.until(lambda: seen(3), "some markers")
    names = {each.child_frame_id for each in frames[-1].transforms}
    assert names == {f"left/{name}/{of}" for of in ("desired", "actual", "compliant")}
    assert {each.header.frame_id for each in frames[-1].transforms} == {FRAMES["base_frame"]}
    world.advance(1.0)  # no states come
    old = len(frames), len(arrays)
    world.advance(2.0)
    assert (len(frames), len(arrays)) == old
    monkeypatch.setattr(Controller, "fault", "stopped")
    world.until(lambda: seen(old[0] + 3), "markers of an arm that is stopped")
    (shown,) = frames[-1].transforms
    assert shown.child_frame_id == f"left/{name}/actual"
    assert vector_from_ros(shown.transform.translation) == pytest.approx(
        pose(running.arm.q)[0], abs=1e-6
    )
    assert [marker.ns for marker in arrays[-1].markers] == ["actual"]
    stamps = [each.transforms[0].header.stamp for each in frames]
    assert len({(each.sec, each.nanosec) for each in stamps}) == len(stamps)


def test_nothing_is_made_for_nobody_and_frames_need_tf2_msgs(world, monkeypatch):
    made = []
    monkeypatch.setattr("eulerparams_control.ros.views.HAS_TF", False)
    monkeypatch.setattr("eulerparams_control.ros.views.markers_to_ros", lambda *_: made.append(1))
    running = Controlled(world, "clik", FRAMES | {"publish_tf": True})
    for _ in range(100):
        running.arm.tick()
        world.advance(0.01)
    assert not made
    assert "tf2_msgs" in running.process.log


# --- the target, which the mouse moves -------------------------------------------------------
UP = np.array([0.0, 0.0, 0.02])
PLACE = "clik/target/"


@pytest.fixture
def clik(world):
    clik = Controlled(world, "clik", FRAMES | {"require_reference": False})
    clik.updates = world.peer.listen(InteractiveMarkerUpdate, PLACE + "update")
    clik.mouse = world.peer.publisher(Feedback, PLACE + "feedback")
    clik.arm.tick()
    return clik


def feedback(kind, p=P_E, frame_id=FRAMES["base_frame"]):
    at = pose_to_ros(p, R_E, stamp_to_ros(0), frame_id)
    return Feedback(header=at.header, pose=at.pose, event_type=kind, marker_name="target")


def drag(clik, p, frame_id=FRAMES["base_frame"]):
    for kind in (Feedback.MOUSE_DOWN, Feedback.POSE_UPDATE, Feedback.MOUSE_UP):
        clik.mouse.publish(feedback(kind, p, frame_id))


def markers(clik):
    request = GetInteractiveMarkers.Request()
    kind = GetInteractiveMarkers
    return clik.graph.peer.call(kind, PLACE + "get_interactive_markers", request).markers


def updated(clik):
    clik.updates.clear()

    def seen():
        clik.arm.tick()
        return clik.updates

    return clik.graph.until(seen, "an update")[0]


def height(clik):
    clik.arm.tick()
    return pose(clik.arm.q)[0][2]


def test_the_marker_is_at_the_tip_and_can_be_moved_and_turned_along_each_axis(clik):
    assert markers(clik) == []  # nobody has been watching
    (marker,) = updated(clik).markers
    assert marker.header.frame_id == FRAMES["base_frame"]
    assert vector_from_ros(marker.pose.position) == pytest.approx(P_E, abs=1e-6)
    axes = [control.orientation for control in marker.controls]
    turned = [2 * math.acos(q.w) for q in axes]
    assert turned == pytest.approx([math.pi / 2] * 6)
    assert {(round(q.x, 2), round(q.y, 2), round(q.z, 2)) for q in axes} == {
        (0.71, 0.0, 0.0), (0.0, 0.71, 0.0), (0.0, 0.0, 0.71),
    }  # fmt: skip
    (moved,) = updated(clik).poses
    assert moved.pose == marker.pose
    assert [each.name for each in markers(clik)] == [moved.name]


def test_the_arm_goes_where_it_is_released_and_not_while_it_is_dragged(clik):
    updated(clik)
    clik.mouse.publish(feedback(Feedback.MOUSE_DOWN))
    clik.mouse.publish(feedback(Feedback.POSE_UPDATE, P_E + UP))
    shown = len(clik.updates)
    clik.graph.advance(1.0)
    for _ in range(300):
        assert height(clik) == pytest.approx(P_E[2], abs=1e-6)
    assert len(clik.updates) == shown  # it stays with the mouse
    clik.mouse.publish(feedback(Feedback.MOUSE_UP, P_E + UP))
    clik.graph.until(lambda: height(clik) > P_E[2] + 0.999 * UP[2], "the arm at the target")


@pytest.mark.parametrize(
    ("p", "frame_id"), [(P_E + math.nan, FRAMES["base_frame"]), (P_E, "nowhere")]
)
def test_an_impossible_target_is_rejected_and_moves_nothing(clik, p, frame_id):
    drag(clik, p, frame_id)
    assert clik.status(lambda s: "~/target/feedback rejected" in values(s))
    assert height(clik) == pytest.approx(P_E[2], abs=1e-6)


def test_a_click_moves_nothing_and_a_drag_that_began_before_a_fault_does_not_end_it(clik):
    for kind in (Feedback.MOUSE_DOWN, Feedback.MOUSE_UP, Feedback.MOUSE_DOWN, Feedback.POSE_UPDATE):
        clik.mouse.publish(feedback(kind, P_E + UP))
    clik.status()
    assert height(clik) == pytest.approx(P_E[2], abs=1e-6)
    clik.arm.send(clik.arm.message(clik.arm.q + 1e-3))  # under the stamp of the last one
    clik.status(lambda s: values(s)["cause"] == "stamp_stuck")
    clik.arm.ticks(200, dt=0.01)
    clik.mouse.publish(feedback(Feedback.MOUSE_UP, P_E + UP))
    clik.status(lambda s: "~/target/feedback rejected" in values(s))
    assert values(clik.status())["mode"] == "stopped"
    drag(clik, P_E + UP)
    clik.graph.until(lambda: height(clik) > P_E[2] + 0.999 * UP[2], "the arm at the target")
