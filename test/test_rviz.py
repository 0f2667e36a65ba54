"""RViz and other views: what their files name, ~/markers, /tf, a target that is dragged."""

import json
import math
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace

import geometry_msgs.msg
import numpy as np
import pytest
import yaml
from ros_processes import FRAMES, HOME, MODEL, UR5, Controlled, assert_holds, pose, values
from test_sources import REAL, go_on
from visualization_msgs.msg import InteractiveMarkerFeedback as Feedback
from visualization_msgs.msg import InteractiveMarkerUpdate, MarkerArray
from visualization_msgs.srv import GetInteractiveMarkers

from eulerparams_control.control.controller import Controller
from eulerparams_control.messages.from_ros import vector_from_ros
from eulerparams_control.messages.to_ros import pose_to_ros, stamp_to_ros

VIEWS = Path(__file__).parents[1] / "config" / "views"
KINDS = {
    "RobotModel": "std_msgs/msg/String",
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "Wrench": "geometry_msgs/msg/WrenchStamped",
}
P_E, R_E = pose(HOME)
UP = np.array([0.0, 0.0, 0.02])
PUSH = (3.0, -2.0, 4.0, 0.1, 0.2, -0.3)


def number(topics, path):
    """Return a number at a path of a topic and fields, as the views name it."""
    topic = next(each for each in topics if path.startswith((f"{each}/", f"{each}.")))
    value = getattr(geometry_msgs.msg, topics[topic].removeprefix("geometry_msgs/msg/"))()
    for field in path.removeprefix(topic)[1:].replace(".", "/").split("/"):
        value = getattr(value, field)
    return value


def test_the_views_show_what_there_is(world):
    world.start("pybullet_bridge", {"mode": "lockstep"})
    for name in Controlled.ARMS:
        world.start(name, FRAMES)
    topics = {name: types[0] for name, types in world.peer.node.get_topic_names_and_types()}
    view = yaml.safe_load((VIEWS / "arm.rviz").read_text(encoding="utf-8"))
    for display in view["Visualization Manager"]["Displays"]:
        if topic := display.get("Topic") or display.get("Description Topic"):
            assert topics[f"/{topic['Value']}"] == KINDS[display["Class"].rpartition("/")[2]]
        if server := display.get("Interactive Markers Namespace"):
            assert topics[f"/{server}/update"] == "visualization_msgs/msg/InteractiveMarkerUpdate"
    for panel in json.loads((VIEWS / "foxglove.json").read_text())["configById"].values():
        assert {*panel.get("topics", {})} | {panel.get("topicToRender", "/clock")} <= {*topics}
        assert all(number(topics, path["value"]) == 0 for path in panel.get("paths", ()))
    curves = [each.get("name") for each in ET.parse(VIEWS / "plotjuggler.xml").iter("curve")]
    assert len(curves) > 20
    assert all(number(topics, curve) in (0.0, 1.0) for curve in curves)


def test_frames_wrench_and_stiffness_are_drawn_where_they_are_and_never_old(world, monkeypatch):
    name, stiffness = "impedance_control", {"K_p": [1000.0, 500.0, 250.0]}
    running = Controlled(world, name, FRAMES | stiffness, namespace="/left")
    arrays = world.peer.listen(MarkerArray, f"/left/{name}/markers")
    frames = on_tf(running)
    running.arm.push(*PUSH)
    running.arm.ticks(30)

    def drawn():
        arrays.clear()
        world.until(lambda: (running.arm.tick(), arrays)[1], "markers")
        return {marker.ns: marker for marker in arrays[-1].markers}

    def ends(marker):
        return np.array([vector_from_ros(p) for p in marker.points])

    markers = drawn()
    assert markers.keys() == {"desired", "actual", "compliant", "force", "moment", "stiffness"}
    assert markers["actual"].header.frame_id == FRAMES["base_frame"]
    for each, within in (("desired", 1e-6), ("actual", 1e-3)):
        points = ends(markers[each])
        assert points[::2] == pytest.approx(np.array([P_E] * 3), abs=within)
        assert pytest.approx(R_E, abs=10 * within) == (points[1::2] - points[::2]).T / 0.1
    for each, length, part in (("force", 0.005, PUSH[:3]), ("moment", 0.05, PUSH[3:])):
        start, end = ends(markers[each])
        assert (end - start) / length == pytest.approx(np.array(part), abs=1e-6)
    scale = sorted(vector_from_ros(markers["stiffness"].scale))
    assert scale == pytest.approx([0.05, 0.1, 0.2])  # diameters, as the stiffnesses
    found = places(frames[-1])
    assert found.keys() == {f"left/{name}/{of}" for of in ("desired", "actual", "compliant")}
    assert found[f"left/{name}/desired"] == pytest.approx(P_E, abs=1e-6)
    world.advance(1.0)  # no states come
    arrays.clear()
    world.advance(2.0)
    assert arrays == []
    monkeypatch.setattr(Controller, "fault", "stopped")
    assert drawn().keys() == {"actual"}


