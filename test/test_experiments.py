"""Experiments: what their files may say, and whole runs with real nodes and bags."""

import copy
import json
import os
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from ros_processes import Graph, Process, environment
from tolerances import REST

from eulerparams_control.catalogue import load_robot
from eulerparams_control.errors import (
    BagError,
    ConfigurationError,
    EulerParamsError,
    UnknownNameError,
)
from eulerparams_control.experiments.criteria import judge
from eulerparams_control.experiments.definition import Criterion, load_experiment
from eulerparams_control.experiments.runner import check_names, node_parameters, run_variant
from eulerparams_control.messages import ns_from_ros
from eulerparams_control.resources import config_names
from eulerparams_control.robot import Robot

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
    """Return the good experiment with this criterion."""
    return changed(criteria=[{"metric": "peak_joint_speed", "below": 1.0} | changes])


# --- what a file may say ---------------------------------------------------------------------


def test_an_experiment_is_what_its_file_says(tmp_path: Path) -> None:
    found = load_experiment(str(write(tmp_path, GOOD)))
    assert (found.name, found.claim, found.equations) == ("short", "a short run", ("(28)",))
    assert (found.robot, found.duration, found.controller) == ("ur5", 0.4, "clik")
    assert found.start_at_reference
    assert list(found.variants) == ["first", "second", "angles"]
    common = {"k_Pp": 10.0, "k_Po": 20.0, "feedback": "measured"}
    assert found.variants["first"]["clik"] == common
    assert found.variants["angles"]["clik"] == {**common, "orientation": "euler_angles"}
    expected = Criterion("peak_orientation_error", below=1.0, predicted="0.1")
    assert found.criteria == (expected,)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (changed(variant={}), "unknown key 'variant' (did you mean 'variants'?); known: claim"),
        (changed(claim=None), "the key 'claim' is missing"),
        (changed(duration=None), "the key 'duration' is missing"),
        (changed(variants=None), "the key 'variants' is missing"),
        (changed(variants={}), "variants must name at least one"),
        (changed(variants=["first"]), "variants must name at least one"),
        (changed(variants={"a/b": {}}), "variant 'a/b': use letters, digits, _"),
        (changed(duration=0), "duration must be > 0"),
        (changed(duration=-1.0), "duration must be > 0"),
        (changed(duration="long"), "duration must be > 0"),
        (changed(duration=True), "duration must be > 0"),
        (changed(duration=float("inf")), "duration must be > 0"),
        (changed(controller="klik"), "unknown controller 'klik' (did you mean 'clik'?)"),
        (changed(nodes={"klik": {}}), "unknown node in nodes 'klik' (did you mean 'clik'?)"),
        (changed(nodes={"clik": 3}), "nodes: clik: expected names and values"),
        (changed(nodes=["clik"]), "nodes: expected parameters by node"),
        (
            changed(variants={"a": {"bridge": {}}}),
            "unknown node in variant a 'bridge'; known: clik, pybullet_bridge, reference",
        ),
        (changed(equations="(28)"), "equations: expected a list"),
        (changed(criteria={"metric": "x"}), "criteria: expected a list"),
        (changed(criteria=[{"below": 1}]), "a criterion needs a metric"),
        (criterion(metric="peak_speed"), "(did you mean 'peak_joint_speed'?); known: "),
        (criterion(metric=["peak_joint_speed"]), "unknown metric"),
        (criterion(under=1), "unknown key of a criterion 'under'; known: above, below"),
        (criterion(variants=["third"]), "unknown variant in a criterion 'third'"),
        (criterion(variants="first"), "variants: expected a list"),
        (criterion(ratio=["first", "third"]), "unknown variant in a criterion 'third'"),
        (criterion(ratio=["first"]), "ratio: expected two variants"),
        (criterion(below=None), "expected 'above' or 'below', a number"),
        (criterion(below="small"), "expected 'above' or 'below', a number"),
        (criterion(options={"frm": 1}), "options of the metric 'peak_joint_speed'"),
        (criterion(metric="period_growth"), "options of the metric 'period_growth'"),
        ("[1, 2", "expected ',' or ']'"),
        ("just words", "expected the keys claim, controller, criteria"),
        ("", "expected the keys claim, controller, criteria"),
    ],
)
def test_a_file_that_means_nothing_is_refused_with_its_name_and_the_reason(
    tmp_path: Path, content: Any, words: str
) -> None:
    path = write(tmp_path, content)
    with pytest.raises(ConfigurationError) as refusal:
        load_experiment(str(path))
    assert str(refusal.value).startswith(f"{path}: ")
    assert words in str(refusal.value)


