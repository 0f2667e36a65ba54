"""The views that are shipped for RViz, Foxglove and PlotJuggler: what they name is there.

The names of displays, panels and properties are those of the sources of ros2/rviz (Jazzy), of
Foxglove's open source (Lichtblick) and of PlotJuggler 3.
"""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from ros_processes import FRAMES

VIEWS = Path(__file__).parents[1] / "config" / "views"
CONTROLLERS = ("clik", "dynamic_control", "impedance_control", "compliance_control")
# Of each display of RViz: its properties besides those that all have, and the type of its topic.
OF_ALL = {"Class", "Name", "Enabled", "Value"}
DISPLAYS = {
    "Grid": ({"Cell Size", "Plane Cell Count", "Alpha", "Color", "Reference Frame"}, ""),
    "RobotModel": (
        {"Alpha", "Visual Enabled", "Collision Enabled", "Description Source", "TF Prefix"}
        | {"Description Topic"},
        "std_msgs/msg/String",
    ),
    "TF": ({"Show Names", "Show Axes", "Show Arrows", "Marker Scale", "Frame Timeout"}, ""),
    "MarkerArray": ({"Topic"}, "visualization_msgs/msg/MarkerArray"),
    "InteractiveMarkers": (
        {"Interactive Markers Namespace", "Show Descriptions", "Show Axes", "Show Visual Aids"}
        | {"Enable Transparency"},
        "",
    ),
    "Wrench": (
        {"Topic", "Force Arrow Scale", "Torque Arrow Scale", "Arrow Width", "History Length"}
        | {"Accept NaN Values"},
        "geometry_msgs/msg/WrenchStamped",
    ),
}
QOS = {"Depth", "Durability Policy", "History Policy", "Reliability Policy", "Value"}
PANELS = {
    "3D": {"cameraState", "followMode", "scene", "transforms", "topics", "layers", "publish"}
    | {"imageMode"},
    "Plot": {"paths", "showXAxisLabels", "showYAxisLabels", "showLegend", "legendDisplay"}
    | {"showPlotValuesInLegend", "isSynced", "xAxisVal", "sidebarDimension"}
    | {"followingViewWidth", "foxglovePanelTitle"},
    "DiagnosticSummary": {"minLevel", "pinnedIds", "topicToRender", "hardwareIdFilter"}
    | {"sortByLevel"},
}


@pytest.fixture(scope="module")
def topics(shared_world):
    """Return the types of the topics that there are, of the bridge and of all controllers."""
    shared_world.start("pybullet_bridge", {"mode": "lockstep"})
    for name in CONTROLLERS:
        shared_world.start(name, FRAMES)
    found = shared_world.peer.node.get_topic_names_and_types()
    return {name: types[0] for name, types in found}


def test_rviz_shows_what_there_is(topics):
    view = yaml.safe_load((VIEWS / "arm.rviz").read_text(encoding="utf-8"))
    manager = view["Visualization Manager"]
    shown = set()
    for display in manager["Displays"]:
        package, _, name = display["Class"].partition("/")
        properties, kind = DISPLAYS[name]
        assert package == "rviz_default_plugins"
        assert display.keys() == properties | OF_ALL
        assert display["Enabled"] == display["Value"]
        topic = display.get("Topic") or display.get("Description Topic")
        if topic is not None:
            assert topic.keys() == QOS
            assert topics[f"/{topic['Value']}"] == kind  # relative: of the namespace of rviz2
            shown.add(topic["Value"])
        if server := display.get("Interactive Markers Namespace"):
            assert topics[f"/{server}/update"] == "visualization_msgs/msg/InteractiveMarkerUpdate"
            shown.add(server)
    assert {f"{name}/{of}" for name in CONTROLLERS for of in ("markers", "target")} < shown
    latched = [d for d in manager["Displays"] if "Description Topic" in d]
    assert [d["Description Topic"]["Durability Policy"] for d in latched] == ["Transient Local"]
    tools = {tool["Class"] for tool in manager["Tools"]}
    assert tools == {
        f"rviz_default_plugins/{name}" for name in ("Interact", "MoveCamera", "Measure")
    }
    assert manager["Global Options"].keys() == {"Background Color", "Fixed Frame", "Frame Rate"}


def leaves(layout):
    """Return the panels of a mosaic."""
    if isinstance(layout, str):
        return [layout]
    assert layout["direction"] in ("row", "column")
    assert layout.keys() <= {"direction", "first", "second", "splitPercentage"}
    return [*leaves(layout["first"]), *leaves(layout["second"])]


def test_foxglove_shows_what_there_is(topics):
    view = json.loads((VIEWS / "foxglove.json").read_text(encoding="utf-8"))
    assert view.keys() == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    panels = view["configById"]
    assert sorted(leaves(view["layout"])) == sorted(panels)
    for key, panel in panels.items():
        assert panel.keys() == PANELS[key.partition("!")[0]]
        for name in panel.get("topics", {}):
            assert topics[name] in ("std_msgs/msg/String", "visualization_msgs/msg/MarkerArray")
        for path in panel.get("paths", ()):
            assert path.keys() == {"value", "label", "enabled", "timestampMethod"}
            topic, *fields = path["value"].split(".")
            assert_has(topics[topic], fields)
    assert topics[panels["DiagnosticSummary!state"]["topicToRender"]].endswith("DiagnosticArray")


def assert_has(kind, fields):
    """Assert that a message of a type has a number in a field of a field."""
    types = {f"geometry_msgs/msg/{each.__name__}": each
             for each in (PoseStamped, TwistStamped, WrenchStamped)}  # fmt: skip
    value = types[kind]()
    for field in fields:
        value = getattr(value, field)
    assert isinstance(value, float)


def test_plotjuggler_shows_what_there_is(topics):
    root = ET.parse(VIEWS / "plotjuggler.xml").getroot()
    (window,) = root.findall("tabbed_widget")
    assert window.attrib == {"name": "Main Window", "parent": "main_window"}
    for splitter in window.iter("DockSplitter"):
        assert splitter.get("orientation") in ("|", "-")
        assert int(splitter.get("count")) == len(splitter) == splitter.get("sizes").count(";") + 1
    for plot in window.iter("plot"):
        assert plot.get("mode") == "TimeSeries"
        assert plot.get("style") == "Lines"
        for curve in plot.iter("curve"):
            name = curve.get("name")
            topic = next(each for each in topics if name.startswith(each + "/"))
            assert_has(topics[topic], name.removeprefix(topic + "/").split("/"))
    assert len(list(window.iter("curve"))) > 20
