"""What nodes said on /diagnostics is told with a recording, at the time when they said it."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message
from synthetic_runs import _START as START
from synthetic_runs import write_run

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.loading import Options, blocks, load
from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.reports import _LONGEST, _MOST
from eulerparams_control.bags import Bag, BagWriter
from eulerparams_control.bags.format import Topic
from eulerparams_control.control.speed_scaling import Nearness
from eulerparams_control.ros import control_report

OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"
STATES = 100  # of a run, one every 10 ms
HOLDING = "holding still: <b>the arm</b> is blocked"

LATE_NS = 60_000_000  # by which messages of one node overtake those of another

type Saying = tuple[float, str, bytes, str, str | dict[str, str]]
"""When [s] a node says what, with which level, and what to do; or other keys and their values."""

STORY: Sequence[Saying] = (
    (0.0, "clik", OK, "following a reference", ""),
    (0.1, "clik", OK, "following a reference", ""),  # not new
    (0.2, "fault_injector", WARN, "at work: drop on wrench", ""),
    (0.304, "clik", ERROR, HOLDING, "send the reference again"),
    (0.5, "clik", ERROR, HOLDING, "send the reference again"),
    (0.6, "fault_injector", OK, "no fault at work, 0 to come", ""),
    (0.7, "clik", OK, "following a reference", ""),
)
NEW = [STORY[0], STORY[2], STORY[3], STORY[5], STORY[6]]


def write_story(
    folder: Path,
    story: Sequence[Saying],
    namespace: str = "",
    late: str = "",
    lasting: float = 0.0,
) -> Path:
    """Write a run in which nodes said something, one of them came late; return its folder."""
    measured = [0.01 * k for k in range(STATES)]
    plain = write_run(folder / "plain", measured, lasting=lasting)
    sayings = []
    for t, name, level, message, remedy in story:
        keys = remedy if isinstance(remedy, dict) else {"remedy": remedy}
        values = [KeyValue(key=key, value=value) for key, value in keys.items()]
        status = DiagnosticStatus(
            name=namespace + name, level=level, message=message, values=values
        )
        data = bytes(serialize_message(DiagnosticArray(status=[status])))
        sent = START + round(t * 1e9)
        sayings.append(("/diagnostics", sent + LATE_NS * (name == late), sent, data))
    others = [(m.topic, m.log_time, m.publish_time, m.data) for m in Bag(plain).read_raw()]
    with BagWriter(folder / "run") as bag:
        for topic, info in Bag(plain).topics.items():
            bag.add_topic(Topic(topic, info.type))
        bag.add_topic(Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"))
        for topic, came, sent, data in sorted([*others, *sayings], key=lambda one: one[1]):
            bag.write(topic, data, came, sent)
    return folder / "run"


def write_arms(folder: Path, arms: Sequence[str], nodes: Sequence[str]) -> Path:
    """Write a run of several arms, by their namespaces, in which each node said that it is here."""
    plain = write_run(folder / "plain", [0.0] * 30)
    with BagWriter(folder / "arms") as bag:
        bag.add_topic(Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"))
        for arm in arms:
            for name, info in Bag(plain).topics.items():
                bag.add_topic(Topic(arm + name, info.type))
        for m in Bag(plain).read_raw():
            for arm in arms:
                bag.write(arm + m.topic, m.data, m.log_time, m.publish_time)
        for name in nodes:
            status = DiagnosticStatus(name=name, level=OK, message="here")
            data = bytes(serialize_message(DiagnosticArray(status=[status])))
            bag.write("/diagnostics", data, START, START)
    return folder / "arms"


def told(story: Sequence[Saying]) -> list[tuple[object, ...]]:
    levels = {OK: "ok", WARN: "warning", ERROR: "error"}
    return [(pytest.approx(t), name, levels[level], *words) for t, name, level, *words in story]


def test_each_change_is_told_once_with_its_time_and_what_to_do(tmp_path: Path) -> None:
    run = load(write_story(tmp_path, STORY))
    assert list(run.reports) == told(NEW)
    assert list(Digest.of(run).reports) == told(NEW)


@pytest.mark.parametrize("size", [2, 7, 20, 30, 99])
@pytest.mark.parametrize("late", ["", "clik", "fault_injector"])
def test_in_parts_it_is_told_as_in_one(tmp_path: Path, size: int, late: str) -> None:
    digest = Digest.of_parts(blocks(write_story(tmp_path, STORY, late=late), size=size))
    assert list(digest.reports) == told(NEW)


def test_of_a_part_of_the_run_what_was_said_in_it_is_told(tmp_path: Path) -> None:
    path = write_story(tmp_path, STORY)
    for size in (0, 10):
        parts = blocks(path, Options(start=0.25, end=0.65), size=size)
        # and what was said last before it
        assert [one for part in parts for one in part.reports] == told(NEW[:4])
    (part,) = blocks(path, Options(start=0.65))
    assert list(part.reports) == told(NEW[2:])


def test_what_was_said_after_the_clock_jumped_back_is_left_out(tmp_path: Path) -> None:
    first = write_story(tmp_path / "1", STORY)
    with BagWriter(tmp_path / "run") as bag:
        for topic, info in Bag(first).topics.items():
            bag.add_topic(Topic(topic, info.type))
        for shift in (0, 2_000_000_000):  # the same stamps again
            for m in Bag(first).read_raw():
                bag.write(m.topic, m.data, m.log_time + shift, m.publish_time + shift)
    for size in (0, 30):
        digest = Digest.of_parts(blocks(tmp_path / "run", size=size))
        assert "jump back" in digest.warning
        assert list(digest.reports) == told(NEW)


def test_what_was_said_before_the_first_and_after_the_last_state_is_told(tmp_path: Path) -> None:
    before, after = (-0.5, "clik", OK, "waiting", ""), (2.5, "clik", WARN, "inactive", "")
    run = load(write_story(tmp_path, [before, *STORY, after]))
    assert list(run.reports) == told([before, *NEW, after])


def test_the_nodes_of_another_arm_are_not_told_and_those_of_none_are(tmp_path: Path) -> None:
    nodes = ("left/clik", "/left/tool/camera", "right/clik", "fault_injector")
    both = write_arms(tmp_path, ("/left", "/right"), nodes)
    for side, names in (
        ("/left", ["/left/tool/camera", "fault_injector", "left/clik"]),
        ("/right", ["fault_injector", "right/clik"]),
    ):
        run = load(both, namespace=side)
        assert sorted(report.node for report in run.reports) == names


def test_a_name_with_a_slash_before_it_is_told_in_a_bag_without_namespaces(tmp_path: Path) -> None:
    run = load(write_story(tmp_path, STORY[:1], "/"))
    assert [report.node for report in run.reports] == ["/clik"]


def test_of_what_flickers_the_first_and_the_last_are_told_and_all_errors_of_others(
    tmp_path: Path,
) -> None:
    count = 2 * _MOST + 30
    story = [(1e-3 * k, "clik", WARN, f"{k}", "") for k in range(count)]
    story.insert(_MOST + 10, (0.0605, "clik", ERROR, "the fault", ""))
    story.insert(_MOST + 20, (0.0705, "pybullet_bridge", ERROR, "braked", ""))
    for size in (0, 5):
        digest = Digest.of_parts(blocks(write_story(tmp_path / f"{size}", story), size=size))
        messages = [report.message for report in digest.reports if report.level == "warning"]
        assert messages == [f"{k}" for k in (*range(_MOST), *range(count - _MOST, count))]
        errors = [report.message for report in digest.reports if report.level == "error"]
        assert errors == ["the fault", "braked"]
        assert digest.reports_left_out == count - 2 * _MOST
    page = tmp_path / "page.html"
    write_page(page, [digest], "", "")
    assert "30 more are left out" in page.read_text(encoding="utf-8")


def test_texts_are_cut_to_a_length_and_printable(tmp_path: Path) -> None:
    story = [(0.1, "n" * 5000, WARN, "a\x1b\nb" + "x" * 1000, "y" * 1000)]
    (report,) = load(write_story(tmp_path, story)).reports
    for text in (report.node, report.message, report.remedy):
        assert len(text) == _LONGEST
        assert text.endswith(" ...")
    assert report.message.startswith("a  bx")


def test_a_remedy_that_changes_is_told_and_an_unknown_level_by_its_number(tmp_path: Path) -> None:
    story = [(0.1, "clik", WARN, "waits", remedy) for remedy in ("one", "two")]
    run = load(write_story(tmp_path / "1", story))
    assert [report.remedy for report in run.reports] == ["one", "two"]
    run = load(write_story(tmp_path / "2", [(0.1, "clik", b"\x07", "odd", "")]))
    assert [report.level for report in run.reports] == ["level 7"]


def test_the_page_tells_it_as_text(tmp_path: Path) -> None:
    digest = Digest.of(load(write_story(tmp_path, STORY)))
    page = tmp_path / "page.html"
    write_page(page, [digest], "", "")
    text = page.read_text(encoding="utf-8")
    row = text[text.index('<tr class="said-error">') :]
    row = row[: row.index("</tr>")]
    assert '<td class="number">0.304</td><td class="node">clik</td>' in row
    assert "holding still: &lt;b&gt;the arm&lt;/b&gt; is blocked" in row
    assert "send the reference again" in row
    assert text.count('<tr class="said-') == len(NEW)


def test_a_page_of_runs_without_reports_has_no_place_for_them(tmp_path: Path) -> None:
    digest = Digest.of(load(write_story(tmp_path, [])))
    page = tmp_path / "page.html"
    write_page(page, [digest], "", "")
    assert "Reports</h2>" not in page.read_text(encoding="utf-8")


SLOW = {"mode": "following", "pace": "0.98", "frozen": "0"}


@pytest.mark.parametrize("size", [0, 7])
@pytest.mark.parametrize("trajectory", [True, False])
@pytest.mark.parametrize(
    ("keys", "delays"),
    [
        (SLOW, True),
        (SLOW | {"pace": "1", "frozen": "1"}, True),
        (SLOW | {"pace": "1"}, False),
        (SLOW | {"mode": "holding"}, False),
        ({"mode": "following", "pace": "fast"}, False),  # of somebody else
    ],
)
def test_a_trajectory_that_comes_later_than_it_was_sent_to_be_is_a_warning_once(
    tmp_path: Path, size: int, keys: dict[str, str], delays: bool, trajectory: bool
) -> None:
    story = [*STORY[:2], (0.25, "clik", WARN, "slow", keys), STORY[-1], (0.9, *STORY[-1][1:])]
    story.insert(-1, (0.8, "clik", WARN, "slow", keys))
    path = write_story(tmp_path, story, lasting=0.5 if trajectory else 0.0)
    for start in (0.0, 0.5):  # it is late from then on
        digest = Digest.of_parts(blocks(path, Options(start=start), size=size))
        warns = delays and trajectory
        assert digest.warning.count("has to wait, first at 0.250 s") == warns
        assert ("wait" in digest.warning) == warns


@pytest.mark.parametrize(
    ("pace", "singularity", "words"),
    [
        (1.0, Nearness.CLEAR, ""),
        (0.9, Nearness.CLEAR, ""),  # it gets up to speed again
        (1.0, Nearness.LEAVING, "leaving a kinematic singularity"),
        (0.9, Nearness.INSIDE, "slowed down, inside a kinematic singularity"),
    ],
)
def test_a_motion_is_said_to_be_slowed_down_where_it_is(
    pace: float, singularity: Nearness, words: str
) -> None:
    at = SimpleNamespace(now=pace, singularity=singularity, limit=Nearness.CLEAR)
    controller: Any = SimpleNamespace(guidance=SimpleNamespace(pace=at))
    assert control_report._nearness(controller) == words


def test_what_is_said_after_the_last_state_delays_nothing(tmp_path: Path) -> None:
    path = write_story(tmp_path, [STORY[0], (2.5, "clik", WARN, "slow", SLOW)], lasting=0.5)
    assert "wait" not in load(path).warning


def test_of_an_arm_beside_one_without_a_namespace_what_its_nodes_say_is_told(
    tmp_path: Path,
) -> None:
    both = write_arms(tmp_path, ("", "/left"), ("left/clik", "clik"))
    for side, name in (("", "clik"), ("/left", "left/clik")):
        run = load(both, namespace=side)
        assert [report.node for report in run.reports] == [name]
