"""The launch files: what they start, with which parameters, files and topics."""

import re
import runpy
import signal
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import rclpy
import yaml
from in_process import World, class_of
from ros_processes import FRAMES, HOME, UR5, Arm, Process, environment
from sensor_msgs.msg import JointState

from eulerparams_control.command_line import executables
from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.parameters.fields import from_mapping
from eulerparams_control.parameters.schemes import COMMANDS
from eulerparams_control.resources import config_names
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.ros.arm_launch import load_arm, parameter_files
from eulerparams_control.ros.rviz import FEEDBACK, UPDATE

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


def passed(node: SimpleNamespace) -> dict[str, Any]:
    """Return all parameters that a node is started with."""
    found: dict[str, Any] = {}
    for given in node.parameters:
        if isinstance(given, str):
            given = yaml.safe_load(Path(given).read_text())["/**"]["ros__parameters"]
        found |= given
    return found


def values(node: SimpleNamespace) -> dict[str, Any]:
    """Return all parameters of a node, checked as it would itself."""
    return vars(from_mapping(class_of(node.executable).parameters_type, passed(node)))


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
            is_known = topic in (FEEDBACK, UPDATE, *COMMANDS.values())
            assert is_known or f'"{topic}"' in sources(), topic


@pytest.mark.parametrize("file", sorted(TAKES.keys() - {"bringup"}))
def test_a_launch_file_offers_what_its_driver_takes(launched, file):
    refused = [("controller", name) for name in {*POSITIONS, *EFFORTS}.difference(TAKES[file])]
    for name, word in (*refused, ("sim", "true")):
        with pytest.raises(AssertionError, match=name):
            launched(file, **{name: word})


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


@pytest.mark.parametrize("file", ["ur", "any"])
def test_positions_are_sent_as_the_controller_of_the_driver_takes_them(launched, file):
    for name, kind, topic in (
        ("forward_position_controller", "forward", "commands"),
        ("scaled_joint_trajectory_controller", "joint_trajectory", "joint_trajectory"),
    ):
        (clik,) = launched(file, controller="clik", position_controller=name)
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


@pytest.mark.parametrize("controller", TAKES["any"])
def test_a_controller_of_efforts_knows_the_rotors_of_a_simulated_robot(launched, controller):
    """No driver says them of a real one."""
    knows, known = "rotor_inertia", load_robot("panda").rotor_inertia
    takes_efforts = controller in ("compliance_control", "dynamic_control", "impedance_control")
    cases = ("", known), ("{pybullet_bridge: {rotor_inertia: [0.0]}}", (0.0,))
    for text, expected in cases:
        nodes = by_name(launched("bringup", robot="panda", controller=controller, parameters=text))
        found = {name: values(node).get(knows) for name, node in nodes.items()}
        assert not takes_efforts or found[controller] == expected
        assert found.get("clik") is None
    if takes_efforts:
        real = by_name(launched("any", controller=controller))
        assert values(real[controller])[knows] == ()


SENSOR = "/franka_robot_state_broadcaster/external_wrench_in_stiffness_frame"
RELIABILITY = f"qos_overrides.{SENSOR}.subscription.reliability"


@pytest.mark.parametrize(
    ("text", "changed"),
    [
        (" {impedance_control: {K_p: [500, 5e2, 50]}, watchdog: {timeout: 0.1}} ",
         {"impedance_control": {"K_p": [500.0, 500.0, 50.0]}, "watchdog": {"timeout": 0.1}}),
        ("impedance_control: {max_approach_speed: 1e-2, posture: []}",
         {"impedance_control": {"max_approach_speed": 0.01, "posture": []}}),
        (f"{{impedance_control: {{{RELIABILITY}: reliable}}}}",
         {"impedance_control": {RELIABILITY: "reliable"}}),
        (f"{{impedance_control: {{qos_overrides: {{{SENSOR}: {{subscription: {{depth: 5}}}}}}}}}}",
         {"impedance_control": {f"qos_overrides.{SENSOR}.subscription.depth": 5}}),
        ("{watchdog: {}, impedance_control: }", {}),
        ("", {}),
    ],
)  # fmt: skip
def test_parameters_are_merged_key_by_key_into_those_of_the_arm(launched, text, changed):
    given = {"controller": "impedance_control"}
    before = by_name(launched("franka", **given))
    after = by_name(launched("franka", parameters=text, **given))
    assert after.keys() == before.keys()
    for name, node in after.items():
        assert passed(node) == passed(before[name]) | changed.get(name, {})
        assert values(node)["compensate_gravity"] is False
    assert values(after["impedance_control"])["wrench_sign"] == -1


