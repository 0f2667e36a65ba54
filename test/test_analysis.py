"""Recordings, their numbers, the sentence and the executable ``analyze``, on bags made by hand."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from synthetic_runs import URDF, write_run

from eulerparams_control.analysis.decimation import decimate
from eulerparams_control.analysis.labels import labels
from eulerparams_control.analysis.main import main
from eulerparams_control.analysis.metrics import METRICS, get_metric
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.scale import axis
from eulerparams_control.analysis.sentence import describe, fill, placeholders
from eulerparams_control.analysis.text import number, quantity
from eulerparams_control.bags import Bag, BagWriter
from eulerparams_control.bags.format import Topic
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.experiments.definition import load_experiment
from eulerparams_control.resources import config_names

EXACT = 1e-9  # relative: a few operations on doubles
MEASURED = [0.0, 0.3, -0.5, 0.2]
COMMAND = [0.0, 0.1, -0.4, 0.1]
SPEEDS = [0.0, -2.0, 1.0, 0.5]


@pytest.fixture
def run(tmp_path: Path) -> Recording:
    """A run with all topics, whose measured motion is up to 0.2 rad off its command."""
    parameters = {"tip_frame": "tip", "euler_sequence": "XYZ"}
    folder = tmp_path / "run"
    return Recording.load(
        write_run(folder, MEASURED, COMMAND, speeds=SPEEDS, parameters=parameters)
    )


# --- numbers -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("peak_orientation_error", {}, math.degrees(0.4)),
        ("peak_orientation_error", {"of": "measured"}, math.degrees(0.5)),
        ("peak_orientation_error", {"of": "leading"}, math.degrees(0.4)),
        ("final_orientation_error", {}, math.degrees(0.1)),
        ("final_orientation_error", {"of": "measured"}, math.degrees(0.2)),
        ("peak_position_error", {}, 2e3 * math.sin(0.2)),
        ("final_position_error", {"of": "measured"}, 2e3 * math.sin(0.1)),
        ("peak_joint_speed", {}, 2.0),
        ("servo_lag", {}, math.degrees(0.2)),
        ("closest_approach", {}, 90 - math.degrees(0.4)),
        ("closest_approach", {"sequence": "ZYZ"}, 0.0),
        ("smallest_singular_value", {}, 1.0),
        ("period_growth", {"period": 0.01}, 4.0),
    ],
)
def test_a_metric_is_what_the_rod_gives_by_hand(
    run: Recording, name: str, options: dict[str, str], expected: float
) -> None:
    assert get_metric(name).compute(run, **options) == pytest.approx(expected, rel=EXACT, abs=1e-6)


def test_an_unknown_metric_or_series_lists_those_that_exist(run: Recording) -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean 'servo_lag'.*peak_joint_speed"):
        get_metric("servo_lags")
    with pytest.raises(UnknownNameError, match="command, leading, measured"):
        get_metric("peak_joint_speed").compute(run, of="comand")


def test_every_metric_says_what_it_is() -> None:
    assert all(metric.description for metric in METRICS.values())


def test_the_sequence_of_the_parameters_gives_the_pole(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", [0.3], parameters={"euler_sequence": "ZYZ"})
    assert get_metric("closest_approach").compute(
        Recording.load(folder), of="measured"
    ) == pytest.approx(math.degrees(0.3), rel=EXACT)


# --- recordings ----------------------------------------------------------------------


def test_times_start_at_the_first_joint_states(run: Recording) -> None:
    assert run.measured.t.tolist() == [0.0, 0.01, 0.02, 0.03]
    assert run.command is not None
    assert run.command.t.tolist() == run.measured.t.tolist()


def test_a_bag_with_joint_states_only_has_what_needs_no_reference(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", MEASURED, speeds=SPEEDS, desired=False, urdf="")
    run = Recording.load(folder, URDF, "tip")
    assert run.command is None
    assert run.leading is run.measured
    assert np.isnan(run.measured.orientation_error).all()
    assert get_metric("peak_joint_speed").compute(run, of="leading") == 2.0
    for name in ("peak_orientation_error", "peak_position_error", "servo_lag"):
        with pytest.raises(BagError, match=r"no joint_reference|no desired frame"):
            get_metric(name).compute(run)
    with pytest.raises(BagError, match="no desired frame"):
        get_metric("peak_orientation_error").compute(run, of="measured")


def test_a_bag_that_names_no_tip_asks_for_it(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="--tip-frame"):
        Recording.load(write_run(tmp_path / "run", MEASURED, desired=False))


def test_topics_of_another_type_are_not_taken(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run") as bag:
        for name in ("/joint_states", "/robot_description"):
            bag.add_topic(Topic(name, "std_msgs/msg/String"))
        bag.write("/joint_states", serialize_message(String(data="stopped")), 1, 1)
    with pytest.raises(BagError, match="no joint_states"):
        Recording.load(tmp_path / "run", URDF, "tip")


@pytest.mark.parametrize("parameters", ["- 1", "/clik: 3", "/clik: {ros__parameters: [1]}"])
def test_parameters_of_another_form_are_left_out(tmp_path: Path, parameters: str) -> None:
    source = Bag(write_run(tmp_path / "source", MEASURED))
    with BagWriter(tmp_path / "run") as bag:
        bag.attach("parameters.yaml", parameters)
        for name, info in source.topics.items():
            bag.add_topic(Topic(name, info.type))
        for message in source.read_raw():
            bag.write(message.topic, message.data, message.log_time, message.publish_time)
    assert Recording.load(tmp_path / "run").parameters == {}


def test_labels_differ_by_as_many_folders_as_it_takes(tmp_path: Path) -> None:
    runs = [Recording.load(write_run(tmp_path / p, MEASURED)) for p in ("a/x", "b/x", "b/y")]
    assert labels(runs) == [str(Path(*p)) for p in (("a", "x"), ("b", "x"), ("b", "y"))]
    assert labels(runs[1:]) == ["x", "y"]
    assert labels([runs[0], runs[0]]) == ["1: x", "2: x"]


# --- words and numbers ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1.9138, "1.91"),
        (41.08, "41.1"),
        (175.6, "176"),
        (0.00775, "0.00775"),
        (1.44e-4, "1.44e-4"),
        (4.652e8, "4.65e8"),
        (-2e-13, "-2.00e-13"),
        (3e120, "3.00e120"),
        (math.nan, "nan"),
        (math.inf, "inf"),
    ],
)
def test_a_number_has_three_digits(value: float, text: str) -> None:
    assert number(value) == text


def test_a_quantity_has_its_unit() -> None:
    assert quantity(1.0, "deg") == "1.00 deg"
    assert quantity(1.0, "") == "1.00"


def test_the_sentence_takes_its_numbers_from_the_recordings(tmp_path: Path) -> None:
    runs = {
        name: Recording.load(write_run(tmp_path / name, [q], [q], speeds=[2.0]))
        for name, q in (("near", 0.1), ("far", 0.5))
    }
    text = "{peak_orientation_error.far}, {peak_orientation_error.far/near} times, {other}"
    assert fill(text, runs) == "28.6 deg, 5.00 times, {other}"
    with pytest.raises(UnknownNameError, match=r"unknown variant 'fare' \(did you mean 'far'"):
        fill("{servo_lag.fare}", runs)
    with pytest.raises(UnknownNameError, match="unknown metric 'lag'"):
        fill("{lag.far}", runs)
    assert describe(list(runs.values())) == (
        "Largest orientation error: 5.73 deg (near), 28.6 deg (far)."
    )


def test_runs_with_nothing_desired_are_described_by_their_speed(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", MEASURED, speeds=SPEEDS, desired=False)
    assert describe([Recording.load(folder, tip_frame="tip")]) == (
        "Largest joint speed: 2.00 rad/s (run)."
    )


@pytest.mark.parametrize("name", config_names("experiments"))
def test_the_summary_of_an_experiment_names_its_variants_and_metrics(name: str) -> None:
    experiment = load_experiment(name)
    found = placeholders(experiment.summary)
    assert len(found) == experiment.summary.count("{")
    for metric, *variants in found:
        get_metric(metric)
        assert set(variants) - {""} <= experiment.variants.keys()


# --- fewer points, axes --------------------------------------------------------------


def test_decimation_keeps_the_ends_and_every_peak() -> None:
    t = np.arange(100_000) / 1e3
    y = np.sin(t)
    y[41_234], y[77_777] = 5e8, -3.0
    few_t, few_y = decimate(t, y, 100)
    assert len(few_t) <= 400
    assert np.all(np.diff(few_t) > 0)
    assert (few_t[0], few_t[-1]) == (t[0], t[-1])
    for index in (41_234, 77_777):
        assert few_y[few_t == t[index]] == y[index]
    assert np.array_equal(few_y, y[np.searchsorted(t, few_t)])


def test_decimation_keeps_gaps_and_ignores_what_is_not_finite() -> None:
    t = np.arange(10_000.0)
    y = np.ones(10_000)
    y[:5_000], y[6_000], y[7_000], y[8_000] = np.nan, np.inf, np.nan, 7.0
    few_t, few_y = decimate(t, y, 100)
    assert np.count_nonzero(np.isnan(few_y[few_t < 5_000])) == np.count_nonzero(few_t < 5_000) > 0
    assert few_y[few_t >= 5_000].tolist().count(1.0) > 50
    assert np.nanmax(few_y) == 7.0
    few = decimate(t[:3], np.array([1.0, np.inf, 2.0]), 100)[1]
    assert np.array_equal(few, [1.0, np.nan, 2.0], equal_nan=True)


def test_an_axis_is_logarithmic_where_runs_differ_by_powers_of_ten() -> None:
    small, large = np.full(100, 1.0), np.full(100, 1.0)
    assert axis([small, 2 * small], 1e-6)["type"] == "linear"
    large[50] = 5e8
    shown = axis([small, large], 1e-6)
    assert shown["type"] == "log"
    low, high = shown["range"]
    assert low < 0 < 8.7 < high  # log10 of 1 and of 5e8


def test_an_axis_ends_where_values_are_rounding_and_survives_any_values() -> None:
    decaying = np.geomspace(1.0, 1e-15, 100)
    assert axis([decaying], 1e-6)["range"][0] > -7
    for values in ([np.zeros(3)], [np.full(3, np.nan)], [], [np.array([np.inf, 0.0])]):
        assert axis(values, 1e-6)["type"] == "linear"


# --- analyze -------------------------------------------------------------------------


def analyze(capsys: pytest.CaptureFixture[str], *args: object) -> tuple[int, str]:
    code = main([str(arg) for arg in args])
    return code, capsys.readouterr().out


def test_analyze_prints_numbers_and_the_path_of_the_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_run(tmp_path / "run", MEASURED, COMMAND, speeds=SPEEDS)
    page = tmp_path / "new" / "page.html"
    code, out = analyze(capsys, bag, "--out", page)
    assert code == 0
    assert re.search(r"orientation error, peak \[deg\] *│ *22\.9 ", out)
    assert re.search(r"servo lag, largest \[deg\] *│ *11\.5 ", out)
    assert re.search(r"closest to pole of XYZ \[deg\] *│ *67\.1 ", out)
    assert out.rstrip().endswith(f"The page: {page}")
    assert page.is_file()


def test_analyze_shows_a_dash_for_what_was_not_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_run(tmp_path / "run", MEASURED, speeds=SPEEDS, desired=False, urdf="")
    (tmp_path / "rod.urdf").write_text(URDF)
    options = ("--urdf", tmp_path / "rod.urdf", "--tip-frame", "tip", "--no-page")
    code, out = analyze(capsys, bag, *options)
    assert code == 0
    assert re.search(r"orientation error, peak \[deg\] *│ *- │", out)
    assert re.search(r"  measured, peak \[rad/s\] *│ *2\.00 │", out)
    assert "The page" not in out


def test_analyze_splits_the_table_of_many_bags(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    bags = [write_run(tmp_path / f"run_of_a_long_name_{i}", [0.1 * i]) for i in range(5)]
    _, out = analyze(capsys, *bags, "--no-page")
    assert max(map(len, out.splitlines())) <= 80
    assert "…" not in out
    for angle in ("5.73", "11.5", "17.2", "22.9"):
        assert angle in out


def test_analyze_shows_the_warning_of_a_truncated_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_run(tmp_path / "run", [0.1] * 4000)
    file = bag / "run_0.mcap"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    page = tmp_path / "page.html"
    code, out = analyze(capsys, bag, "--out", page)
    assert code == 0
    assert re.search(r"warning: .*run_0.mcap: was not finished", out)
    assert "run_0.mcap: was not finished" in page.read_text()
    assert "5.73" in out


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("missing",), "missing"),
        (("run", "--tip-frame", "tpi"), "unknown frame 'tpi' (did you mean 'tip'?)"),
        (("run", "--urdf", "missing.urdf"), "cannot read the URDF missing.urdf"),
        (("run", "--out", "run"), "cannot write the page run"),
    ],
)
def test_analyze_ends_with_one_line_and_code_2(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    args: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "run", MEASURED)
    code, out = analyze(capsys, *args)
    assert code == 2
    errors = [line for line in out.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert out.splitlines()[-1] == errors[0]
    assert message in errors[0]
