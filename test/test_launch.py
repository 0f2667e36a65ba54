"""The launch files: what they start, with which parameters, files and topics."""

import runpy
import signal
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml
from in_process import World
from ros_processes import FRAMES, HOME, UR5, Arm, Process, environment
from sensor_msgs.msg import JointState

from eulerparams_control.bags.ros.recorder_node import RecorderParameters
from eulerparams_control.command_line import executables
from eulerparams_control.errors import UnknownNameError
from eulerparams_control.parameters.fields import from_mapping
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.parameters.watchdog import WatchdogParameters
from eulerparams_control.ros.interactive_target import FEEDBACK, UPDATE
from sim_bridge.bridge_parameters import BridgeParameters

ROOT = Path(__file__).resolve().parents[1]
ADMITS = "impedance_control"
POSITIONS = "clik", "admittance"
EFFORTS = "compliance_control", "dynamic_control", "impedance_control"
TAKES = {
    **dict.fromkeys(("bringup", "ur", "any"), (*POSITIONS, *EFFORTS, "push_test")),
    "franka": (*EFFORTS, "push_test"),
    **dict.fromkeys(("iiwa", "gen3"), (*POSITIONS, "push_test")),
}
CASES = [(file, controller) for file, controllers in TAKES.items() for controller in controllers]
PARAMETERS = {name: scheme.parameters for name, scheme in schemes().items()} | {
    "watchdog": WatchdogParameters,
    "pybullet_bridge": BridgeParameters,
    "bag_recorder": RecorderParameters,
}


def stand_in(kind: str) -> Callable[..., SimpleNamespace]:
    """Return what stands in for a class of ``launch``: it keeps what it is given."""
    return lambda *args, **given: SimpleNamespace(
        kind=kind, args=args, perform=lambda context: context[args[0]], **given
    )


