"""The soak: its numbers on made-up bags, and one short run of one controller."""

import csv
import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message
from ros_processes import ROOT
from sensor_msgs.msg import JointState
from synthetic_runs import URDF, write_run
from test_faulty_runs import efforts

from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.quantities import BY_NAME, measure
from eulerparams_control.analysis.quantities.real_time import (
    OTHERS,
    PATIENCE,
    USAGE,
    ModeReport,
    Unanswered,
    reasons,
)
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.bags import Bag, BagWriter
from eulerparams_control.bags.format import Topic
from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.lab.experiments.runner import node_parameters
from eulerparams_control.lab.experiments.soak import main, soak
from eulerparams_control.lab.run.usage import usage_of, waited_of

PLOTS = [BY_NAME[name] for name in ("round_trip_p50", "round_trip_p99", "memory", "processor")]

# A guard against hanging: the short run takes about a minute.
PATIENT = 300.0
# Relative: times of some 1e9 s in whole nanoseconds, and their differences as doubles.
EXACT = 1e-6

QUEUE = 0.04  # [s]
MS = 1e-3


# --- causes --------------------------------------------------------------------------------------
def why(
    *missed: float, refused: int = 0, overrun: int = 0, waited: float = 0.0, later: Any = ()
) -> list[str]:
    """Return why states were missed, with these counts between 10 s and 11 s."""
    said = [ModeReport(10.0, Mode.FOLLOWING, "", 5, 5)]
    said += [ModeReport(11.0, Mode.FOLLOWING, "", 5 + refused, 5 + overrun), *later]
    waits = [(9.0, 10.0, 0.0), (10.0, 10.6, waited)]
    return list(map(str, reasons(np.array(missed), said, waits, QUEUE)))


def test_each_count_explains_one_state_of_its_time():
    assert why(10.5, 10.51, 10.52, refused=2) == [Unanswered.REFUSED, Unanswered.REFUSED, ""]
    assert why(11.2, refused=1) == [""]  # it was counted before
    assert why(5.9, refused=1) == [""]  # and long after
    assert why(10.5) == [""]


def test_an_overrun_queue_is_explained_only_where_a_thread_had_no_processor():
    assert why(10.5, overrun=1, waited=QUEUE / 2 + 0.001) == [Unanswered.OVERRUN]
    assert why(10.5, overrun=1, waited=QUEUE / 2 - 0.001) == [""]
    assert why(10.5, overrun=0, waited=1.0) == [""]
    assert why(10.99, overrun=1, waited=1.0) == [""]  # it waited before, not then


def test_of_two_counts_the_one_that_was_reported_first_is_used():
    later = [ModeReport(13.0, Mode.FOLLOWING, "", 6, 6)]
    found = why(10.5, 12.5, overrun=1, waited=1.0, later=later)
    assert found == [Unanswered.OVERRUN, Unanswered.REFUSED]


def test_what_is_withheld_from_a_runaway_arm_is_explained_only_on_a_starved_machine():
    for waited, cause in ((1.0, Unanswered.WITHHELD), (0.0, "")):
        later = [
            ModeReport(10.6, Mode.RELEASING, Cause.RUNAWAY, 5, 5),
            ModeReport(11.0, Mode.FOLLOWING, Cause.NO_STATES, 5, 5),
            ModeReport(12.0, Mode.HOLDING, "", 5, 5),
        ]
        assert why(11.0, 12.1, waited=waited, later=later) == [cause, ""]


def test_the_kernel_says_what_this_process_takes():
    rss, uss, cpu = usage_of(os.getpid())
    assert 0 < uss <= rss < 1e5
    assert cpu > 0
    assert waited_of(os.getpid())[os.getpid()] >= 0
    with pytest.raises(OSError, match="No such file"):
        usage_of(2**22 + 1)


# --- numbers of a run ------------------------------------------------------------------------
START = 1_700_000_000_000_000_000
RATE, SECONDS, WARM_UP = 10, 40.0, 10.0  # a fifth of what counts


