"""Experiments with faults: what their files may say, their numbers, and runs in real time."""

import json
import math
import re
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from synthetic_runs import PERIOD_NS, URDF, write_messages, write_run
from test_experiments import GOOD, changed, nodes_of, run, write

from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.quantities import measure
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.bags import Bag
from eulerparams_control.bags.reader import RawMessage
from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.experiments.faulty import remaps, turn
from eulerparams_control.lab.experiments.model import Variant
from eulerparams_control.lab.experiments.runner import making_of, node_parameters
from eulerparams_control.lab.faults import KINDS, Drop, Kill
from eulerparams_control.lab.run.fingerprint import code_of_runs
from eulerparams_control.lab.run.processes import RunStopped
from eulerparams_control.parameters.schemes import schemes

# Relative: a few operations on doubles.
EXACT = 1e-9

DROP = {"fault": "drop", "topic": "joint_states", "at": 0.1, "for": 0.2}
KILL = {"fault": "kill", "node": "clik", "at": 0.3, "restart_after": 0.1}


# --- what a file may say ----------------------------------------------------------------------
def test_faults_are_those_of_the_experiment_or_of_a_variant(tmp_path):
    own = {"a": {}, "b": {"faults": [KILL]}, "c": {"faults": [], "fault_seed": 4}}
    content = changed(duration=1.0, faults=[DROP], fault_seed=3, variants=own)
    found = load_experiment(str(write(tmp_path, content))).variants
    assert found["a"].faults == (Drop(topic="joint_states", at=0.1, duration=0.2),)
    assert found["b"].faults == (Kill(node="clik", at=0.3, restart_after=0.1),)
    assert found["c"].faults == ()
    assert [variant.fault_seed for variant in found.values()] == [3, 3, 4]


def faulty(*faults: dict[str, Any]) -> dict[str, Any]:
    return changed(duration=1.0, faults=list(faults))


def variant_of(folder: Path, *faults: dict[str, Any]) -> Variant:
    return load_experiment(str(write(folder, faulty(*faults)))).variants["first"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (changed(faults=DROP), "the experiment: faults: expected a list"),
        (faulty(DROP, DROP | {"fault": "dorp"}), "faults: entry 2: unknown fault 'dorp' (did y"),
        (faulty(DROP, DROP | {"topic": "wrench"}), "entry 2: unknown topic with clik 'wrench'"),
        (faulty(DROP | {"topic": "joint_effort"}), "'joint_effort' (did you mean 'joint_refere"),
        (faulty(DROP, DROP | {"at": 1.0}), "entry 2: it begins at 1 s, the run ends at 1 s"),
        (faulty(KILL | {"node": "klik"}), "unknown node that can be killed 'klik' (did"),
        (faulty(KILL | {"node": "bag_recorder"}), "known: clik, pybullet_bridge, reference"),
        (changed(faults=[DROP], controller="admittance"), "faults need one controller, not admit"),
        (changed(duration=1.0, faults=[DROP], may_diverge=True), "may_diverge does not go with"),
        (changed(fault_seed=-1), "fault_seed: expected a whole number from 0"),
    ],
)
def test_faults_that_cannot_be_are_refused_with_the_reason(tmp_path, content, words):
    with pytest.raises(ConfigurationError, match=re.escape(words)):
        load_experiment(str(write(tmp_path, content)))


@pytest.mark.parametrize("controller", schemes())
def test_all_that_goes_between_robot_and_controller_goes_through_the_injector(controller):
    *inwards, command = CONTROLLERS[controller].topics
    assert remaps(CONTROLLERS[controller]) == {
        controller: {topic: f"faulty/{topic}" for topic in inwards},
        "pybullet_bridge": {command: f"faulty/{command}"},
    }


