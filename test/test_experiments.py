"""Experiments: what their files may say, and whole runs with real nodes and bags."""

import copy
import json
import math
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import synthetic_runs
import yaml
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message
from ros_processes import ROOT, Graph, Process, environment
from sensor_msgs.msg import JointState
from synthetic_runs import rewritten, write_run
from tolerances import REST

from eulerparams_control.analysis.headline import placeholders
from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.bags import Bag
from eulerparams_control.errors import (
    BagError,
    ConfigurationError,
    EulerParamsError,
    UnknownNameError,
)
from eulerparams_control.events import Event, ExitCode
from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.lab.experiments.definition import Criterion, load_experiment
from eulerparams_control.lab.experiments.evaluate import judge, write_summary
from eulerparams_control.lab.experiments.main import main
from eulerparams_control.lab.experiments.model import equation
from eulerparams_control.lab.experiments.runner import (
    IncompleteBagError,
    _check_complete,
    check_names,
    has_diverged,
    node_parameters,
    run_variant,
)
from eulerparams_control.lab.run.processes import Nodes
from eulerparams_control.laws.rotations import exp
from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.resources import config_names
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

DURATION = 0.4  # [s]
STEPS = 401  # at 1 kHz, both ends
# The beginning of T1: the tip goes up and turns about the base y axis.
T1 = {
    "motion": "way_points",
    "times": [0.0, DURATION],
    "positions": [0.485, 0.02, 0.375, 0.485, 0.03, 0.385],
    "orientation_format": "ZYZ",
    "orientations": [0.1, 0.8727, 1.5708, 0.1, 0.95, 1.5708],
}
NOISE = {"noise_position": 1e-4, "seed": 1}
GOOD: dict[str, Any] = {
    "claim": "a short run",
    "equations": ["(28)"],
    "robot": "ur5",
    "duration": DURATION,
    "controller": "clik",
    "start_at_reference": True,
    "nodes": {
        "clik": {"k_Pp": 10.0, "k_Po": 20.0, "feedback": "measured"},
        "pybullet_bridge": NOISE,
        "reference": T1,
    },
    "variants": {"first": {}, "second": {}, "angles": {"clik": {"orientation": "euler_angles"}}},
    "criteria": [{"metric": "peak_orientation_error", "below": 1.0, "predicted": 0.1}],
}


def write(folder: Path, content: Any, name: str = "short") -> Path:
    path = folder / f"{name}.yaml"
    is_text = isinstance(content, str)
    path.write_text(content if is_text else yaml.safe_dump(content, sort_keys=False))
    return path


def changed(**changes: Any) -> dict[str, Any]:
    """Return the good experiment with other values; None leaves a key out."""
    content = copy.deepcopy(GOOD) | changes
    return {key: value for key, value in content.items() if value is not None}


def criterion(**changes: Any) -> dict[str, Any]:
    return changed(criteria=[{"metric": "peak_joint_speed", "below": 1.0} | changes])


def predicted(**values: Any) -> dict[str, Any]:
    return changed(predictions=[{"quantity": "force", "text": "theory"} | values])


def charted(**values: Any) -> dict[str, Any]:
    chart = {"metric": "peak_joint_speed", "xlabel": "x", "measured": {"a": {"first": 1.0}}}
    return changed(chart=chart | values)


def started(folder: Path, **changes: Any) -> tuple[np.ndarray, dict[str, Any]]:
    """Return q at the start of the good experiment with changes, and all node parameters."""
    content = changed(**changes, variants={"only": {}})
    parameters = node_parameters(load_experiment(str(write(folder, content))).variants["only"])
    return np.array(parameters["pybullet_bridge"]["initial_positions"]), parameters


# --- what a file may say ---------------------------------------------------------------------
def test_an_experiment_is_what_its_file_says(tmp_path):
    found = load_experiment(str(write(tmp_path, GOOD)))
    assert (found.name, found.claim, found.equations) == ("short", "a short run", ("(28)",))
    assert list(found.variants) == ["first", "second", "angles"]
    common = {"k_Pp": 10.0, "k_Po": 20.0, "feedback": "measured"}
    assert found.variants["first"].nodes["clik"] == common
    assert found.variants["angles"].nodes["clik"] == {**common, "orientation": "euler_angles"}
    assert found.variants["first"].start_at_reference
    expected = Criterion("peak_orientation_error", below=1.0, predicted="0.1")
    assert found.criteria == (expected,)