TEXTS = {"a": "1e-3", "b": "y", "c": "0x1F", "d": "\u00fc \U0001f600 'x' \"\n", "e": "null"}


def test_a_text_that_looks_like_something_else_is_a_text_for_the_node_too():
    (file,) = parameter_files({**TEXTS, "f": 1e-5, "g": [], "h": [1.0, 2.0], "i": True, "j": 3})
    context = rclpy.Context()
    context.init(["--ros-args", "--params-file", file])
    node = rclpy.create_node("any", context=context)
    found = {name: each.value for name, each in node._parameter_overrides.items()}
    context.shutdown()
    assert found.pop("g") in (None, [])
    assert found == {**TEXTS, "f": 1e-5, "h": [1.0, 2.0], "i": True, "j": 3}


@pytest.mark.parametrize("empty", ["{}", "", " "])
def test_topics_are_merged_key_by_key_into_those_of_the_arm(launched, empty):
    given = {"controller": "impedance_control"}
    before = dict(launched("franka", **given)[0].remappings)
    assert before["joint_states"] == "/franka/joint_states"
    assert dict(launched("franka", topics=empty, **given)[0].remappings) == before
    nodes = by_name(launched("franka", topics="{wrench: /sensor/wrench}", **given))
    assert nodes.keys() == {"watchdog", "impedance_control"}
    for node in nodes.values():
        assert dict(node.remappings) == before | {"wrench": "/sensor/wrench"}


@pytest.mark.parametrize(
    ("argument", "text", "words"),
    [
        ("parameters", "{watchdogs: {}}", "unknown node 'watchdogs' (did you mean 'watchdog'?)"),
        ("parameters", "{watchdog: {timeot: 0.1}}", "'timeot' (did you mean 'timeout'?); known: "),
        ("parameters", "{watchdog: {timeout: 99}}", "'timeout' is 99 s; expected between 0.002 "),
        ("parameters", "{watchdog: 0.1}", "parameters of 'watchdog': 0.1; expected a mapping"),
        ("parameters", "[1]", "parameters is '[1]'; expected a mapping in YAML, parameters:='{"),
        ("parameters", "{watchdog: {timeout: 0.1}", "expected a mapping in YAML"),
        ("parameters", "{watchdog: {compensate_gravity: true}}",
         "compensate_gravity is false for impedance_control, and true for watchdog"),
        ("parameters", "{impedance_control: {compensate_gravity: true}}",
         "compensate_gravity is true for impedance_control, and false for watchdog"),
        ("topics", "{wrensh: /w}", "unknown topic 'wrensh' (did you mean 'wrench'?); known: "),
        ("topics", "{wrench: }", "topic 'wrench' is None; expected the name of a topic"),
        ("topics", "wrench", "topics is 'wrench'; expected a mapping in YAML, topics:='{"),
    ],
)  # fmt: skip
def test_what_is_given_and_impossible_is_refused_with_what_was_expected(
    launched, argument, text, words
):
    with pytest.raises(ConfigurationError, match=re.escape(words)) as refusal:
        launched("franka", controller="impedance_control", **{argument: text})
    assert "\n" not in str(refusal.value)


def section(**values: Any) -> dict[str, Any]:
    return {"ros__parameters": values}


def test_a_file_of_parameters_is_merged_into_those_of_the_arm_for_the_nodes_that_it_names(
    launched, tmp_path
):
    given = {"controller": "impedance_control", "parameters": "{watchdog: {timeout: 0.2}}"}
    before = by_name(launched("ur", **given))
    own = {
        "/**": section(k_Vp=30.0),
        "watchdog": section(damping=10.0),
        "/left/impedance_control": section(k_Vo=31.0),
        "/right/impedance_control": section(k_Vo=32.0),
        "/**/impedance_control": section(wrench_bias=[0.0] * 6),
        "/*/watchdog": section(state_timeout=0.2),
        "/right/*": section(k_Pp=1.0),
        "gripper_controller": section(x=1),
    }
    (file := tmp_path / "own.yaml").write_text(yaml.safe_dump(own))
    nodes = by_name(launched("ur", params_file=str(file), namespace="left", **given))
    watchdog, control = nodes["watchdog"], nodes["impedance_control"]
    added = {"damping": 10.0, "state_timeout": 0.2}
    assert passed(watchdog) == passed(before["watchdog"]) | added
    added = {"k_Vp": 30.0, "k_Vo": 31.0, "wrench_bias": [0.0] * 6}
    assert passed(control) == passed(before["impedance_control"]) | added


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"watchdg": section()}, "unknown node 'watchdg' (did you mean 'watchdog'?)"),
        ({"/**": section(k_pp=1.0)}, "'k_pp' (did you mean 'k_Pp'?)"),
        ({"watchdog": section(timeout="x")}, "'timeout' is 'x', a str; expected a float"),
        ({"gripper": section()}, "is for /gripper; expected one of "),
        ([1], "holds [1]; expected a mapping"),
        (None, "is for no node; expected one of "),
    ],
)
def test_a_file_of_parameters_that_is_impossible_is_refused_by_its_name(
    launched, tmp_path, content, words
):
    (file := tmp_path / "own.yaml").write_text(yaml.safe_dump(content))
    for path, expected in ((file, words), (tmp_path / "none.yaml", "No such file")):
        with pytest.raises(ConfigurationError, match=re.escape(expected)) as refusal:
            launched("ur", controller="impedance_control", params_file=str(path))
        assert str(path) in str(refusal.value)


