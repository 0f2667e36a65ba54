"""Recordings, their numbers, the sentence and the executable ``analyze``, on bags made by hand."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from representations import every_representation, make
from samples import all_rotations
from std_msgs.msg import String
from synthetic_runs import DISTANCE, PERIOD_NS, URDF, all_numbers, recorded, rewritten, write_run
from tolerances import ALGEBRAIC

from eulerparams_control.analysis.charts import axis
from eulerparams_control.analysis.decimation import decimate
from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.headline import describe, fill
from eulerparams_control.analysis.labels import number, quantity
from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.quantities import measure
from eulerparams_control.analysis.recording import Recording, lyapunov_series
from eulerparams_control.analysis.series import Frames, Series
from eulerparams_control.analysis.stacks import displacements, errors, quaternions
from eulerparams_control.bags import BagWriter
from eulerparams_control.bags.format import Topic
from eulerparams_control.bags.reader import RawMessage
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.laws.rotations import exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

EXACT = 1e-9  # relative: a few operations on doubles
MEASURED = [0.0, 0.3, -0.5, 0.2]
COMMAND = [0.0, 0.1, -0.4, 0.1]
SPEEDS = [0.0, -2.0, 1.0, 0.5]
EFFORTS = [3.0, -10.0, 10.0, 7.0]  # the limit is 10 Nm; the roll joint exerts 0.5 Nm
GAINS = {"orientation": "euler_parameters", "k_Po": 100.0, "k_Vo": 15.0}


@pytest.fixture
def run(tmp_path: Path) -> Recording:
    """A run with all topics, whose measured motion is up to 0.2 rad off its command."""
    parameters = {"tip_frame": "tip", "euler_sequence": "XYZ"}
    folder = tmp_path / "run"
    return recorded(folder, MEASURED, COMMAND, speeds=SPEEDS, parameters=parameters)


@pytest.fixture
def dynamic(tmp_path: Path) -> Recording:
    folder = tmp_path / "dynamic"
    return recorded(folder, MEASURED, speeds=SPEEDS, efforts=EFFORTS, parameters=GAINS)


def moved(folder: Path, q: Sequence[float], **options: Any) -> Recording:
    """Return a run of which the command moves through q [rad], a sample every 10 ms."""
    return recorded(folder / "moved", q, q, **options)


# --- numbers -------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("peak_orientation_error", {}, math.degrees(0.4)),
        ("peak_orientation_error", {"of": "measured"}, math.degrees(0.5)),
        ("final_orientation_error", {}, math.degrees(0.1)),
        ("final_orientation_error", {"of": "measured"}, math.degrees(0.2)),
        ("peak_position_error", {}, 2e3 * math.sin(0.2)),
        ("final_position_error", {"of": "measured"}, 2e3 * math.sin(0.1)),
        ("rms_orientation_error", {}, math.degrees(math.sqrt(0.18 / 4))),
        ("rms_orientation_error", {"after": 0.02}, math.degrees(math.sqrt(0.17 / 2))),
        ("peak_orientation_error", {"after": 0.03}, math.degrees(0.1)),
        ("peak_orientation_error", {"before": 0.01}, math.degrees(0.1)),
        ("final_orientation_error", {"before": 0.02}, math.degrees(0.4)),
        ("peak_position_error", {"after": 0.01, "before": 0.01}, 2e3 * math.sin(0.05)),
        ("final_position_error", {"before": 0.02}, 2e3 * math.sin(0.2)),
        ("settling_time", {}, math.inf),
        ("settling_time", {"threshold": 6.0}, 0.02),
        ("settling_time", {"threshold": 30.0}, 0.0),
        ("orientation_travel", {}, math.degrees(1.1)),
        ("orientation_travel", {"of": "measured"}, math.degrees(1.8)),
        ("travel_ratio", {}, 11.0),
        ("posture_cost", {"posture": [1.0, 2.0]}, (0.9**2 + 2.0**2) / 2),
        ("posture_cost", {"posture": [1.0, 2.0], "at": "start"}, 2.5),
        ("posture_cost", {"posture": [1.0, 2.0], "of": "measured"}, (0.8**2 + 2.0**2) / 2),
        ("divergence_time", {}, math.inf),
        ("peak_joint_speed", {}, 2.0),
        ("peak_joint_speed", {"after": 0.02}, 1.0),
        ("peak_tip_speed", {}, 2.0),
        ("peak_turning", {"after": 0.02}, 1.0),
        ("tip_distance", {}, 2e3 * math.sin(0.05)),
        ("tip_distance", {"axis": [0, 0, -1], "before": 0.02}, -1e3 * math.sin(0.4)),
        ("off_line", {}, 1e3 * (math.cos(0.05) - math.cos(0.45))),
        ("peak_speed_of_limit", {}, 2 / 3),
        ("peak_speed_of_limit", {"after": 0.03}, 0.5 / 3),
        ("servo_lag", {}, math.degrees(0.2)),
        ("closest_approach", {}, 90 - math.degrees(0.4)),
        ("closest_approach", {"sequence": "ZYZ"}, 0.0),
        ("smallest_singular_value", {}, 1.0),
        ("period_growth", {"period": 0.01}, 4.0),
    ],
)
def test_a_metric_is_what_the_rod_gives_by_hand(run, name, options, expected):
    assert measure(name, run, **options) == pytest.approx(expected, rel=EXACT, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("peak_effort", {}, 10.0), ("peak_effort", {"after": 0.03}, 7.0),
        ("saturated_time", {}, 0.02), ("saturated_time", {"before": 0.01}, 0.01),
        ("peak_orientation_error", {}, math.degrees(0.5)), ("peak_joint_speed", {}, 2.0),
    ],
)  # fmt: skip
def test_metrics_of_dynamic_control_are_of_efforts_and_motion(dynamic, name, options, expected):
    assert measure(name, dynamic, **options) == pytest.approx(expected, rel=EXACT)


def test_an_effort_at_its_limit_but_for_rounding_counts_as_saturated(tmp_path):
    efforts = [9.99, 10.0 * (1 - 1e-12), 12.0, 10.0]  # the last lasts for no known time
    folder = write_run(tmp_path / "run", MEASURED, efforts=efforts)
    assert measure("saturated_time", load(folder)) == pytest.approx(0.02, rel=EXACT)


def test_what_does_not_fit_the_recording_is_refused(run):
    with pytest.raises(BagError, match="has no joint_effort"):
        measure("peak_effort", run)
    with pytest.raises(BagError, match=r"no sample from 1 to inf s; the last is at 0\.03 s"):
        measure("peak_orientation_error", run, after=1)
    with pytest.raises(BagError, match="3 values; expected one for each of the 2 joints hinge, ro"):
        measure("posture_cost", run, posture=[1.0, 2.0, 3.0])
    with pytest.raises(UnknownNameError, match="unknown time of posture_cost 'middle'"):
        measure("posture_cost", run, posture=[1.0, 2.0], at="middle")
    with pytest.raises(BagError, match="fewer than two samples on a way from 10 to 30 deg"):
        measure("growth_rate", run, low=10.0, high=30.0)
    with pytest.raises(UnknownNameError, match=r"did you mean 'servo_lag'.*peak_joint_speed"):
        measure("servo_lags", run)
    with pytest.raises(UnknownNameError, match="command, leading, measured"):
        measure("peak_joint_speed", run, of="comand")


def test_the_growth_rate_is_that_of_the_first_way_out(tmp_path):
    t = np.arange(100) / 100
    out, back, again = 0.01 * np.exp(4 * t), np.linspace(0.5, 0.001, 30), 0.01 * np.exp(2 * t)
    run = moved(tmp_path, [0.1, 0.05, *out, *back, *again])
    assert measure("growth_rate", run, low=2.0, high=25.0) == pytest.approx(4.0, rel=1e-6)
    early = moved(tmp_path / "early", [0.3, 0.01, 0.05, *out])  # 17 deg; 3 deg, and back
    assert measure("growth_rate", early, low=2.0, high=15.0) == pytest.approx(4.0, rel=1e-6)


def test_a_run_that_diverged_never_settles_and_what_it_lacks_is_infinite(run):
    ended = replace(run, diverged=0.03)
    assert measure("settling_time", ended, threshold=30.0) == math.inf
    assert measure("divergence_time", ended) == 0.03
    assert measure("peak_orientation_error", ended, after=1.0) == math.inf
    assert measure("peak_joint_speed", ended) == 2.0
    with pytest.raises(UnknownNameError):
        measure("peak_speed", ended)


# --- recordings ----------------------------------------------------------------------
def test_a_bag_with_joint_states_only_has_what_needs_no_reference(tmp_path):
    folder = write_run(tmp_path / "run", MEASURED, speeds=SPEEDS, desired=False, urdf="")
    run = load(folder, URDF, "tip")
    assert run.command is None
    assert run.leading is run.measured
    assert np.isnan(run.measured.orientation_error).all()
    assert describe([Digest.of(run)]) == "Largest joint speed: 2.00 rad/s (run)."
    assert measure("peak_joint_speed", run, of="leading") == 2.0
    for name in ("peak_orientation_error", "peak_position_error", "servo_lag"):
        with pytest.raises(BagError, match=r"no joint_reference|no desired frame"):
            measure(name, run)
    with pytest.raises(BagError, match="no desired frame"):
        measure("peak_orientation_error", run, of="measured")


def test_topics_of_another_type_are_not_taken(tmp_path):
    with BagWriter(tmp_path / "run") as bag:
        for name in ("/joint_states", "/robot_description"):
            bag.add_topic(Topic(name, "std_msgs/msg/String"))
        bag.write("/joint_states", serialize_message(String(data="stopped")), 1, 1)
    with pytest.raises(BagError, match="no joint_states"):
        load(tmp_path / "run", URDF, "tip")


@pytest.mark.parametrize("parameters", ["- 1", "/clik: 3", "/clik: {ros__parameters: [1]}"])
def test_parameters_of_another_form_are_left_out(tmp_path, parameters):
    source = write_run(tmp_path / "source", MEASURED)
    run = rewritten(source, tmp_path / "run", lambda message, _k: message, parameters)
    assert load(run).parameters == {}


def test_efforts_are_read_by_joint_name_at_the_stamps_that_they_answer(dynamic):
    assert dynamic.effort is not None
    assert dynamic.effort.t.tolist() == dynamic.measured.t.tolist()
    assert dynamic.effort.tau.tolist() == [[tau, 0.5] for tau in EFFORTS]
    assert dynamic.command is None
    assert dynamic.leading is dynamic.measured
    assert dynamic.measured.orientation_error.tolist() == pytest.approx([0.0, 0.3, 0.5, 0.2])


def test_a_trajectory_begins_when_the_controller_said_so(tmp_path):
    began = 5 * PERIOD_NS
    run = recorded(tmp_path / "run", [0.0] * 30, lasting=0.1, began=began)
    for index, along in ((4, 0.0), (5, 0.0), (10, 0.5), (15, 1.0), (29, 1.0)):
        expected = [1.0, 0.0, along * DISTANCE]
        assert run.measured.desired.p[index] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("published", "known"), [(True, 4), (False, 1)])
def test_a_reference_counts_from_when_it_was_sent_not_recorded(tmp_path, published, known):
    def late(message: RawMessage, _k: int) -> RawMessage:
        log_time = message.log_time + (25_000_000 if message.topic == "/reference" else 0)
        sent = message.publish_time if published else 0
        return message._replace(log_time=log_time, publish_time=sent)

    source = write_run(tmp_path / "source", MEASURED, efforts=EFFORTS)
    error = load(rewritten(source, tmp_path / "run", late)).measured.orientation_error
    assert np.count_nonzero(np.isfinite(error)) == known


# --- Lyapunov functions --------------------------------------------------------------
def test_v_1_and_its_derivative_are_those_of_the_paper(tmp_path):
    q = np.linspace(2.0, 0.1, 50)
    V = moved(tmp_path, q, parameters=GAINS).lyapunov
    assert V is not None
    np.testing.assert_allclose(V.t, np.arange(50) / 100)
    np.testing.assert_allclose(V.V, 2 * (1 - np.cos(q / 2)), rtol=EXACT)  # eq. (30)
    np.testing.assert_allclose(V.dV, -100.0 * np.sin(q / 2) ** 2, rtol=EXACT)  # eq. (31)
    slope = np.diff(2 * (1 - np.cos(q / 2))) / 0.01
    np.testing.assert_allclose(V.dV_measured[1:], slope, rtol=1e-6)
    assert np.isnan(V.dV_measured[0])


def test_v_2_and_its_derivative_are_those_of_the_paper(dynamic):
    V, q, dq = dynamic.lyapunov, np.array(MEASURED), np.array(SPEEDS)
    assert V is not None
    expected = 100.0 * 2 * (1 - np.cos(q / 2)) + dq**2 / 2  # eq. (42)
    np.testing.assert_allclose(V.V, expected, rtol=EXACT)
    np.testing.assert_allclose(V.dV, -15.0 * dq**2, rtol=EXACT)  # eq. (43)
    assert dynamic.why_no_lyapunov == ""


@pytest.mark.parametrize(
    ("sign", "eta_of"),
    [
        ({"quaternion_sign": "shortest"}, lambda q: abs(math.cos(q / 2))),
        ({"quaternion_sign": "hysteretic", "hysteresis": 0.3}, lambda q: math.cos(q / 2)),
        ({"quaternion_sign": "hysteretic", "hysteresis": 0.0}, lambda q: abs(math.cos(q / 2))),
        (
            {"quaternion_sign": "continuous", "quaternion_initial_sign": -1},
            lambda q: -math.cos(q / 2),
        ),
    ],
)
def test_v_follows_the_sign_of_the_parameters_from_sample_to_sample(tmp_path, sign, eta_of):
    q = np.linspace(2.6, 3.5, 20)  # past half a turn
    V = moved(tmp_path, q, parameters=GAINS | sign).lyapunov
    assert V is not None
    np.testing.assert_allclose(V.V, [2 * (1 - eta_of(each)) for each in q], rtol=EXACT)


def test_in_the_closed_loop_v_never_increases_and_its_balance_is_1(tmp_path):
    k, t = 20.0, np.arange(60) / 100
    eta = np.tanh(k * t / 2 + math.atanh(math.cos(1.0)))  # eq. (29), from 2 rad
    q = 2 * np.arccos(np.minimum(eta, 1.0))
    run = moved(tmp_path, q, parameters=GAINS | {"k_Po": k})
    assert measure("lyapunov_start", run) == pytest.approx(2 * (1 - math.cos(1.0)), rel=EXACT)
    assert measure("lyapunov_increase", run) == 0.0
    assert measure("energy_balance", run) == pytest.approx(1.0, abs=2e-3)
    other = moved(tmp_path / "other", q, parameters=GAINS | {"k_Po": 2 * k})
    assert measure("energy_balance", other) == pytest.approx(2.0, abs=4e-3)


def test_a_rise_of_v_is_counted_from_its_lowest_value_before(tmp_path):
    V = [2 * (1 - math.cos(q / 2)) for q in (1.0, 0.2, 0.4, 0.3, 0.45)]
    run = moved(tmp_path, [1.0, 0.2, 0.4, 0.3, 0.45], parameters=GAINS)
    assert measure("lyapunov_increase", run) == pytest.approx((V[4] - V[1]) / V[0], rel=EXACT)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"parameters": GAINS | {"orientation": "euler_angles"}}, "no Lyapunov function for euler"),
        ({}, "no parameters of a node clik, compliance_control, dynamic_control or imped"),
        ({"parameters": GAINS, "node": "/other"}, "no parameters of a node clik, compliance_contr"),
        ({"parameters": GAINS, "desired": False}, "no desired frame was recorded"),
        ({"parameters": {"orientation": "euler_parameters"}}, "parameters of /clik lack k_Po"),
        ({"parameters": GAINS | {"orientation": "eluer"}}, "of parameter 'orientation': 'eluer'"),
        (
            {"parameters": GAINS | {"k_Po": [1]}},
            "of /clik are not valid: parameter 'k_Po' is [1], a list; expected a float",
        ),
    ],
)
def test_without_a_lyapunov_function_the_recording_says_why(tmp_path, options, words):
    folder = write_run(tmp_path / "run", MEASURED, COMMAND, **options)
    run = load(folder, tip_frame="tip")
    assert run.lyapunov is None
    assert words in run.why_no_lyapunov
    with pytest.raises(BagError, match="run: .*" + re.escape(words)):
        measure("lyapunov_increase", run)


# --- runs that are not finite ---------------------------------------------------------
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e30, 1e200, 1e300])
def test_every_number_of_a_run_that_diverged_has_no_warning(tmp_path, size):
    q, dq, tau = [0.1, 0.2, size, -size], [0.0, 1.0, size, -size], [1.0, 2.0, size, -size]
    folder = write_run(tmp_path / "run", q, speeds=dq, efforts=tau, parameters=GAINS)
    found = all_numbers(replace(load(folder), diverged=0.03))
    assert found["peak_joint_speed"] == found["peak_effort"] == size
    assert 0 < found["peak_orientation_error"] <= 180
    assert found["lyapunov_increase"] > 1e30


@pytest.mark.filterwarnings("error")
def test_v_is_infinite_where_the_velocities_of_the_tip_are_beyond_all_numbers():
    ur5 = load_robot("ur5")
    robot = Robot(ur5.urdf, ur5.base_frame, ur5.tip_frame)
    home, still = np.array(ur5.home), np.zeros(6)
    state = robot.state(home, still)
    frame = DesiredFrame(state.p_e, exp(np.array([0.1, 0.0, 0.0])) @ state.R_e)
    wild = np.array([0.0, 1.0, 1.0, 1.0, 0.0, 0.0]) * np.finfo(float).max  # parallel axes
    motion = Series(robot, np.arange(3.0), np.array([home] * 3), np.array([still, wild, wild]),
                    Frames.of([frame] * 3))  # fmt: skip
    assert np.isfinite(motion.omega_e).all(axis=1).tolist() == [True, False, False]
    parameters = {"/dynamic_control": GAINS}
    V = lyapunov_series(Recording(Path(), robot, parameters, (), motion))
    assert V.V[0] == pytest.approx(100.0 * 2 * (1 - math.cos(0.05)))
    assert V.V[1:].tolist() == [math.inf, math.inf]
    assert V.dV[1:].tolist() == [-math.inf, -math.inf]


# --- words and numbers ---------------------------------------------------------------
@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (1.9138, "1.91"), (41.08, "41.1"), (175.6, "176"), (1.44e-4, "1.44e-4"),
        (4.652e8, "4.65e8"), (3e120, "3.00e120"), (math.nan, "nan"), (math.inf, "inf"),
    ],
)  # fmt: skip
def test_a_number_has_three_digits_and_its_unit(value, text):
    assert number(value) == quantity(value, "") == text
    assert quantity(value, "deg") == f"{text} deg"


def test_the_sentence_takes_its_numbers_from_the_recordings(tmp_path):
    runs = {
        name: recorded(tmp_path / name, [q], [q], speeds=[2.0])
        for name, q in (("near", 0.1), ("far", 0.5))
    }
    text = "{peak_orientation_error.far}, {peak_orientation_error.far/near} times, {other}"
    assert fill(text, runs) == "28.6 deg, 5.00 times, {other}"
    options = {("peak_orientation_error", "far"): {"after": 1}}
    with pytest.raises(BagError, match="no sample from 1 to inf s"):
        fill(text, runs, lambda metric, variant: options.get((metric, variant), {}))
    with pytest.raises(UnknownNameError, match=r"unknown variant 'fare' \(did you mean 'far'"):
        fill("{servo_lag.fare}", runs)
    with pytest.raises(UnknownNameError, match="unknown metric 'lag'"):
        fill("{lag.far}", runs)
    assert describe(list(map(Digest.of, runs.values()))) == (
        "Largest orientation error: 5.73 deg (near), 28.6 deg (far)."
    )


# --- fewer points, axes --------------------------------------------------------------
def test_decimation_keeps_the_ends_and_every_peak():
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


ONES, ANY = np.full(100, 1.0), (-math.inf, math.inf)


@pytest.mark.parametrize(
    ("values", "options", "kind", "low", "high"),
    [
        ([ONES, 2 * ONES], {}, "linear", ANY, ANY),
        ([ONES, np.append(ONES, 5e8)], {}, "log", (-math.inf, 0), (math.log10(5e8), 10)),
        ([np.full(9, 3e-12)], {}, "linear", (0, 0), (1e-6, 1e-6)),  # rounding
        ([np.append(ONES, [1e30, 1e300])], {}, "log", (-math.inf, 0.1), (12.19, 12.21)),  # diverged
        ([np.geomspace(1.0, 1e-15, 100)], {}, "log", (-7, math.inf), ANY),  # to rounding
        ([ONES, 2 * ONES], {"logarithmic": True}, "log", ANY, ANY),
        ([np.zeros(3)], {"logarithmic": True}, "linear", ANY, ANY),
        *(([np.array(values)], {}, "linear", ANY, ANY) for values in ([0, 0], [math.nan] * 3)),
        ([], {}, "linear", ANY, ANY),
        ([np.array([np.inf, 0.0])], {}, "linear", ANY, ANY),
    ],
)
def test_an_axis_is_logarithmic_if_runs_differ_by_powers_of_ten(values, options, kind, low, high):
    shown = axis(values, 1e-6, **options)
    assert ("log" if shown.logarithmic else "linear") == kind
    ends = (math.log10(end) if shown.logarithmic else end for end in shown[1:3])
    for end, (least, most) in zip(ends, (low, high), strict=True):
        assert least <= end <= most


# --- stacks ------------------------------------------------------------------------------------
@every_representation
def test_errors_in_stacks_are_those_of_the_displacements_one_after_the_other(name):
    R_d, R_e = np.array(all_rotations()), np.array(all_rotations()[::-1])
    before, *x_de = displacements(make(name), R_d, R_e)
    Q_de = quaternions(x.Q_de for x in displacements(make("euler_parameters"), R_d, R_e))
    found = errors(make(name), R_d[1:], R_e[1:], Q_de[1:], before)
    np.testing.assert_allclose(found, [x.error for x in x_de], rtol=ALGEBRAIC, atol=ALGEBRAIC)
    assert errors(make(name), R_d[:0], R_e[:0], Q_de[:0]).shape == (0, 3)