def test_a_variant_may_say_otherwise_what_the_experiment_says_of_all(tmp_path):
    own = {
        "controller": "dynamic_control",
        "robot": "ur10",
        "duration": 2,
        "start_turn": [0, 0, 1.5],
        "may_diverge": True,
        "dynamic_control": {"k_Po": 9.0},
    }
    nodes = GOOD["nodes"] | {"dynamic_control": {"k_Po": 3.0, "k_Vo": 4.0}}
    content = changed(nodes=nodes, variants={"first": {}, "other": own})
    first, other = load_experiment(str(write(tmp_path, content))).variants.values()
    assert (first.controller, first.robot, first.duration) == ("clik", "ur5", 0.4)
    assert (first.start_turn, first.may_diverge) == ((0.0, 0.0, 0.0), False)
    assert (other.controller, other.robot, other.duration) == ("dynamic_control", "ur10", 2.0)
    assert (other.start_turn, other.may_diverge) == ((0.0, 0.0, 1.5), True)
    assert other.nodes["dynamic_control"] == {"k_Po": 9.0, "k_Vo": 4.0}
    assert other.nodes["reference"] == T1
    common = {"reference", "pybullet_bridge"}
    assert node_parameters(first).keys() == {"clik", *common}
    assert node_parameters(other).keys() == {"dynamic_control", *common}
    assert node_parameters(other)["dynamic_control"]["k_Po"] == 9.0
    plain = changed(start_turn=[0.0, 0.0, 1.0], variants={"home": {"start_turn": [0.0] * 3}})
    assert load_experiment(str(write(tmp_path, plain))).variants["home"].start_turn == (0, 0, 0)


def test_controllers_know_the_rotors_of_a_robot_unless_its_joints_are_ideal(tmp_path):
    keys = "rotor_inertia", "friction_viscous", "friction_coulomb"
    variants = {
        "real": {},
        "ideal": {"ideal_joints": True},
        "other": {"pybullet_bridge": {"rotor_inertia": [0.2]}},
        "positions": {"controller": "clik"},
        "admittance": {"controller": "admittance", "ideal_joints": True},
    }
    content = changed(controller="dynamic_control", variants=variants, nodes={"reference": T1})
    found = load_experiment(str(write(tmp_path, content))).variants
    nodes = {name: node_parameters(variant) for name, variant in found.items()}
    bridges = {name: each["pybullet_bridge"] for name, each in nodes.items()}
    assert not bridges["real"].keys() & {*keys}
    assert nodes["real"]["dynamic_control"]["rotor_inertia"] == ROTORS["rotor_inertia"]
    for name in ("ideal", "admittance"):
        assert [bridges[name][key] for key in keys] == [[0.0]] * 3
    assert nodes["ideal"]["dynamic_control"]["rotor_inertia"] == [0.0]
    assert nodes["other"]["dynamic_control"]["rotor_inertia"] == [0.2]
    assert "rotor_inertia" not in nodes["positions"]["clik"]
    assert nodes["admittance"]["impedance_control"]["rotor_inertia"] == [0.0]


def test_a_variant_changes_of_groups_only_what_it_names(tmp_path):
    plane = {"shape": "plane", "position": [0.0, 0.0, 0.1], "stiffness": 1e3}
    both = {"plane": plane, "wall": {"shape": "spring", "stiffness": [0.0, 0.0, 2e4]}}
    changes: dict[str, Any] = {
        "soft": {},
        "stiff": {"plane": {"stiffness": 1e5}},
        "moved": {"plane": {"position": [0.0, 0.0, 0.2]}},
        "pushed": {"hand": {"shape": "push"}},
    }
    nodes = GOOD["nodes"] | {"pybullet_bridge": NOISE | {"environment": both}}
    variants = {
        name: {"pybullet_bridge": {"environment": change, "seed": 2}}
        for name, change in changes.items()
    }
    found = load_experiment(str(write(tmp_path, changed(nodes=nodes, variants=variants)))).variants
    for name, change in changes.items():
        environment = both | change
        environment["plane"] = plane | change.get("plane", {})
        bridge = found[name].nodes["pybullet_bridge"]
        assert bridge == {"noise_position": 1e-4, "seed": 2, "environment": environment}
        assert node_parameters(found[name])["pybullet_bridge"]["environment"] == environment