def test_with_faults_nothing_waits_and_no_time_is_simulated(tmp_path):
    settings = replace(variant_of(tmp_path, DROP, KILL), fault_seed=5)
    found = node_parameters(settings)
    frames = {"base_frame": "base_link", "tip_frame": "tool0"}
    assert found["clik"] == frames | GOOD["nodes"]["clik"]
    bridge = found["pybullet_bridge"]
    assert (bridge["mode"], bridge["rate"], bridge["control"]) == ("realtime", 250.0, "position")
    assert bridge.keys() & {"duration", "wait_for_subscribers"} == set()
    assert found["reference"]["wait_for_subscribers"] == 2  # the injector and the recorder
    assert found["fault_injector"] == {
        "topics": ["joint_states", "reference", "joint_reference"],
        "start_on": "reference",
        "seed": 5,
        "faults": [str(Drop(topic="joint_states", at=0.1, duration=0.2))],
    }


def test_another_fault_makes_another_run_and_the_injector_is_part_of_its_code(tmp_path):
    drops = [DROP | change for change in ({"at": 0.1}, {"at": 0.2}, {"fault": "duplicate"})]
    kills = [KILL | {"restart_after": seconds} for seconds in (0.1, 0.2)]
    settings = [variant_of(tmp_path, fault) for fault in drops + kills]
    made = [making_of(each, node_parameters(each)) for each in settings]
    assert len({making.definition for making in made}) == 5
    assert {making.code for making in made} == {code_of_runs(True)}
    assert code_of_runs(True) != code_of_runs()
    assert "fault_injector" not in node_parameters(replace(settings[0], faults=()))


def test_the_experiments_that_come_with_the_package_show_every_kind_of_fault():
    for name in ("faults_clik", "faults_dynamic", "faults_impedance"):
        found = load_experiment(name).variants.values()
        assert {one.name for variant in found for one in variant.faults} == set(KINDS)
        assert all(variant.faults[-1].end < variant.duration for variant in found)


def test_runs_in_real_time_wait_for_each_other_unless_they_are_stopped():
    stop = threading.Event()
    stop.set()
    with turn(None), pytest.raises(RunStopped), turn(stop):
        raise AssertionError("two at a time")
    with turn(stop):  # it was given back
        pass


# --- numbers ----------------------------------------------------------------------------------
PARAMETERS = {"tip_frame": "tip", "max_effort_rate": 100.0}


def recording(folder: Path, measured: Any, *given: Any, **more: Any) -> Recording:
    return load(write_run(folder / "run", measured, *given, parameters=PARAMETERS, **more))


AT_LIMITS = {"command": [0.0, 4.0, -4.0], "speeds": [0.0, 3.0, -3.0]}
NOT_FINITE = {"efforts": [1.0, math.nan, 2.0, math.inf, 3.0]}


@pytest.mark.parametrize(
    ("metric", "run", "number"),
    [
        ("commands_beyond_limits", AT_LIMITS, 0),
        ("nonfinite_commands", AT_LIMITS, 0),
        ("commands_beyond_limits", {"command": [0.0, 4.001, 0.0]}, 1),
        ("commands_beyond_limits", {"command": [0.0, -4.001, 0.0]}, 1),
        ("commands_beyond_limits", {"command": [0.0] * 3, "speeds": [0.0, -3.001, 3.001]}, 2),
        ("command_jump_of_rate", {"command": [0.0, 0.015, 0.06]}, 1.5),  # 0.03 rad in 10 ms
        ("peak_measured_speed_of_limit", {"speeds": [0.0, -4.5, 1.0]}, 1.5),
        ("nonfinite_commands", NOT_FINITE, 2),
        ("commands_beyond_limits", NOT_FINITE, 1),  # infinity
        ("commands_beyond_limits", {"efforts": [10.0, -10.0, 10.001, -10.001]}, 2),
        ("command_jump_of_rate", {"efforts": [0.0, 0.5, 3.5, 3.0]}, 3.0),  # 1 Nm in 10 ms
    ],
)
def test_a_number_of_commands_is_what_it_is_by_hand(tmp_path, metric, run, number):
    (samples,) = {len(values) for values in run.values()}
    found = recording(tmp_path, [0.0] * samples, **run)
    assert measure(metric, found) == pytest.approx(number, rel=EXACT)