def test_the_watchdog_knows_the_arm_as_its_controller_does(launched):
    told = "{compensate_gravity: false, tool_mass: 2.0, tool_com: [0, 0, 0.1], joints: [a, b]}"
    text = f"{{dynamic_control: {told}, watchdog: {{tool_mass: 2.5}}}}"
    watchdog = by_name(launched("any", controller="dynamic_control", parameters=text))["watchdog"]
    assert values(watchdog)["compensate_gravity"] is False
    assert values(watchdog)["tool_com"] == (0.0, 0.0, 0.1)
    assert values(watchdog)["joints"] == ("a", "b")
    assert values(watchdog)["tool_mass"] == 2.5


def install(folder: Path, *packages: str) -> str:
    """Install packages as far as ament knows; return where it looks for them."""
    index = folder / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    for package in packages:
        (index / package).touch()
    return f"{folder}:{sys.prefix}"


@pytest.mark.parametrize("file", TAKES)
def test_the_time_of_all_nodes_is_that_of_the_clock_if_asked(launched, file, tmp_path, monkeypatch):
    views = "rviz2", "foxglove_bridge", "robot_state_publisher"
    monkeypatch.setenv("AMENT_PREFIX_PATH", install(tmp_path, *views))
    given = dict.fromkeys(("live", "record", "rviz", "foxglove"), "true")
    given["controller"] = controller = TAKES[file][-2]
    for asked in ("true", "false"):
        nodes = [n for n in launched(file, use_sim_time=asked, **given) if n.kind == "Node"]
        assert len(nodes) >= 5
        assert {passed(n).get("use_sim_time", False) for n in nodes} == {asked == "true"}
    if controller != "admittance":
        text = f"{{{controller}: {{use_sim_time: false}}}}"
        nodes = launched(file, use_sim_time="true", controller=controller, parameters=text)
        assert passed(by_name(nodes)[controller])["use_sim_time"] is False


def test_each_real_arm_has_its_launch_file_its_yaml_and_its_page():
    names = config_names("robots/real")
    assert names == sorted(TAKES.keys() - {"bringup"})
    page = (ROOT / "docs" / "robots.md").read_text()
    for name in names:
        assert load_arm(name).controllers == TAKES[name]
        assert f"`{name}.launch.py`" in page


def test_a_real_arm_is_added_by_one_file(launched, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "{controllers: [dynamic_control], base_frame: root, tip_frame: flange, namespace: left,"
        " effort_controller: forward_effort_controller, topics: {joint_states: /states},"
        " parameters: {dynamic_control: {compensate_gravity: false, k_Pp: 400}}}"
    )
    given = {"sim": "false", "robot": str(file)}
    text = "{dynamic_control: {k_Vp: 30.0}}"
    nodes = by_name(launched("bringup", controller="dynamic_control", parameters=text, **given))
    assert nodes.keys() == {"watchdog", "dynamic_control"}
    found = values(nodes["dynamic_control"])
    assert (found["base_frame"], found["tip_frame"]) == ("root", "flange")
    assert (found["k_Pp"], found["k_Vp"], found["compensate_gravity"]) == (400.0, 30.0, False)
    assert values(nodes["watchdog"])["compensate_gravity"] is False
    assert {node.namespace for node in nodes.values()} == {"left"}
    topics = dict(nodes["watchdog"].remappings)
    assert topics["joint_states"] == "/states"
    assert topics["driver_effort"] == "forward_effort_controller/commands"
    with pytest.raises(UnknownNameError, match="controller of 'mine': 'clik'; known: dynamic_con"):
        launched("bringup", **given)
    for content, words in (
        ("{tipframe: x}", "unknown key 'tipframe' (did you mean 'tip_frame'?)"),
        ("{parameters: {clik: {k_pp: 1.0}}}", "did you mean 'k_Pp'?"),
        ("{topics: {wrensh: /x}}", "did you mean 'wrench'?"),
        ("{controllers: clik}", "controllers is 'clik'; expected a list of names"),
        ("{namespace: }", "namespace is None; expected a name"),
        ("{watchdog: 1}", "watchdog is 1; expected true or false"),
        ("x", "holds 'x'; expected a mapping"),
    ):
        file.write_text(content)
        with pytest.raises(ConfigurationError, match=re.escape(words)) as refusal:
            launched("bringup", **given)
        assert str(file) in str(refusal.value)
    file.write_text("{controllers: [clk]}")
    with pytest.raises(UnknownNameError, match=r"controller of 'mine': 'clk' .did you mean 'clik'"):
        launched("bringup", **given)
    with pytest.raises(UnknownNameError, match="did you mean 'franka'"):
        launched("bringup", sim="false", robot="frnka")