def on_tf(running):
    """Return the messages on /tf, as with tf2_msgs, which pip has not."""
    report, frames = running.process.node._health, []
    report._tf, report._frames = SimpleNamespace, SimpleNamespace(publish=frames.append)
    return frames


def places(msg):
    found = ((each.child_frame_id, each.transform.translation) for each in msg.transforms)
    return {name: vector_from_ros(place) for name, place in found}


@pytest.mark.parametrize("how", ["waiting", "stopped", "released"])
def test_tf_says_where_the_arm_is_while_states_come_with_commands_or_without(world, how):
    name, arm = "dynamic_control", Controlled.ARMS["dynamic_control"](world, UR5)
    waits = {"require_reference": how == "waiting"}
    running = SimpleNamespace(process=world.start(name, REAL | waits))
    frames, fast = on_tf(running), 1.6 * MODEL.limits.velocity
    go_on(arm, 1.0, period=0.001)
    keys = {"actual"} if how == "waiting" else {"actual", "desired"}
    assert places(frames[-1]).keys() == {f"{name}/{key}" for key in keys}
    if how == "stopped":
        world.peer.trigger(f"/{name}/halt")
    elif how == "released":  # it runs away
        arm.dq = fast
        for _ in range(300):
            arm.q = arm.q + 0.001 * fast
            go_on(arm, 0.001, period=0.001)
        arm.dq = 0.0 * fast
    go_on(arm, 0.02, period=0.001)
    arm.commands.clear()
    frames.clear()
    arm.q = arm.q + 0.001
    go_on(arm, 0.1, period=0.001)
    assert bool(arm.commands) is (how == "stopped")
    assert len(frames) == pytest.approx(5, abs=1)  # at state_rate
    for msg in frames:
        assert places(msg) == {f"{name}/actual": pytest.approx(pose(arm.q)[0], abs=1e-9)}
    count = len(frames)
    world.advance(2.0)  # no states come
    assert len(frames) == count


@pytest.mark.parametrize("what", ["~/markers", "/tf"])
def test_a_view_that_fails_is_named_and_the_arm_is_controlled_on(world, what):
    running = Controlled(world, "clik", FRAMES)
    on_tf(running)
    node = running.process.node

    def fail(*_):
        raise ZeroDivisionError("planted")

    if what == "/tf":
        node._health._frames.publish = fail
    else:
        node._rviz.show = fail
    running.arm.ticks(50)
    world.advance(0.2)
    assert "internal error ZeroDivisionError: planted" in running.process.log
    assert f", of {what}" in running.process.log
    assert_holds(running.arm.tick(), HOME)


# --- the target, which the mouse moves -------------------------------------------------------
@pytest.fixture
def clik(world):
    clik = Controlled(world, "clik", FRAMES)
    clik.updates = world.peer.listen(InteractiveMarkerUpdate, "clik/target/update")
    clik.mouse = world.peer.publisher(Feedback, "clik/target/feedback")
    clik.arm.tick()
    return clik