def test_an_experiment_that_does_not_exist_is_refused_with_those_that_do(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError) as refusal:
        load_experiment("demmo")
    assert "unknown experiment 'demmo' (did you mean 'demo'?); known: demo, " in str(refusal.value)
    with pytest.raises(ConfigurationError, match=r"nowhere\.yaml.*No such file"):
        load_experiment(str(tmp_path / "nowhere.yaml"))


@pytest.mark.parametrize("name", config_names("experiments"))
def test_every_experiment_that_comes_with_the_package_is_possible(name: str) -> None:
    experiment = load_experiment(name)
    assert experiment.claim
    assert experiment.criteria
    for variant in experiment.variants:
        assert node_parameters(experiment, variant)["pybullet_bridge"]["mode"] == "lockstep"


def test_a_variant_that_does_not_exist_is_refused_with_those_that_do(tmp_path: Path) -> None:
    experiment = load_experiment(str(write(tmp_path, GOOD)))
    assert check_names([], experiment) == ["first", "second", "angles"]
    assert check_names(["second"], experiment) == ["second"]
    with pytest.raises(ConfigurationError, match="'third'; it has first, second, angles"):
        check_names(["third"], experiment)


def test_a_run_begins_at_the_first_way_point_with_the_frames_of_its_robot(tmp_path: Path) -> None:
    experiment = load_experiment(str(write(tmp_path, GOOD)))
    parameters = node_parameters(experiment, "first")
    q_0 = np.array(parameters["pybullet_bridge"]["initial_positions"])
    ur5 = load_robot("ur5")
    state = Robot(ur5.urdf, "base_link", "tool0").state(q_0, 0 * q_0)
    np.testing.assert_allclose(state.p_e, T1["positions"][:3], atol=REST)
    assert parameters["clik"]["base_frame"] == "base_link"
    assert parameters["clik"]["require_reference"] is True
    assert parameters["reference"]["wait_for_subscribers"] == 2


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (changed(robot="ur6"), "unknown robot 'ur6' (did you mean 'ur5'?)"),
        (changed(nodes={"reference": {"motion": "circle"}}), "start_at_reference"),
        (
            changed(nodes={"reference": T1 | {"positions": [9.0] * 6}}),
            "no joint positions found for the tip at [9.0, 9.0, 9.0] m",
        ),
        (changed(nodes={"reference": T1 | {"times": [0.0]}}), "way-points: 1 times, 6 numbers"),
    ],
)
def test_a_start_that_is_not_possible_is_refused_before_a_node_starts(
    tmp_path: Path, content: Any, words: str
) -> None:
    experiment = load_experiment(str(write(tmp_path, content)))
    with pytest.raises(EulerParamsError) as refusal:
        run_variant(experiment, "first", tmp_path / "out", lambda _: None)
    assert words in str(refusal.value)
    assert not (tmp_path / "out").exists()


def test_a_bag_that_exists_is_not_written_over(tmp_path: Path) -> None:
    experiment = load_experiment(str(write(tmp_path, GOOD)))
    (tmp_path / "out/first").mkdir(parents=True)
    with pytest.raises(BagError, match="first exists; remove it, or choose another --out"):
        run_variant(experiment, "first", tmp_path / "out", lambda _: None)
    assert list((tmp_path / "out").rglob("*")) == [tmp_path / "out/first"]


def test_a_criterion_of_variants_that_did_not_run_is_left_out(tmp_path: Path) -> None:
    content = criterion(ratio=["first", "angles"])
    experiment = load_experiment(str(write(tmp_path, content)))
    assert judge(experiment, {}) == []


# --- whole runs ------------------------------------------------------------------------------


def run(folder: Path, *arguments: str) -> Process:
    """Start the executable ``experiment``; SIGINT reaches it however the tests were started."""
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from eulerparams_control.experiments.main import main; sys.exit(main())"
    )
    env = environment(folder, 0)
    command = [sys.executable, "-c", code, *arguments, "--out", str(folder / "out")]
    return Process(command, folder, "experiment", env)


