"""What nodes said on /diagnostics is told with a recording, at the time when they said it."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message
from synthetic_runs import _START as START
from synthetic_runs import PERIOD_NS, write_run

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.loading import Options, blocks
from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.reports import _LONGEST, _MOST
from eulerparams_control.bags import Bag, BagWriter
from eulerparams_control.bags.format import Topic

OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"
STATES = 100  # of a run, one every 10 ms
HOLDING = "holding still: <b>the arm</b> is blocked"

type Saying = tuple[float, str, bytes, str, str]
"""When [s] a node says what, with which level, and what to do."""

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


def write_story(folder: Path, story: Sequence[Saying], namespace: str = "") -> Path:
    """Write a run in which nodes said something; return its folder."""
    plain = write_run(folder / "plain", [0.01 * k for k in range(STATES)])
    sayings = []
    for t, name, level, message, remedy in story:
        values = [KeyValue(key="what to do", value=remedy)] if remedy else []
        status = DiagnosticStatus(
            name=namespace + name, level=level, message=message, values=values
        )
        data = bytes(serialize_message(DiagnosticArray(status=[status])))
        sayings.append(("/diagnostics", START + round(t * 1e9), data))
    others = [(m.topic, m.log_time, m.data) for m in Bag(plain).read_raw()]
    with BagWriter(folder / "run") as bag:
        for topic, info in Bag(plain).topics.items():
            bag.add_topic(Topic(topic, info.type))
        bag.add_topic(Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"))
        for topic, at, data in sorted([*others, *sayings], key=lambda one: one[1]):
            bag.write(topic, data, at, at)
    return folder / "run"


def told(story: Sequence[Saying]) -> list[tuple[object, ...]]:
    levels = {OK: "ok", WARN: "warning", ERROR: "error"}
    return [(pytest.approx(t), name, levels[level], *words) for t, name, level, *words in story]


def test_each_change_is_told_once_with_its_time_and_what_to_do(tmp_path: Path) -> None:
    run = Recording.load(write_story(tmp_path, STORY))
    assert list(run.reports) == told(NEW)
    assert list(Digest.of(run).reports) == told(NEW)


@pytest.mark.parametrize("size", [2, 7, 30, 99])
def test_in_parts_it_is_told_as_in_one(tmp_path: Path, size: int) -> None:
    digest = Digest.of_parts(blocks(write_story(tmp_path, STORY), size=size))
    assert list(digest.reports) == told(NEW)


def test_of_a_part_of_the_run_what_was_said_in_it_is_told(tmp_path: Path) -> None:
    path = write_story(tmp_path, STORY)
    (part,) = blocks(path, Options(start=0.25, end=0.65))
    assert list(part.reports) == told(NEW[2:4])


def test_what_was_said_before_the_first_and_after_the_last_state_is_told(tmp_path: Path) -> None:
    before, after = (-0.5, "clik", OK, "waiting", ""), (2.5, "clik", WARN, "inactive", "")
    run = Recording.load(write_story(tmp_path, [before, *STORY, after]))
    assert list(run.reports) == told([before, *NEW, after])


def test_the_nodes_of_another_arm_are_not_told(tmp_path: Path) -> None:
    assert not Recording.load(write_story(tmp_path, STORY, "right/")).reports


def test_what_flickers_is_told_up_to_a_number_and_texts_to_a_length(tmp_path: Path) -> None:
    story = [(1e-3 * k, "clik", WARN, f"{k} {'x' * 1000}", "") for k in range(_MOST + 50)]
    reports = Recording.load(write_story(tmp_path, story)).reports
    assert len(reports) == _MOST
    assert all(len(report.message) == _LONGEST for report in reports)


def test_the_page_tells_it_as_text(tmp_path: Path) -> None:
    digest = Digest.of(Recording.load(write_story(tmp_path, STORY)))
    page = tmp_path / "page.html"
    write_page(page, [digest], "", "")
    text = page.read_text(encoding="utf-8")
    row = text[text.index('<tr class="said-error">') :]
    row = row[: row.index("</tr>")]
    assert '<td class="number">0.304</td><td>clik</td>' in row
    assert "holding still: &lt;b&gt;the arm&lt;/b&gt; is blocked" in row
    assert "send the reference again" in row
    assert text.count('<tr class="said-') == len(NEW)


def test_a_page_of_runs_without_reports_has_no_place_for_them(tmp_path: Path) -> None:
    digest = Digest.of(Recording.load(write_story(tmp_path, [])))
    page = tmp_path / "page.html"
    write_page(page, [digest], "", "")
    assert "Reports</h2>" not in page.read_text(encoding="utf-8")
    assert STATES * PERIOD_NS == 1e9  # the story is within the run