def send(clik, *kinds, p=P_E + UP, frame_id=FRAMES["base_frame"]):
    at = pose_to_ros(p, R_E, stamp_to_ros(0), frame_id)
    for kind in kinds:
        clik.mouse.publish(Feedback(header=at.header, pose=at.pose, event_type=kind))


def height(clik):
    clik.arm.tick()
    return pose(clik.arm.q)[0][2] - P_E[2]


DRAG = Feedback.MOUSE_DOWN, Feedback.POSE_UPDATE, Feedback.MOUSE_UP


def test_the_target_is_at_the_tip_and_is_gone_to_when_it_is_released_not_while_it_is_dragged(clik):
    clik.graph.until(lambda: (clik.arm.tick(), len(clik.updates) > 1)[1], "two updates")
    ((marker,), (moved,)) = clik.updates[0].markers, clik.updates[1].poses
    assert vector_from_ros(marker.pose.position) == pytest.approx(P_E, abs=1e-6)
    assert moved.pose == marker.pose
    asked = GetInteractiveMarkers, "clik/target/get_interactive_markers"
    given = clik.peer.call(*asked, GetInteractiveMarkers.Request()).markers
    assert [each.name for each in given] == [marker.name]
    assert sorted(control.interaction_mode for control in marker.controls) == [3] * 3 + [5] * 3
    send(clik, *DRAG[:2])
    shown = len(clik.updates)
    for _ in range(4):
        clik.graph.advance(0.25)
        send(clik, Feedback.KEEP_ALIVE)
    assert max(height(clik) for _ in range(300)) < 1e-6
    assert len(clik.updates) == shown  # it stays with the mouse
    send(clik, Feedback.MOUSE_UP)
    clik.graph.until(lambda: height(clik) > 0.999 * UP[2], "the arm at the target")


def test_a_mouse_that_vanishes_while_it_drags_leaves_the_target_to_others(clik):
    def goes_on(seconds):
        before = len(clik.updates)
        for _ in range(round(seconds / 0.1)):
            clik.arm.tick()
            clik.graph.advance(0.1)
        return len(clik.updates) > before

    send(clik, *DRAG[:2])
    for _ in range(5):
        assert not goes_on(0.7)
        send(clik, Feedback.KEEP_ALIVE)
    assert goes_on(1.5)
    send(clik, Feedback.POSE_UPDATE, Feedback.MOUSE_UP)  # it was not gone after all
    assert max(height(clik) for _ in range(300)) < 1e-6
    send(clik, *DRAG)
    clik.graph.until(lambda: height(clik) > 0.999 * UP[2], "the arm at the target")


@pytest.mark.parametrize("bad", [{"p": P_E + math.nan}, {"frame_id": "nowhere"}])
def test_an_impossible_target_is_rejected_and_moves_nothing(clik, bad):
    send(clik, *DRAG, **bad)
    assert clik.status(lambda s: "~/target/feedback rejected" in values(s))
    assert height(clik) == pytest.approx(0.0, abs=1e-6)


def test_a_click_moves_nothing_and_a_drag_that_began_before_a_fault_does_not_end_it(clik):
    def dragging():
        clik.arm.tick()
        send(clik, Feedback.KEEP_ALIVE)

    send(clik, Feedback.MOUSE_DOWN, Feedback.MOUSE_UP, *DRAG[:2])
    clik.peer.status("clik", meanwhile=dragging)
    assert height(clik) == pytest.approx(0.0, abs=1e-6)
    for _ in range(3):
        clik.arm.send(clik.arm.message(clik.arm.q + 1e-3))  # under the stamp of the last one
    clik.peer.status("clik", lambda s: values(s)["cause"] == "stamp_stuck", dragging)
    clik.arm.ticks(200, dt=0.01)
    send(clik, Feedback.MOUSE_UP)
    clik.status(lambda s: "~/target/feedback rejected" in values(s))
    assert values(clik.status())["mode"] == "stopped"
    send(clik, *DRAG)
    clik.graph.until(lambda: height(clik) > 0.999 * UP[2], "the arm at the target")