def recording(
    folder: Path,
    latency: Any = lambda _t: MS,
    grows: float = 0.0,
    refused: int = 0,
    restarts: bool = False,
) -> Recording:
    """Return a run in which a state sent at t [s] is answered ``latency(t)`` [s] later, or never.

    Memory of its controller grows by a part of it in each second [1/s].
    """
    whole = WARM_UP + SECONDS
    (command,) = efforts(0.0)
    state = JointState(name=["hinge", "roll"], position=[0.0, 0.0], velocity=[0.0, 0.0])
    with BagWriter(folder / "made") as bag:
        bag.add_topic(Topic("/joint_states", "sensor_msgs/msg/JointState"))
        bag.add_topic(Topic("/joint_effort", "sensor_msgs/msg/JointState"))
        bag.add_topic(Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"))
        parameters = {"/d": {"ros__parameters": {"tip_frame": "tip"}}}
        bag.attach("parameters.yaml", yaml.safe_dump(parameters))
        for k in range(int((whole + PATIENCE) * RATE)):
            sent = START + k * 1_000_000_000 // RATE
            for message in (state, command):
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(sent, 10**9)
            bag.write("/joint_states", serialize_message(state), sent, sent)
            if (late := latency(k / RATE)) is not None:
                received = sent + round(late * 1e9)
                bag.write("/joint_effort", serialize_message(command), received, sent)
            if k % RATE == 0:
                count = str(refused if k / RATE > 28 else 0)
                values = [KeyValue(key="joint_states rejected", value=count)]
                told = DiagnosticArray(status=[DiagnosticStatus(name="d", values=values)])
                bag.write("/diagnostics", serialize_message(told), sent, sent)
    with open(folder / "made" / USAGE, "w", encoding="utf-8", newline="") as file:
        for second in range(int(whole + PATIENCE) + 1):
            size = 100.0 + (50.0 if second < WARM_UP else 100.0 * grows * (second - WARM_UP))
            pid = 1 + restarts * (second % 3)
            rows = [("d", pid, size)] + [(name, 3 + k, 100.0) for k, name in enumerate(OTHERS)]
            csv.writer(file).writerows(
                (START + second * 10**9, name, number, 0.0, rss, 50.0, 0.1 * second)
                for name, number, rss in rows
            )
    return load(folder / "made", urdf=URDF)


def test_a_run_without_faults_has_the_numbers_that_it_was_made_of(tmp_path):
    found = recording(tmp_path)
    assert measure("unanswered_states", found) == measure("unexplained_states", found) == 0
    assert measure("round_trip", found) == pytest.approx(1.0, rel=EXACT)
    assert measure("round_trip_growth", found) == pytest.approx(1.0, rel=EXACT)
    assert measure("longest_gap", found) == pytest.approx(1e3 / RATE, rel=EXACT)
    for node in ("controller", *OTHERS):
        assert measure("memory_growth", found, node=node) == 0


def test_a_round_trip_is_measured_in_its_quarter_after_the_warm_up(tmp_path):
    def latency(t: float) -> float:
        slow = t < WARM_UP or t >= WARM_UP + SECONDS
        return 1.0 if slow else MS * (1 + int((t - WARM_UP) / (SECONDS / 4)))

    found = recording(tmp_path, latency)
    for quarter in (1, 2, 3, 4):
        for percent in (50, 99, 100):
            value = measure("round_trip", found, percent=percent, quarter=quarter)
            assert value == pytest.approx(quarter, rel=EXACT)
    assert measure("round_trip", found, percent=100) == pytest.approx(4.0, rel=EXACT)
    assert measure("round_trip_growth", found) == pytest.approx(4.0, rel=EXACT)
    with pytest.raises(BagError, match="quarter 5: expected 1 to 4"):
        measure("round_trip", found, quarter=5)


def test_states_without_a_command_are_counted_and_those_that_nothing_explains(tmp_path):
    missed = (2.0, 28.0, 28.5, 55.0)  # the first and the last do not count

    def latency(t: float) -> float | None:
        return None if t in missed else MS

    found = recording(tmp_path, latency)
    assert measure("unanswered_states", found) == measure("unexplained_states", found) == 2
    assert measure("longest_gap", found) == pytest.approx(2e3 / RATE, rel=EXACT)
    explained = recording(tmp_path / "refused", latency, refused=1)
    assert measure("unanswered_states", explained) == 2
    assert measure("unexplained_states", explained) == 1


def test_memory_that_grows_is_found_where_a_process_lived_long_enough(tmp_path):
    found = recording(tmp_path, grows=0.001)  # medians of 10 s at each end, 36 s apart
    assert measure("memory_growth", found, node="controller") == pytest.approx(3.7, abs=0.3)
    assert measure("memory_growth", found, node="reference") == 0
    short = recording(tmp_path / "short", restarts=True)
    assert math.isnan(measure("memory_growth", short, node="controller"))
    with pytest.raises(UnknownNameError, match="unknown node 'clik'"):
        measure("memory_growth", found, node="clik")


def test_what_is_drawn_is_what_was_measured(tmp_path):
    found = recording(tmp_path, grows=0.001)
    curves = {quantity.name: quantity.of(found) for quantity in PLOTS}
    t, percentile = curves["round_trip_p99"]
    np.testing.assert_allclose(t, [14.95, 24.95, 34.95, 44.95], atol=0.1)
    np.testing.assert_allclose(percentile, 1.0, rtol=EXACT)
    t, memory = curves["memory"]
    np.testing.assert_allclose(memory[:10, 0], 150.0)
    np.testing.assert_allclose(memory[10:, 0], 100 + 0.1 * (t[10:] - WARM_UP), atol=1e-6)
    np.testing.assert_allclose(curves["processor"][1], 10.0, rtol=EXACT)


def test_a_run_that_is_not_in_real_time_has_no_such_numbers(tmp_path):
    found = load(write_run(tmp_path / "run", [0.0] * 3, [0.0] * 3))
    with pytest.raises(BagError, match=r"has no usage.csv: it is no experiment with real_time"):
        measure("round_trip", found)
    assert {len(quantity.of(found)[0]) for quantity in PLOTS} == {0}


# --- the command ---------------------------------------------------------------------------------
def test_a_soak_of_another_length_has_a_circle_that_outlasts_it():
    for seconds, warm_up in ((25.0, 6.25), (1200.0, 60.0), (36000.0, 60.0)):
        for variant in soak(seconds, 500.0).variants.values():
            found = node_parameters(variant)
            assert variant.duration == seconds + warm_up + PATIENCE
            assert (found["pybullet_bridge"]["mode"], found["pybullet_bridge"]["rate"]) == (
                "realtime",
                500.0,
            )
            circle = found["reference"]
            assert circle["circle_turns"] * circle["circle_period"] > variant.duration
            assert circle["circle_turns"] <= 10


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--seconds", "5"], "a soak of 5 s; expected 25 s to 1e6 s"),
        (["--seconds", "nan"], "a soak of nan s"),
        (["--rate", "5000"], "--rate 5000; expected 200 to 1000 Hz"),
    ],
)
def test_what_cannot_be_run_is_refused_in_one_line(capsys, options, words):
    assert main(options) == 2
    assert words in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_a_short_soak_sees_all_nodes_their_round_trips_and_their_memory(tmp_path):
    command = [sys.executable, "-m", "eulerparams_control.lab.experiments.soak"]
    options = ["--seconds", "25", "--controller", "clik", "--rate", "200", "--out", str(tmp_path)]
    path = os.pathsep.join([os.environ.get("PYTHONPATH", ""), str(ROOT)]).lstrip(":")
    done = subprocess.run(
        [*command, *options], env=os.environ | {"PYTHONPATH": path}, capture_output=True,
        text=True, timeout=PATIENT, check=False,
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stdout + done.stderr
    summary: dict[str, Any] = json.loads((tmp_path / "summary.json").read_text())
    assert done.returncode == (0 if summary["met"] else 1)
    assert [verdict["variant"] for verdict in summary["criteria"]] == ["clik"] * 6
    measured = {verdict["text"]: float(verdict["measured"]) for verdict in summary["criteria"]}
    unknown = {text for text, value in measured.items() if not math.isfinite(value)}
    assert unknown <= {"Growth of the memory of reference"}  # if faults end its motion
    found = load(tmp_path / "clik")
    states = sum(message.topic == "/joint_states" for message in Bag(tmp_path / "clik").read_raw())
    assert states > 100 * 25  # of 200 a second: a busy machine gives up some
    half, most, all_of_them = (measure("round_trip", found, percent=p) for p in (50, 99, 100))
    assert 0 < half <= most <= all_of_them
    _, memory = BY_NAME["memory"].of(found)
    assert (np.nanmax(memory, axis=0) > 20).all()  # a node that has just started takes less
    told = (tmp_path / "logs/clik/clik.events").read_text()
    assert unknown or "following" in told  # a motion that no fault has ended
    assert (tmp_path / "report.html").read_text().startswith("<!DOCTYPE html>")