@pytest.mark.parametrize("given", ["rviz", "foxglove"])
def test_what_shows_an_arm_is_started_where_it_is_installed(launched, tmp_path, monkeypatch, given):
    package = {"rviz": "rviz2", "foxglove": "foxglove_bridge"}[given]
    *nodes, line = sorted(launched("bringup", **{given: "true"}), key=lambda e: e.kind != "Node")
    assert [each.kind for each in nodes] == ["Node"] * 2  # the robot and its controller
    assert f"apt install ros-jazzy-{package.replace('_', '-')}" in line.msg
    monkeypatch.setenv("AMENT_PREFIX_PATH", install(tmp_path, package))
    arm = {"namespace": "left", "topics": "{wrench: /sensor/wrench}"}
    found = launched("bringup", **{given: "true"}, **arm)
    (viewer,) = [each for each in found if each.kind == "Node" and each.package == package]
    if given == "foxglove":
        assert viewer.parameters == [{"address": "127.0.0.1"}]  # not the network
        return
    assert viewer.namespace == "left"
    assert dict(viewer.remappings)["wrench"] == "/sensor/wrench"
    _, file, _, base = viewer.arguments
    assert Path(file).is_file()
    assert base == "base_link"


def start(graph: Any, tmp_path: Path, file: str, names: Sequence[str], **given: str) -> Process:
    """Start a launch file by the real ``launch``."""
    pytest.importorskip("launch_ros.actions")
    prefixes = install(tmp_path, "eulerparams_control")
    (folder := tmp_path / "lib/eulerparams_control").mkdir(parents=True)
    for name in names:
        (folder / name).symlink_to(Path(sys.executable).with_name(name))
    path, arguments = f"{ROOT}/launch/{file}.launch.py", list(given.items())
    code = f"""
from launch import LaunchDescription, LaunchService, actions
file = actions.IncludeLaunchDescription({path!r}, launch_arguments={arguments!r})
(service := LaunchService()).include_launch_description(LaunchDescription([file]))
raise SystemExit(service.run())
"""
    env = environment(tmp_path, graph.domain) | {"AMENT_PREFIX_PATH": prefixes}
    process = Process([sys.executable, "-c", code], tmp_path / "launch", "launch", env)
    graph.processes.append(process)
    return process


@pytest.mark.slow
def test_bringup_moves_the_simulated_robot_and_ctrl_c_ends_all(graph, tmp_path):
    names = "pybullet_bridge", "clik", "bag_recorder"
    output = f"{{bag_recorder: {{output: {tmp_path}/bag}}}}"
    commands = graph.peer.listen(JointState, "joint_reference")
    given = {"record": "true", "use_sim_time": "true", "parameters": output}
    process = start(graph, tmp_path, "bringup", names, **given)
    graph.until(lambda: commands or process.exit_code is not None, "a command")
    assert commands, process.log
    assert commands[-1].position.tolist() == pytest.approx(HOME.tolist(), abs=1e-6)
    process.signal(signal.SIGINT)
    assert process.end() == 0
    assert process.log.count("process has finished cleanly") == len(names)
    assert (tmp_path / "bag" / "metadata.yaml").is_file()


@pytest.mark.slow
def test_the_nodes_of_a_real_arm_have_its_parameters_and_those_that_are_given(graph, tmp_path):
    text = "{watchdog: {timeout: 0.1}, impedance_control: {posture: [], k_Pp: 1e3}}"
    given = {"controller": "impedance_control", "parameters": text}
    process = start(graph, tmp_path, "franka", ("watchdog", "impedance_control"), **given)
    for node, expected in {
        "watchdog": {"timeout": 0.1, "compensate_gravity": False, "tip_frame": "fr3_hand_tcp"},
        "impedance_control": {"k_Pp": 1e3, "compensate_gravity": False, "wrench_sign": -1},
    }.items():
        assert graph.peer.get_parameters(node, *expected) == list(expected.values())
    process.signal(signal.SIGINT)
    assert process.end() == 0