def of_messages(
    folder: Path, messages: list[JointState], stamps: list[int] | None = None, gap: int = 0
) -> Recording:
    """Return a recording of commands (every 10 ms, ``gap`` ns more before the last) and a rest."""
    start, raw = 1_700_000_000_000_000_000, []
    rest = JointState(name=["hinge", "roll"], position=[0.0, 0.0], velocity=[0.0, 0.0])
    for k, msg in enumerate(messages):
        sent = start + k * PERIOD_NS + (gap if k == len(messages) - 1 else 0)
        stamp = sent if stamps is None else start + stamps[k] * 1_000_000
        for topic, each in (("/joint_states", rest), ("/joint_effort", msg)):
            each.header.stamp.sec, each.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
            raw.append(RawMessage(topic, sent, sent, serialize_message(each)))
    topics = dict.fromkeys(("/joint_states", "/joint_effort"), "sensor_msgs/msg/JointState")
    told = yaml.safe_dump({"/d": {"ros__parameters": PARAMETERS}})
    return load(write_messages(folder / "made", topics, raw, told), urdf=URDF)


def efforts(*values: float) -> list[JointState]:
    return [JointState(name=["hinge", "roll"], effort=[value, 0.0]) for value in values]


def test_a_command_without_all_joints_counts_as_not_finite(tmp_path):
    whole = efforts(1.0, 1.0)
    found = of_messages(tmp_path, [whole[0], JointState(name=["hinge"], effort=[1.0]), whole[1]])
    assert measure("nonfinite_commands", found) == 1


@pytest.mark.parametrize(
    ("stamps", "gap", "ratio"),
    [
        (None, 0, 6.0),
        ([0, 10, 20, 30], 20_000_000, 2.0),  # as late as it was recorded
        ([0, 10, 20, 70], 0, 1.2),  # as late as it is stamped
        ([0, 10, 20, 5000], 0, 0.6),  # stamps that jump ahead excuse 0.1 s
        ([0, 10, 20, -5000], 0, 6.0),  # and back nothing
    ],
)
def test_a_jump_may_be_as_long_as_the_time_between_two_commands(tmp_path, stamps, gap, ratio):
    found = of_messages(tmp_path, efforts(0.0, 0.0, 0.0, 6.0), stamps, gap)
    assert measure("command_jump_of_rate", found) == pytest.approx(ratio, rel=EXACT)


def test_the_goal_is_the_end_of_the_last_reference(tmp_path):
    found = recording(tmp_path, [0.0, 0.9, math.pi / 6], [0.0] * 3)
    assert measure("distance_to_goal", found) == pytest.approx(
        2e3 * math.sin(math.pi / 12), rel=EXACT
    )
    assert measure("angle_to_goal", found) == pytest.approx(30.0, rel=EXACT)
    moved = recording(tmp_path / "moved", [0.0, 0.0], [0.0] * 2, lasting=0.01)
    assert measure("distance_to_goal", moved) == pytest.approx(10.0, rel=EXACT)


def test_numbers_of_what_was_not_recorded_are_refused(tmp_path):
    found = recording(tmp_path, [0.0] * 3, [0.0] * 3, desired=False)
    with pytest.raises(BagError, match="no valid reference was recorded"):
        measure("distance_to_goal", found)
    found = recording(tmp_path / "none", [0.0] * 3)
    with pytest.raises(BagError, match="no joint_reference and no joint_effort"):
        measure("nonfinite_commands", found)
    found = load(write_run(tmp_path / "told", [0.0] * 3, efforts=[0.0] * 3, parameters={}))
    with pytest.raises(BagError, match="no controller has told its max_effort_rate"):
        measure("command_jump_of_rate", found)


