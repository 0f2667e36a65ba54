"""The soak: its arithmetic on made-up records, and one short run of one controller."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from ros_processes import ROOT

from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.lab.soak.cause import OVERRUN, REFUSED, UNSEEN, WITHHELD, Causes
from eulerparams_control.lab.soak.ledger import PATIENCE, Histogram, Ledger, Missed
from eulerparams_control.lab.soak.main import main
from eulerparams_control.lab.soak.page import write_page
from eulerparams_control.lab.soak.record import (
    Life,
    Page,
    SoakPlan,
    SoakRecord,
    Unanswered,
    Usage,
    usage_of,
    waited_of,
)
from eulerparams_control.lab.soak.summary import write_summary
from eulerparams_control.lab.soak.verdict import judge

# A percentile of the histogram is right within this part of it: half of a bin is 0.5 %.
BIN = 0.006

# A guard against hanging: the short run takes about a minute.
PATIENT = 300.0

QUEUE = 0.04  # [s]
MS = 1e-3


# --- latencies -------------------------------------------------------------------------------


def test_percentiles_are_those_of_the_numbers_within_a_hundredth() -> None:
    found = Histogram()
    for k in range(1, 1001):
        found.add(k * MS)
    assert len(found) == 1000
    assert found.percentile(50) == pytest.approx(0.5, rel=BIN)
    assert found.percentile(99) == pytest.approx(0.99, rel=BIN)
    assert found.largest == 1.0


def test_merged_histograms_count_what_both_have_counted() -> None:
    one, other = Histogram(), Histogram()
    for _ in range(90):
        one.add(0.001)
    for _ in range(10):
        other.add(0.1)
    one.merge(other)
    assert one.percentile(90) == pytest.approx(0.001, rel=2 * BIN)
    assert one.percentile(91) == pytest.approx(0.1, rel=2 * BIN)
    assert one.largest == 0.1


def test_what_is_beyond_the_bins_is_counted_at_their_ends() -> None:
    found = Histogram()
    assert math.isnan(found.percentile(99))
    for seconds in (0.0, -1.0, 1e9):
        found.add(seconds)
    assert len(found) == 3
    assert found.percentile(1) == pytest.approx(1e-6, rel=BIN)


# --- states and commands -----------------------------------------------------------------------


def test_a_round_trip_is_from_the_state_to_the_command_of_its_stamp() -> None:
    ledger = Ledger()
    ledger.state(4, 10.0)
    ledger.state(8, 10.1)
    ledger.command(8, 10.103)
    ledger.command(4, 10.2)
    assert ledger.latencies.largest == pytest.approx(0.2)
    assert ledger.latencies.percentile(1) == pytest.approx(0.003, rel=BIN)
    assert ledger.missed(100.0) == []
    assert (ledger.states, ledger.commands, ledger.strays) == (2, 2, 0)


def test_a_command_that_is_read_before_its_state_counts_as_its_answer() -> None:
    ledger = Ledger()
    ledger.command(4, 10.002)
    ledger.state(4, 10.0)
    assert ledger.latencies.largest == pytest.approx(0.002)
    assert ledger.missed(100.0) == []
    assert ledger.strays == 0


def test_a_state_is_missed_once_after_the_patience_and_a_command_alone_is_a_stray() -> None:
    ledger = Ledger()
    ledger.state(4, 10.0)
    ledger.state(8, 11.0)
    ledger.command(99, 10.0)
    assert ledger.missed(10.0 + PATIENCE - 0.01) == []
    assert ledger.missed(10.0 + PATIENCE) == [Missed(4, 10.0)]
    assert ledger.missed(10.0 + PATIENCE) == []
    assert ledger.strays == 1
    ledger.forget()
    assert ledger.missed(100.0) == []


# --- causes --------------------------------------------------------------------------------------


def causes(refused: int = 0, overrun: int = 0, waited: float = 0.0) -> Causes:
    """Return what was counted between 10 s and 11 s."""
    found = Causes(QUEUE)
    for allowance, count in ((found.refused, refused), (found.overrun, overrun)):
        allowance.report(10.0, 5)
        allowance.report(11.0, 5 + count)
    found.waits.sample(10.0, {1: 3.0, 2: 7.0})
    found.waits.sample(10.6, {1: 3.0, 2: 7.0 + waited})
    return found


def test_each_count_explains_one_state_of_its_time() -> None:
    found = causes(refused=2)
    assert [found.of(10.5), found.of(10.51), found.of(10.52)] == [REFUSED, REFUSED, ""]
    assert causes(refused=1).of(11.2) == ""  # it was counted before
    assert causes(refused=1).of(5.9) == ""  # and long after
    assert causes().of(10.5) == ""


def test_an_overrun_queue_is_explained_only_where_a_thread_had_no_processor() -> None:
    assert causes(overrun=1, waited=QUEUE / 2 + 0.001).of(10.5) == OVERRUN
    assert causes(overrun=1, waited=QUEUE / 2 - 0.001).of(10.5) == ""
    assert causes(overrun=0, waited=1.0).of(10.5) == ""
    assert causes(overrun=1, waited=1.0).of(10.99) == ""  # it waited before, not then


def test_of_two_counts_the_one_that_was_reported_first_is_used() -> None:
    found = causes(overrun=1, waited=1.0)
    found.refused.report(13.0, 6)
    assert [found.of(10.5), found.of(12.5)] == [OVERRUN, REFUSED]


def test_a_command_that_the_monitor_lost_is_told_by_its_number() -> None:
    found = causes()
    found.unseen.add(10.6, 1)
    assert [found.of(10.5), found.of(10.5)] == [UNSEEN, ""]


def test_what_is_withheld_from_a_runaway_arm_is_explained_only_on_a_starved_machine() -> None:
    for waited, cause in ((1.0, WITHHELD), (0.0, "")):
        found = causes(waited=waited)
        found.said(10.6, Mode.RELEASING, Cause.RUNAWAY)
        found.said(11.0, Mode.FOLLOWING, Cause.NO_STATES)
        found.said(12.0, Mode.HOLDING)
        assert found.of(11.0) == cause
        assert found.of(12.1) == ""


def test_the_kernel_says_what_this_process_takes() -> None:
    usage = usage_of(os.getpid())
    assert 0 < usage.uss <= usage.rss < 1e5
    assert usage.cpu > 0
    assert waited_of(os.getpid())[os.getpid()] >= 0
    with pytest.raises(OSError, match="No such file"):
        usage_of(2**22 + 1)


# --- verdicts ------------------------------------------------------------------------------------

PLAN = SoakPlan(("clik",), 100.0, 250.0)


def record(grows: float = 0.0, last: float = 0.001, states: int = 100) -> SoakRecord:
    """Return a record in which memory grows by a part, and the last quarter is so slow [s]."""
    found = SoakRecord(PLAN)
    begins = [-PLAN.warm_up, *(k * PLAN.page for k in range(PLAN.pages))]
    found.pages["clik"] = []
    for k, begin in enumerate(begins):
        latencies = Histogram()
        latencies.add(last if k == PLAN.pages else 0.001)
        found.pages["clik"].append(Page(begin, begin + PLAN.page, states, states, latencies))
    life = Life("clik/clik", 1)
    for t in range(-25, 101):
        size = 100.0 + (50.0 if t < 0 else grows * t)  # what the warm-up takes does not count
        life.samples.append((float(t), Usage(size, 50.0, 0.1 * t)))
    found.lives.append(life)
    return found


def failed(found: SoakRecord) -> list[str]:
    return [f"{v.text}: {v.measured}" for v in judge(found) if not v.met]


def test_a_record_without_faults_meets_all_criteria() -> None:
    assert failed(record()) == []
    assert len(judge(record())) == 4


def test_memory_that_grows_by_more_than_a_hundredth_is_found() -> None:
    assert failed(record(grows=0.009)) == []
    assert failed(record(grows=0.013)) == ["growth of its memory after the warm-up: +1.18 %"]
    assert failed(record(grows=-0.5)) == []


def test_memory_of_a_life_that_is_too_short_is_unknown_which_is_not_met() -> None:
    found = record()
    del found.lives[0].samples[40:]
    assert failed(found) == ["growth of its memory after the warm-up: unknown"]


def test_a_round_trip_that_gets_slower_is_found() -> None:
    assert failed(record(last=0.00147)) == []
    (text,) = failed(record(last=0.00155))
    assert text.startswith("p99 of the round trip, last quarter by first: 1.5")


def test_a_state_that_nothing_explains_is_found_and_so_is_a_run_without_states() -> None:
    found = record()
    found.unanswered.append(Unanswered("clik", Missed(4, 10.0), REFUSED))
    assert failed(found) == []
    found.unanswered.append(Unanswered("clik", Missed(8, 10.0), ""))
    (text,) = failed(found)
    assert "1 (2 without a command, of 400 states)" in text
    assert len(failed(record(states=0))) == 1


def test_a_node_that_died_is_found() -> None:
    found = record()
    found.death = "the node clik died with exit code -11"
    assert failed(found) == [f"all nodes run to the end: {found.death}"]


def test_the_page_loads_nothing_and_escapes_what_was_said(tmp_path: Path) -> None:
    found = record()
    found.death = "<script>alert(1)</script>"
    verdicts = judge(found)
    write_page(tmp_path / "index.html", found, verdicts)
    page = (tmp_path / "index.html").read_text()
    assert "<script" not in page
    assert "http://" not in page.replace("http://www.w3.org", "").replace("http://purl.org", "")
    assert page.count("<svg") == 2
    assert "1 of 4 criteria are not met" in page
    write_summary(tmp_path / "summary.json", found, verdicts)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["met"] is False
    assert summary["latency"]["clik"][1]["p99_ms"] == pytest.approx(1.0, rel=BIN)


# --- the command ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--seconds", "5"], "a soak of 5 s; expected 25 s to 1e6 s"),
        (["--seconds", "nan"], "a soak of nan s"),
        (["--rate", "5000"], "--rate 5000; expected 100 to 1000 Hz"),
    ],
)
def test_what_cannot_be_run_is_refused_in_one_line(
    capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    assert main(options) == 2
    assert words in " ".join(capsys.readouterr().out.split())


def test_results_of_a_former_soak_are_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "nodes").mkdir()
    assert main(["--out", str(tmp_path)]) == 2
    assert "exists; remove it" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_a_short_soak_sees_all_nodes_their_round_trips_and_their_memory(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "eulerparams_control.lab.soak.main"]
    options = ["--seconds", "25", "--controller", "clik", "--rate", "100", "--out", str(tmp_path)]
    path = os.pathsep.join([os.environ.get("PYTHONPATH", ""), str(ROOT)]).lstrip(":")
    done = subprocess.run(
        [*command, *options], env=os.environ | {"PYTHONPATH": path}, capture_output=True,
        text=True, timeout=PATIENT, check=False,
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stdout + done.stderr
    summary: dict[str, Any] = json.loads((tmp_path / "summary.json").read_text())
    assert done.returncode == (0 if summary["met"] else 1)
    names = {process["name"] for process in summary["processes"]}
    assert names == {
        "clik/pybullet_bridge", "clik/clik", "clik/reference", "bag_recorder", "monitor"
    }  # fmt: skip
    warm_up, *pages = summary["latency"]["clik"]
    assert warm_up["begin_s"] == -6.25
    assert [page["end_s"] for page in pages] == [6.25, 12.5, 18.75, 25.0]
    for page in pages:
        assert page["states_per_s"] > 50  # of 100: a busy machine gives up some
        assert 0 < page["p50_ms"] <= page["p99_ms"] <= 1.01 * page["max_ms"]
    assert all(process["uss_MiB"][-1] > 20 for process in summary["processes"])
    answered = sum(page["commands_per_s"] for page in pages) * pages[0]["end_s"]
    asked = sum(page["states_per_s"] for page in pages) * pages[0]["end_s"]
    edges = 100 * (0.5 + 2 * summary["monitor_gap_s"])  # states that are read on another page
    assert abs(asked - answered - len(summary["missed"])) < edges
    assert summary["bag_MB"] > 0.01
    assert "following a reference" in str(summary["events"])
    assert (tmp_path / "index.html").read_text().startswith("<!DOCTYPE html>")