PAIR = ["first", "second"]
ONE_NODE = {"use_sim_time": True, "require_reference": True, "wait_for_subscribers": 2}

WIDE = yaml.safe_load((ROOT / "config" / "clik_admittance.yaml").read_text())
WIDE = WIDE["/**"]["ros__parameters"]
PAIRED = {"wrench_pairing": "stamp"}
ROTORS = {"rotor_inertia": list(load_robot("ur5").rotor_inertia)}
ADMITTANCE = {
    "impedance_control": {**PAIRED, **ROTORS, "command_type": "none"},
    "clik": {"reference_pairing": "stamp", **WIDE},
}


@pytest.mark.parametrize(
    ("controller", "control", "answers", "own"),
    [
        ("clik", "position", ["joint_reference"], {"clik": {}}),
        ("dynamic_control", "torque", ["joint_effort"], {"dynamic_control": ROTORS}),
        ("impedance_control", "torque", ["compliant_frame", "joint_effort"],
         {"impedance_control": PAIRED | ROTORS}),
        ("admittance", "position", ["compliant_frame", "joint_reference"], ADMITTANCE),
    ],
)  # fmt: skip
def test_a_controller_says_its_nodes_and_what_they_need_in_lock_step(
    tmp_path, controller, control, answers, own
):
    _, parameters = started(tmp_path, controller=controller, nodes={"reference": T1})
    found = CONTROLLERS[controller]
    assert list(found.answers) == answers
    frames = {"base_frame": "base_link", "tip_frame": "tool0"}
    for node, values in own.items():
        assert parameters.pop(node) == frames | ONE_NODE | values
    assert parameters.keys() == {"reference", "pybullet_bridge"}
    assert parameters["pybullet_bridge"]["control"] == control
    # of joint_states: the controller's nodes, reference and the recorder
    assert parameters["pybullet_bridge"]["wait_for_subscribers"] == len(own) + 2
    assert parameters["reference"]["wait_for_subscribers"] == 2
    # two nodes are one behind the other: the second follows the compliant frame
    behind = {"reference": "compliant_frame"} if len(own) == 2 else {}
    assert found.nodes[-1].remaps == behind