# --- runs -------------------------------------------------------------------------------------
GOAL = {
    "motion": "way_points",
    "times": [1.0],
    "positions": [0.485, 0.05, 0.395],
    "orientation_format": "ZYZ",
    "orientations": [0.0, 0.9, 1.5708],
}
WITH_KILLS: dict[str, Any] = {
    "claim": "killed and started again",
    "duration": 8.0,  # long: a busy machine simulates slowly, and the motion of 1 s has to end
    "controller": "clik",
    "nodes": {
        "reference": GOAL,
        "pybullet_bridge": {"rate": 100.0, "command_timeout": 2.0},
        # a busy machine is no fault here, however seldom its states come
        "clik": {"state_timeout": 2.0, "max_latency": 1.0, "k_Pp": 10.0, "k_Po": 10.0},
    },
    "variants": {"killed": {}},
    "faults": [
        {"fault": "corrupt", "topic": "joint_reference", "at": 0.0, "for": 0.1, "value": "nan"},
        {"fault": "kill", "node": "clik", "at": 0.2, "restart_after": 0.1},
        {"fault": "kill", "node": "pybullet_bridge", "at": 0.9, "restart_after": 0.1},
        {"fault": "kill", "node": "reference", "at": 1.3, "restart_after": 0.1},
    ],
    "criteria": [
        {"metric": "nonfinite_commands", "below": 0.5},
        {"metric": "command_jump_of_rate", "below": 1.01},
        {"metric": "distance_to_goal", "below": 5.0},
    ],
}


@pytest.mark.slow
def test_nodes_that_are_killed_are_started_again_and_the_run_is_judged_and_known(tmp_path):
    process = run(tmp_path, str(write(tmp_path, WITH_KILLS)))
    assert process.end() == 0, process.log
    assert nodes_of(tmp_path) == []
    folder = tmp_path / "out/short"
    names = ("clik", "pybullet_bridge", "reference", "fault_injector")
    log = {name: (folder / f"logs/killed/{name}.log").read_text() for name in names}
    assert log["clik"].count("active with euler_parameters: holding the measured") >= 2
    assert log["pybullet_bridge"].count("ur5 in realtime") == 2
    assert log["reference"].count("sent a motion of 1 s") == 2
    fault = "{fault: corrupt, topic: joint_reference"
    for words in (f"begins: {fault}", f"ends: {fault}", "at work: corrupt on joint_reference"):
        assert log["fault_injector"].count(words) == 1
    bag = Bag(folder / "killed")
    assert bag.topics["/reference"].count == 2
    for topic, is_right in (("/joint_reference", True), ("/faulty/joint_reference", False)):
        found = [message.message for message in bag.messages([topic])]
        assert all(np.isfinite([*msg.position, *msg.velocity]).all() for msg in found) == is_right
    statuses = (s for found in bag.messages(["/diagnostics"]) for s in found.message.status)
    told = {status.message for status in statuses if status.name == "fault_injector"}
    assert "no fault at work, 0 to come" in told
    summary = json.loads((folder / "summary.json").read_text())
    assert [criterion["met"] for criterion in summary["criteria"]] == [True] * 3
    again = run(tmp_path, str(write(tmp_path, WITH_KILLS)))
    assert again.end() == 0, again.log
    assert "short killed: was run before" in again.stdout


@pytest.mark.slow
def test_a_node_that_ends_on_the_way_ends_a_run_with_faults(tmp_path):
    nodes = {"reference": GOAL, "pybullet_bridge": {"rate": 100.0, "duration": 8.0}}
    content = WITH_KILLS | {"nodes": nodes, "duration": 60.0, "faults": [DROP]}
    process = run(tmp_path, str(write(tmp_path, content)))
    assert process.end() == 2
    assert "the node pybullet_bridge died with exit code 0" in process.log
    assert nodes_of(tmp_path) == []