@pytest.fixture
def launched(monkeypatch):
    """Return a function that returns the nodes of a launch file, without ``launch``."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    for name, kinds in {
        "launch": ("Action", "LaunchContext", "LaunchDescription"),
        "launch.actions": (
            *("DeclareLaunchArgument", "IncludeLaunchDescription", "LogInfo", "OpaqueFunction"),
        ),
        "launch.substitutions": ("LaunchConfiguration",),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
    }.items():
        module = ModuleType(name)
        vars(module).update({kind: stand_in(kind) for kind in kinds})
        monkeypatch.setitem(sys.modules, name, module)

    def nodes(path: str, context: dict[str, str]) -> list[SimpleNamespace]:
        found: list[SimpleNamespace] = []
        for each in runpy.run_path(path)["generate_launch_description"]().args[0]:
            if each.kind == "DeclareLaunchArgument":
                word = context.setdefault(each.args[0], each.default_value)
                assert word in (getattr(each, "choices", None) or [word]), each.args[0]
            elif each.kind == "IncludeLaunchDescription":
                found += nodes(*each.args, context)
            else:
                found += each.function(context)
        return found

    return lambda file, **given: nodes(str(ROOT / "launch" / f"{file}.launch.py"), given)


def values(node: SimpleNamespace) -> dict[str, Any]:
    """Return all parameters of a node, checked as it would itself."""
    found: dict[str, Any] = {}
    for given in node.parameters:
        if isinstance(given, str):
            given = yaml.safe_load(Path(given).read_text())["/**"]["ros__parameters"]
        found |= given
    return vars(from_mapping(PARAMETERS[node.executable], found))


def by_name(nodes: Sequence[SimpleNamespace]) -> dict[str, SimpleNamespace]:
    return {node.executable: node for node in nodes}


@cache
def sources() -> str:
    folders = ROOT / "eulerparams_control" / "ros", ROOT / "sim_bridge"
    return "".join(path.read_text() for folder in folders for path in folder.glob("*.py"))


def leading(folder: Path, rules: Sequence[str] = ()) -> set[str]:
    """Return the topics that lead the arm of ``clik``: it listens to them while it is active."""
    folder.mkdir()
    with World(folder) as world:
        node = world.start("clik", FRAMES, remap=rules).node
        before = {each.topic_name for each in node.subscriptions}
        arm = Arm(world, UR5)
        arm.connect()
        arm.tick()
        return {each.topic_name for each in node.subscriptions} - before


@pytest.mark.parametrize(("file", "controller"), CASES)
def test_a_launch_file_names_what_is_there(launched, file, controller):
    nodes = launched(file, controller=controller, record="true")
    assert "bag_recorder" in by_name(nodes)
    for node in nodes:
        assert node.executable in executables()
        given = values(node)
        if controller == "push_test" and node.executable == "impedance_control":  # no commands
            assert given["command_type"] == "none"
            assert given["wrench_sign"] == (-1 if file == "franka" else 1)
        for topic, _ in node.remappings:
            assert topic in (FEEDBACK, UPDATE) or f'"{topic}"' in sources(), topic


@pytest.mark.parametrize("file", TAKES)
def test_a_launch_file_offers_what_its_driver_takes(launched, file):
    for controller in (*POSITIONS, *EFFORTS):
        if controller not in TAKES[file]:
            with pytest.raises(AssertionError, match="controller"):
                launched(file, controller=controller)
    if file != "bringup":
        with pytest.raises(AssertionError, match="sim"):
            launched(file, sim="true")


@pytest.mark.parametrize("controller", EFFORTS)
@pytest.mark.parametrize("file", ["ur", "franka", "any"])
def test_efforts_reach_a_driver_through_the_watchdog_only(launched, file, controller):
    nodes = by_name(launched(file, controller=controller))
    watchdog, sender = nodes["watchdog"], nodes[controller]
    assert "joint_effort" not in dict(sender.remappings) | dict(watchdog.remappings)
    assert values(sender)["command_type"] == "joint_state"
    topic = dict(watchdog.remappings)["driver_effort"]
    kind = {"forward": "forward_effort_controller/commands", "joint_state": "/robot_joint_command"}
    assert topic == kind[values(watchdog)["command_type"]]
    names = "compensate_gravity", "base_frame", "tip_frame"
    assert [values(watchdog)[name] for name in names] == [values(sender)[name] for name in names]
    assert values(sender)["compensate_gravity"] is (file == "any")


def test_positions_are_sent_as_the_controller_of_the_driver_takes_them(launched):
    for name, kind, topic in (
        ("forward_position_controller", "forward", "commands"),
        ("scaled_joint_trajectory_controller", "joint_trajectory", "joint_trajectory"),
    ):
        (clik,) = launched("ur", position_controller=name)
        assert values(clik)["command_type"] == kind
        assert dict(clik.remappings)["joint_reference"] == f"{name}/{topic}"


def test_in_an_admittance_clik_follows_the_compliant_frame_and_nothing_else(launched, tmp_path):
    nodes = by_name(launched("bringup", controller="admittance"))
    assert nodes.keys() == {"pybullet_bridge", "impedance_control", "clik"}
    assert values(nodes["pybullet_bridge"])["control"] == "position"
    assert values(nodes["impedance_control"])["command_type"] == "none"
    rules = [f"{topic}:={other}" for topic, other in nodes["clik"].remappings]
    alone, following = leading(tmp_path / "alone"), leading(tmp_path / "following", rules)
    assert {"/reference", "/target_pose", "/target_twist"} < alone
    assert {topic for topic in following if not topic.startswith("/clik/")} == {"/compliant_frame"}
    assert not alone & following


def test_the_page_is_attached_to_the_controller_that_takes_the_targets(launched):
    nodes = by_name(launched("bringup", controller="admittance", live="true", namespace="left"))
    page = nodes["live"]
    assert (page.arguments, page.namespace) == (["--attach", "--controller", ADMITS], "left")
    assert values(nodes["pybullet_bridge"])["external_wrench_timeout"] > 0
    assert "live" not in by_name(launched("bringup"))


def test_a_simulated_robot_brings_its_frames_and_what_is_given_counts_last(launched, tmp_path):
    own = tmp_path / "own.yaml"
    own.write_text("/**: {ros__parameters: {k_Vp: 30.0}}")
    given = {"controller": "dynamic_control", "robot": "panda", "params_file": str(own)}
    nodes = by_name(
        launched("bringup", watchdog="true", parameters="{watchdog: {timeout: 0.2}}", **given)
    )
    assert values(nodes["dynamic_control"])["tip_frame"] == "panda_hand_tcp"
    assert values(nodes["dynamic_control"])["k_Vp"] == 30.0
    assert values(nodes["watchdog"])["timeout"] == 0.2
    bridge = nodes["pybullet_bridge"]
    assert values(bridge)["robot"] == "panda"
    assert values(bridge)["control"] == "torque"
    assert dict(bridge.remappings)["joint_effort"] == "driver_effort"
    with pytest.raises(UnknownNameError, match="did you mean 'watchdog'"):
        launched("bringup", parameters="{watchdogs: {}}")


@pytest.mark.parametrize("given", ["rviz", "foxglove"])
def test_what_shows_an_arm_is_started_where_it_is_installed(launched, tmp_path, monkeypatch, given):
    package = {"rviz": "rviz2", "foxglove": "foxglove_bridge"}[given]
    kinds = [each.kind for each in launched("bringup", **{given: "true"})]
    assert kinds.count("Node") == 2  # the robot and its controller
    (line,) = (each for each in launched("bringup", **{given: "true"}) if each.kind == "LogInfo")
    assert f"apt install ros-jazzy-{package.replace('_', '-')}" in line.msg
    (index := tmp_path / "share/ament_index/resource_index/packages").mkdir(parents=True)
    (index / package).touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}:{sys.prefix}")
    arm = {"namespace": "left", "topics": "{wrench: /sensor/wrench}"}
    nodes = [each for each in launched("bringup", **{given: "true"}, **arm) if each.kind == "Node"]
    (viewer,) = [node for node in nodes if node.package == package]
    if given == "foxglove":
        assert viewer.parameters == [{"address": "127.0.0.1"}]  # not the network
    if given == "rviz":
        assert viewer.namespace == "left"
        assert dict(viewer.remappings)["wrench"] == "/sensor/wrench"
        _, file, _, base = viewer.arguments
        assert Path(file).is_file()
        assert base == "base_link"


@pytest.mark.slow
def test_bringup_moves_the_simulated_robot_and_ctrl_c_ends_all(graph, tmp_path):
    pytest.importorskip("launch_ros.actions")
    names = "pybullet_bridge", "clik", "bag_recorder"
    (index := tmp_path / "share/ament_index/resource_index/packages").mkdir(parents=True)
    (index / "eulerparams_control").touch()
    (folder := tmp_path / "lib/eulerparams_control").mkdir(parents=True)
    for name in names:
        (folder / name).symlink_to(Path(sys.executable).with_name(name))
    given = [("record", "true"), ("parameters", f"{{bag_recorder: {{output: {tmp_path}/bag}}}}")]
    code = f"""
from launch import LaunchDescription, LaunchService, actions
file = actions.IncludeLaunchDescription("{ROOT}/launch/bringup.launch.py", launch_arguments={given})
(service := LaunchService()).include_launch_description(LaunchDescription([file]))
raise SystemExit(service.run())
"""
    env = environment(tmp_path, graph.domain) | {"AMENT_PREFIX_PATH": f"{tmp_path}:{sys.prefix}"}
    commands = graph.peer.listen(JointState, "joint_reference")
    process = Process([sys.executable, "-c", code], tmp_path / "launch", "launch", env)
    graph.processes.append(process)
    graph.until(lambda: commands or process.exit_code is not None, "a command")
    assert commands, process.log
    assert commands[-1].position.tolist() == pytest.approx(HOME.tolist(), abs=1e-6)
    process.signal(signal.SIGINT)
    assert process.end() == 0
    assert process.log.count("process has finished cleanly") == len(names)
    assert (tmp_path / "bag" / "metadata.yaml").is_file()