def test_the_summary_takes_the_options_of_the_criterion_on_its_metric(tmp_path):
    above = {"above": 0}
    criteria: list[dict[str, Any]] = [
        {"metric": "growth_rate", "variants": ["angles"], "options": {"low": 3, "high": 4}} | above,
        {"metric": "growth_rate", "options": {"low": 1, "high": 2}} | above,
        {"metric": "servo_lag", "ratio": PAIR} | above,
        {"metric": "peak_effort", "spread": ["second"] * 2, "options": {"after": 3}} | above,
        {"metric": "peak_force", "difference": PAIR, "options": {"after": 4}} | above,
    ]
    content = changed(summary="{growth_rate.first}", criteria=criteria)
    found = load_experiment(str(write(tmp_path, content)))
    for metric, variant, options in (
        ("growth_rate", "angles", {"low": 3, "high": 4}),
        ("growth_rate", "second", {"low": 1, "high": 2}),
        ("peak_effort", "second", {"after": 3}),
        ("peak_effort", "angles", {}),
        ("peak_force", "second", {"after": 4}),
        ("peak_force", "angles", {}),
        ("peak_joint_speed", "first", {}),
    ):
        assert found.options(metric, variant) == options


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (changed(variant={}), "unknown key 'variant' (did you mean 'variants'?); known: chart"),
        (changed(claim=None), "the key 'claim' is missing"),
        (changed(variants={}), "variants must name at least one"),
        (changed(variants={"a/b": {}}), "variant 'a/b': use letters, digits, _"),
        (changed(variants={"logs": {}}), "variant 'logs': this is the name of the folder of the"),
        (changed(duration=0), "duration must be > 0"),
        (changed(controller="klik"), "unknown controller 'klik' (did you mean 'clik'?)"),
        (changed(nodes={"klik": {}}), "unknown node in nodes 'klik' (did you mean 'clik'?)"),
        (changed(variants={"a": {"bridge": {}}}), "unknown node or key in variant a 'bridge'"),
        (changed(variants={"a": {"dynamic_control": {}}}), "but its controller is clik"),
        (changed(picture="momet"), "unknown picture 'momet' (did you mean 'moment'?); known: "),
        (changed(start_turn=[0.0, 0.0, float("nan")]), "start_turn: expected [x, y, z] in rad"),
        (changed(start_turn=[0, 0, 1.0], start_at_reference=None), "needs start_at_reference"),
        (changed(summary="{growth_rate.first}"), "options of the metric 'growth_rate': missing"),
        (criterion(spread=PAIR, ratio=PAIR), "expected one of 'variants', 'ratio', 'difference'"),
        (changed(library="e99"), "unknown library experiment 'e99'; known: closed_path_law, e1"),
        (changed(criteria=[{"number": "slope", "above": 0}]), "'slope' needs the key 'library'"),
        (predicted(), "expected one of 'value', 'points' and 'form'"),
        (predicted(form="error_41", options={"error": 1.0}), "options of the form 'error_41'"),
        (predicted(vale=1.0), "unknown key of a prediction 'vale' (did you mean 'value'?)"),
        (charted(measured={"a": {"third": 1.0}}), "unknown variant in the chart 'third'"),
        (charted(log="z"), "chart: log: expected x, y or xy"),
        (changed(criteria=[{"below": 1}]), "a criterion needs a metric"),
        (criterion(metric="peak_speed"), "(did you mean 'peak_tip_speed'?); known: "),
        (changed(halt=DURATION), "halt: expected a time before the end"),
        (changed(halt=0.0, real_time=True), "halt needs a run in lock-step"),
        (changed(reports=1), "reports: expected true or false"),
        (criterion(under=1), "unknown key of a criterion 'under'; known: above, below"),
        (criterion(variants=["third"]), "unknown variant in a criterion 'third'"),
        (criterion(below=None), "expected 'above' or 'below', a number"),
        (criterion(options={"frm": 1}), "options of the metric 'peak_joint_speed'"),
        ("[1, 2", "expected ',' or ']'"),
    ],
)
def test_a_file_that_means_nothing_is_refused_with_its_name_and_reason(tmp_path, content, words):
    path = write(tmp_path, content)
    with pytest.raises(ConfigurationError, match=f"^{path}: .*{re.escape(words)}"):
        load_experiment(str(path))


@pytest.mark.parametrize("name", ["..", ".", "a b", "a.b", "_"])
def test_the_name_of_a_file_has_to_be_one_that_its_folder_can_have(tmp_path, name):
    path = write(tmp_path, GOOD, name)
    with pytest.raises(ConfigurationError) as refusal:
        load_experiment(str(path))
    assert str(refusal.value) == f"{path}: experiment '{name}': use letters, digits, _"


def test_an_experiment_that_does_not_exist_is_refused_with_those_that_do(tmp_path):
    with pytest.raises(UnknownNameError) as refusal:
        load_experiment("demmo")
    said = str(refusal.value)
    assert said.startswith("unknown experiment 'demmo' (did you mean 'demo'?); known: ")
    assert set(config_names("experiments")) == set(said.rsplit("known: ")[1].split(", "))
    with pytest.raises(ConfigurationError, match=r"nowhere\.yaml.*No such file"):
        load_experiment(str(tmp_path / "nowhere.yaml"))


@pytest.mark.parametrize("name", config_names("experiments"))
def test_every_experiment_that_comes_with_the_package_is_possible(name):
    experiment = load_experiment(name)
    assert experiment.claim
    assert experiment.criteria
    assert experiment.variants or experiment.library
    assert len(placeholders(experiment.summary)) == experiment.summary.count("{")
    assert all(equation(number).number == number for number in experiment.equations)
    for variant in experiment.variants.values():
        mode = "realtime" if name == "soak" or name.startswith("faults_") else "lockstep"
        assert node_parameters(variant)["pybullet_bridge"]["mode"] == mode


def test_a_variant_that_does_not_exist_is_refused_with_those_that_do(tmp_path, capsys):
    path = str(write(tmp_path, GOOD))
    experiment = load_experiment(path)
    assert check_names([], experiment) == ["first", "second", "angles"]
    assert check_names(["second", "first", "second"], experiment) == ["second", "first"]
    assert main([path, "--variant", "third", "--out", str(tmp_path / "out")]) == 2
    said = "error: short has no variant 'third'; it has first, second, angles\n"
    assert capsys.readouterr().out == said