def nodes_of(folder: Path) -> list[str]:
    """Return the command lines of the processes that name a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_text().replace("\0", " ")
        except OSError:
            continue  # it has ended meanwhile
        if str(folder) in words:
            found.append(words)
    return found


def raw(bag: Path, topic: str) -> dict[int, bytes]:
    """Return the messages of a topic as they are in a bag, by stamp, the first of each.

    The first state is repeated until it is answered; the last command is followed by one
    to hold still.
    """
    found: dict[int, bytes] = {}
    with open(next(bag.glob("*.mcap")), "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, _, message, decoded in reader.iter_decoded_messages([topic]):
            found.setdefault(ns_from_ros(decoded.header.stamp), message.data)
    return found


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Process]:
    """The folder of the good experiment after its run, and its process."""
    folder = tmp_path_factory.mktemp("experiment")
    process = run(folder, str(write(folder, GOOD)))
    assert process.end() == 0, process.log
    return folder / "out/short", process


@pytest.mark.parametrize("topic", ["/joint_reference", "/joint_states", "/wrench"])
def test_two_runs_are_the_same_to_the_bit(finished: tuple[Path, Process], topic: str) -> None:
    folder, _ = finished
    first, second = raw(folder / "first", topic), raw(folder / "second", topic)
    assert sorted(first) == list(range(0, STEPS * 1_000_000, 1_000_000))
    assert first == second


def test_another_representation_gives_other_commands(finished: tuple[Path, Process]) -> None:
    folder, _ = finished
    first, angles = (raw(folder / name, "/joint_reference") for name in ("first", "angles"))
    assert first.keys() == angles.keys()
    assert first != angles


def test_a_run_leaves_its_numbers_a_page_and_no_process(finished: tuple[Path, Process]) -> None:
    folder, process = finished
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["met"] is True
    assert [c["variant"] for c in summary["criteria"]] == ["first", "second", "angles"]
    first, second, _ = (c["measured"] for c in summary["criteria"])
    assert 0.0 < first < 1.0
    assert first == second
    assert (folder / "report.html").stat().st_size > 0
    assert "a short run" in process.stdout
    assert nodes_of(folder.parent.parent) == []


def test_a_criterion_that_is_not_met_gives_exit_code_1(tmp_path: Path) -> None:
    process = run(tmp_path, str(write(tmp_path, criterion(below=1e-9))), "--variant", "first")
    assert process.end() == 1, process.log
    summary = json.loads((tmp_path / "out/short/summary.json").read_text())
    (only,) = summary["criteria"]
    assert (summary["met"], only["met"], only["variant"]) == (False, False, "first")
    assert only["measured"] > 1e-3  # rad/s: it moved


@pytest.mark.parametrize(
    ("nodes", "words"),
    [
        (
            {"clik": {"k_Po": -5.0}},
            ["the node clik died with exit code 1", "parameter 'k_Po' is -5 1/s; expected between"],
        ),
        (
            {"reference": {"cirle_tilt": 1.0}},
            ["the node reference died with exit code 1", "(did you mean 'circle_tilt'?)"],
        ),
        (
            {"pybullet_bridge": {"tool_mass": -1.0}},
            ["the node pybullet_bridge died with exit code 1", "parameter 'tool_mass' is -1 kg"],
        ),
    ],
)
def test_a_node_that_dies_ends_the_experiment_with_its_last_words_and_exit_code_2(
    tmp_path: Path, nodes: dict[str, Any], words: list[str]
) -> None:
    content = changed(variants={"only": nodes})
    process = run(tmp_path, str(write(tmp_path, content)))
    assert process.end() == 2, process.log
    for word in words:
        assert word in process.stdout
    assert "Traceback" not in process.log
    assert nodes_of(tmp_path) == []


def test_a_name_that_does_not_exist_gives_one_line_and_exit_code_2(tmp_path: Path) -> None:
    process = run(tmp_path, "demmo")
    assert process.end() == 2
    assert process.stdout.startswith("error: unknown experiment 'demmo' (did you mean 'demo'?)")
    assert process.stderr == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_experiment_and_all_its_nodes(
    tmp_path: Path, number: signal.Signals
) -> None:
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