def test_a_start_is_at_the_first_way_point_or_turned_there_in_the_tool_frame(tmp_path):
    turn = np.array([0.4, -0.9, 0.3])
    robot = Robot(load_robot("ur5").urdf, "base_link", "tool0")
    straight, turned = (
        robot.state(q, 0 * q)
        for q in (started(tmp_path)[0], started(tmp_path, start_turn=turn.tolist())[0])
    )
    np.testing.assert_allclose(straight.p_e, T1["positions"][:3], atol=REST)
    np.testing.assert_allclose(turned.p_e, straight.p_e, atol=REST)
    np.testing.assert_allclose(turned.R_e, straight.R_e @ exp(turn), atol=REST)


@pytest.mark.parametrize("controller", ["dynamic_control", "impedance_control", "admittance"])
def test_no_node_takes_a_turned_start_for_a_fault(tmp_path, controller):
    nodes: dict[str, Any] = {"reference": T1}
    turn = [0.0, 0.0, 3.0]
    _, turned = started(tmp_path, start_turn=turn, controller=controller, nodes=nodes)
    _, straight = started(tmp_path, controller=controller, nodes=nodes)
    for node in CONTROLLERS[controller].executables:
        assert turned[node]["max_jump_rotation"] == math.pi
        assert turned[node]["max_error_rotation"] == math.pi
        assert not straight[node].keys() & {"max_jump_rotation", "max_error_rotation"}
        nodes[node] = {"max_jump_rotation": 3.1}
    _, told = started(tmp_path, start_turn=turn, controller=controller, nodes=nodes)
    assert told[controller if controller in told else "clik"]["max_jump_rotation"] == 3.1


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (changed(robot="ur6"), "unknown robot 'ur6' (did you mean 'ur5'?)"),
        (changed(nodes={"reference": {"motion": "circle"}}), "start_at_reference"),
        (changed(nodes={"reference": T1 | {"positions": [9.0] * 6}}), "no joint positions found"),
        (changed(nodes={"reference": T1 | {"times": [0.0]}}), "way-points: 1 times, 6 numbers"),
    ],
)
def test_a_start_that_is_not_possible_is_refused_before_a_node_starts(tmp_path, content, words):
    experiment = load_experiment(str(write(tmp_path, content)))
    with pytest.raises(EulerParamsError) as refusal:
        run_variant(experiment, "first", tmp_path / "out", lambda _: None)
    assert words in str(refusal.value)
    assert not (tmp_path / "out").exists()


def recordings(folder: Path, **speeds: float) -> dict[str, Recording]:
    """Return runs whose largest joint speeds are these."""
    return {
        name: load(write_run(folder / name, [0.1, 0.2], speeds=[speed, 0.0]))
        for name, speed in speeds.items()
    }


@pytest.mark.parametrize(
    ("comparison", "variants", "speeds", "expected", "unit"),
    [
        ("spread", ["first", "second", "angles"], (1.0, 2.0, 3.0), 1.0, ""),  # over their mean
        ("spread", PAIR, (1.0, 1.5, 9.0), 0.4, ""),
        ("spread", PAIR, (2.0, 2.0, 9.0), 0.0, ""),
        ("difference", PAIR, (1.0, 1.5, 9.0), 0.5, "rad/s"),  # without a sign
        ("difference", PAIR, (1.5, 1.0, 9.0), 0.5, "rad/s"),
        ("ratio", PAIR, (1.0, 0.0, 9.0), math.inf, ""),
    ],
)
def test_runs_are_compared_if_all_are_there(tmp_path, comparison, variants, speeds, expected, unit):
    content = criterion(**{comparison: variants}, below=0.6)
    experiment = load_experiment(str(write(tmp_path, content)))
    runs = recordings(tmp_path, **dict(zip(experiment.variants, speeds, strict=True)))
    (verdict,) = judge(experiment, runs)
    assert verdict.measured == pytest.approx(expected)
    sign = {"spread": ", ", "difference": " - ", "ratio": " / "}[comparison]
    assert (verdict.variant, verdict.unit) == (sign.join(variants), unit)
    assert verdict.met == (expected < 0.6)
    del runs[variants[0]]
    assert judge(experiment, runs) == []


def test_a_number_has_to_be_between_its_bounds(tmp_path):
    experiment = load_experiment(str(write(tmp_path, criterion(above=1.0, below=3.0))))
    runs = recordings(tmp_path, first=0.5, second=2.0, angles=4.0)
    assert [verdict.met for verdict in judge(experiment, runs)] == [False, True, False]


def test_a_run_that_diverged_counts_with_what_its_bag_holds(tmp_path):
    content = criterion(ratio=PAIR, above=5, below=None)
    content["criteria"] += [{"metric": "peak_effort", "variants": ["first"], "below": 9}]
    experiment = load_experiment(str(write(tmp_path, content)))
    runs = recordings(tmp_path, first=8.0, second=1.0)
    runs["first"] = replace(runs["first"], diverged=0.01)
    first, effort = judge(experiment, runs)
    assert (first.measured, first.met) == (8.0, True)
    assert (effort.measured, effort.met) == (math.inf, False)
    summary = tmp_path / "summary.json"
    write_summary(summary, experiment, runs, [first, effort])
    written = json.loads(summary.read_text())
    assert written["diverged"] == {"first": 0.01}
    assert [c["measured"] for c in written["criteria"]] == [8.0, "inf"]


@pytest.mark.parametrize(
    ("bridge", "controller", "expected"),
    [
        (ExitCode.DIVERGED, Event.READY, True),
        (ExitCode.STALLED, Event.FAULT, True),
        (ExitCode.STALLED, Event.READY, False),
        (ExitCode.ERROR, Event.FAULT, False),
    ],
)
def test_a_run_has_diverged_if_robot_or_controller_says_so(tmp_path, bridge, controller, expected):
    (tmp_path / "impedance_control.events").write_text('{"event": "ready"}')
    (tmp_path / "clik.events").write_text(f'{{"event": "{controller}"}}')
    nodes = Nodes(tmp_path)
    code = f"raise SystemExit({bridge})"
    nodes.processes["pybullet_bridge"] = subprocess.Popen([sys.executable, "-c", code])
    nodes.processes["pybullet_bridge"].wait()
    assert has_diverged(nodes, "clik") is expected
    assert has_diverged(nodes, "admittance") is expected


# --- whole runs ------------------------------------------------------------------------------
def run(folder: Path, *arguments: str) -> Process:
    """Start the executable ``experiment``; SIGINT reaches it however the tests were started."""
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from eulerparams_control.lab.experiments.main import main; sys.exit(main())"
    )
    env = environment(folder, 0)
    command = [sys.executable, "-c", code, *arguments, "--out", str(folder / "out")]
    return Process(command, folder, "experiment", env)


def nodes_of(folder: Path, where: str = "cmdline") -> list[str]:
    """Return the command lines, or the ``environ``, of the processes that name a folder."""
    found = []
    for path in Path("/proc").glob(f"[0-9]*/{where}"):
        try:
            words = path.read_text(errors="replace").replace("\0", " ")
        except OSError:
            continue  # it has ended meanwhile
        if str(folder) in words:
            found.append(words)
    return found


def first_messages(bag: Path, topic: str, kind: type[Any]) -> dict[int, str]:
    """Return what the messages of a topic say, by stamp, the first of each.

    The first state is repeated until it is answered; the last command is followed by one
    to hold still.
    """
    found: dict[int, str] = {}
    for raw in Bag(bag).read_raw([topic]):
        msg = deserialize_message(raw.data, kind)  # what pads its fields may be anything
        found.setdefault(ns_from_ros(msg.header.stamp), repr(msg))
    return found


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Process]:
    """The folder of the good experiment after two runs, and its process."""
    folder = tmp_path_factory.mktemp("experiment")
    process = run(folder, str(write(folder, changed(variants={"first": {}, "second": {}}))))
    assert process.end() == 0, process.log
    return folder / "out/short", process


@pytest.mark.parametrize(
    ("topic", "kind"),
    [("/joint_reference", JointState), ("/joint_states", JointState), ("/wrench", WrenchStamped)],
)
def test_two_runs_are_the_same_to_the_bit(finished, topic, kind):
    folder, _ = finished
    first, second = (
        first_messages(folder / variant, topic, kind) for variant in ("first", "second")
    )
    assert sorted(first) == list(range(0, STEPS * 1_000_000, 1_000_000))
    assert first == second


def test_a_run_leaves_its_numbers_a_page_and_no_process(finished):
    folder, process = finished
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["met"] is True
    assert [c["variant"] for c in summary["criteria"]] == ["first", "second"]
    first, second = (c["measured"] for c in summary["criteria"])
    assert 0.0 < first < 1.0
    assert first == second
    assert (folder / "report.html").stat().st_size > 0
    assert "a short run" in process.stdout
    assert nodes_of(folder.parent.parent) == []


# A damping of 1e4 1/s is beyond what 1 kHz can do: the loop is unstable.
DIVERGING: dict[str, Any] = {
    "controller": "dynamic_control",
    "duration": DURATION,
    "may_diverge": True,
    "ideal_joints": True,  # rotors would damp it
    "dynamic_control": {"k_Vp": 1e4, "k_Vo": 1e4, "enforce_limits": False},
    "pybullet_bridge": NOISE | {"enforce_limits": False},
    "reference": T1,
}


@pytest.mark.slow
def test_a_run_that_may_diverge_ends_early_and_is_judged(tmp_path):
    calm = {"controller": "dynamic_control", "start_turn": [0.0, 0.0, 0.5], "duration": 0.2}
    content = changed(
        nodes={"reference": T1},
        variants={"calm": calm, "wild": DIVERGING},
        criteria=[{"metric": "peak_effort", "ratio": ["wild", "calm"], "above": 100}],
    )
    process = run(tmp_path, str(write(tmp_path, content)))
    assert process.end() == 0, process.log
    summary = json.loads((tmp_path / "out/short/summary.json").read_text())
    assert list(summary["diverged"]) == ["wild"]
    assert 0 < summary["diverged"]["wild"] < DURATION / 2
    assert summary["met"] is True
    assert "wild diverged at 0." in process.stdout
    assert "wild diverged at 0." in (tmp_path / "out/short/report.html").read_text()
    assert load(tmp_path / "out/short/calm").command is None


def test_experiments_that_cannot_run_or_diverge_without_leave_do_not_stop_the_others(tmp_path):
    refused = changed(variants={"only": {"clik": {"k_Po": -5.0}}})
    wild = changed(nodes={}, variants={"wild": DIVERGING | {"may_diverge": False}})
    files = [str(write(tmp_path, refused)), str(write(tmp_path, wild, "wild"))]
    process = run(tmp_path, *files, "e2", "--paper")
    assert process.end() == 2, process.log
    assert "Traceback" not in process.log
    assert "parameter 'k_Po' is -5 1/s; expected between" in process.stdout
    assert "not finite after step" in process.stdout
    assert "1 of 1 claims of the paper met." in process.stdout
    page = (tmp_path / "out/index.html").read_text()
    assert "the node clik died with exit code 1" in page
    assert "the node pybullet_bridge died with exit code 4" in page
    assert json.loads((tmp_path / "out/e2/summary.json").read_text())["met"]
    assert nodes_of(tmp_path) == []


@pytest.mark.slow
def test_a_run_is_halted_at_its_time_which_its_bag_tells(tmp_path):
    bounds = [{"metric": "stop_time", "above": 0.1, "below": 0.3}]
    content = changed(halt=0.1, reports=True, variants={"only": {}}, criteria=bounds)
    process = run(tmp_path, str(write(tmp_path, content)))
    assert process.end() == 0, process.log
    assert json.loads((tmp_path / "out/short/summary.json").read_text())["met"] is True


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "variant"),
    [
        ("stops", "iiwa_500"),
        ("stops_contact", "ur5_150n_500"),
        ("stops_wall", "ur5_500"),
        ("stops_load", "panda_500"),
    ],
)
def test_a_stop_under_efforts_keeps_to_its_bounds(tmp_path, name, variant):
    process = run(tmp_path, name, "--variant", variant)
    assert process.end() == 0, process.log
    assert json.loads((tmp_path / f"out/{name}/summary.json").read_text())["met"] is True


# The tip goes 10 mm away from a spring that holds it back.
PULLED: dict[str, Any] = {
    "reference": T1 | {"orientations": T1["orientations"][:3] * 2},
    "pybullet_bridge": {
        "seed": 1,
        "noise_force": 0.1,
        "environment": {
            "spring": {"shape": "spring", "position": T1["positions"][:3], "stiffness": 1e3}
        },
    },
}


@pytest.mark.slow
def test_a_run_with_an_impedance_is_in_its_bag_and_on_its_page(tmp_path):
    controllers = {"first": "impedance_control", "admittance": "admittance"}
    content = changed(
        nodes=PULLED,
        picture="force",
        variants={name: {"controller": controller} for name, controller in controllers.items()},
        criteria=[
            {"metric": "peak_force", "difference": ["first", "admittance"], "below": 1.0},
            {"metric": "peak_position_error", "below": 0.5, "options": {"against": "compliant"}},
        ],
    )
    process = run(tmp_path, str(write(tmp_path, content)))
    assert process.end() == 0, process.log
    for name in controllers:
        found = load(tmp_path / "out/short" / name)
        assert found.compliant is not None
        assert found.wrench is not None
        assert len(found.compliant.t) == len(found.wrench.t) == STEPS
        assert found.wrench.f[-1, 2] < -1.0  # N: it is held back
        assert found.compliant.p_cd_d[-1] @ found.compliant.p_cd_d[-1] > 1e-3**2
        assert found.lyapunov is not None
        assert found.parameters["/impedance_control"]["wrench_pairing"] == "stamp"
        environment = found.parameters["/pybullet_bridge"]["environment"]
        assert environment["spring"]["shape"] == "spring"
        assert (found.command is None) == (found.effort is not None) == (name == "first")
        assert ("/clik" in found.parameters) == (name == "admittance")
    page = (tmp_path / "out/short/report.html").read_text()
    assert page.index("<h3>Contact force</h3>") < page.index("<h3>Orientation error</h3>")


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_experiment_and_all_its_nodes(tmp_path, number):
    content = changed(duration=10_000.0, variants={"only": {}})
    with Graph(tmp_path / "graph") as graph:  # only to wait, and to end the process in any case
        process = run(tmp_path, str(write(tmp_path, content)))
        graph.processes.append(process)
        log = tmp_path / "out/short/logs/only/bag_recorder.log"
        graph.until(lambda: log.exists() and "recording " in log.read_text(), "a recording")
        process.signal(number)
        assert process.end() == 130
    assert "stopped; the nodes were ended" in process.stdout
    assert nodes_of(tmp_path) == []
    assert os.path.exists(tmp_path / "out/short/only/metadata.yaml")  # the bag is whole


# --- bags of which messages are missing ------------------------------------------------------
RATE, COUNT = 100.0, 30
END = (COUNT - 1) / RATE


def checked(
    folder: Path, topic: str = "", lost: int = 0, diverged: bool = False, end: float = END
) -> float:
    """Check a run, planned until ``end`` [s], whose last messages of a topic are lost."""
    q = [0.0] * COUNT
    whole = write_run(folder / "whole", q, q, wrenches=[[0.0] * 6] * COUNT)
    left = COUNT - lost
    run = rewritten(
        whole, folder / "run", lambda m, k: None if m.topic == topic and k >= left else m
    )
    settings: Any = SimpleNamespace(controller="clik", duration=end)
    return _check_complete(run, settings, RATE, diverged)


def test_a_whole_run_counts_up_to_its_end(tmp_path):
    assert checked(tmp_path) == END


@pytest.mark.parametrize("topic", ["/joint_states", "/wrench", "/joint_reference"])
@pytest.mark.parametrize("lost", [1, 20])
def test_a_run_of_which_messages_are_lost_is_incomplete(tmp_path, topic, lost):
    with pytest.raises(IncompleteBagError, match=f"{topic} has {COUNT - lost} stamps; expected"):
        checked(tmp_path, topic, lost)


def test_a_run_with_more_messages_than_it_can_have_is_not_incomplete_but_wrong(tmp_path):
    with pytest.raises(BagError, match="has 30 stamps; expected 29") as error:
        checked(tmp_path, end=END - 1 / RATE)
    assert error.type is BagError


def test_a_run_that_diverged_may_lack_the_last_answer_only(tmp_path, monkeypatch):
    monkeypatch.setattr(synthetic_runs, "_START", 0)  # as in simulated time
    assert checked(tmp_path / "1", "/joint_reference", 1, diverged=True) == END
    with pytest.raises(IncompleteBagError, match="/wrench has 29 stamps; expected 30"):
        checked(tmp_path / "2", "/wrench", 1, diverged=True)
