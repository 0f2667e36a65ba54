"""Messages on /diagnostics are told with a recording, at the time when they came."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message
from synthetic_runs import _START as START
from synthetic_runs import (
    DISTANCE,
    PERIOD_NS,
    arms_together,
    rewritten,
    topics_of,
    write_messages,
    write_run,
)

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.quantities import measure
from eulerparams_control.bags import Bag
from eulerparams_control.bags.format import BagFlaw
from eulerparams_control.bags.reader import RawMessage
from eulerparams_control.messages.keys import PACE, SATURATED, SLOWED
from eulerparams_control.messages.to_ros import motion_to_ros, stamp_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory

OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"
STATES = 100  # of a run, one every 10 ms
HOLDING = "holding still: <b>the arm</b> is blocked"

LATE = 0.06  # [s] by which messages of one node overtake those of another

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


def saying(
    t: float, name: str, level: bytes, message: str, keys: dict[str, str], late: float = 0.0
) -> RawMessage:
    """Return what a node says at t [s], which comes so much later [s]."""
    values = [KeyValue(key=key, value=value) for key, value in keys.items()]
    status = DiagnosticStatus(name=name, level=level, message=message, values=values)
    sent = START + round(t * 1e9)
    data = bytes(serialize_message(DiagnosticArray(status=[status])))
    return RawMessage("/diagnostics", sent + round(late * 1e9), sent, data)


def write_story(
    folder: Path, story: Sequence[Saying], late: str = "", lasting: float = 0.0
) -> Path:
    plain = write_run(folder / "plain", [0.01 * k for k in range(STATES)], lasting=lasting)
    messages = list(Bag(plain).read_raw())
    for t, name, level, message, remedy in story:
        keys = remedy if isinstance(remedy, dict) else {"remedy": remedy}
        messages.append(saying(t, name, level, message, keys, LATE * (name == late)))
    messages.sort(key=lambda one: one.log_time)
    return write_messages(folder / "run", topics_of(plain), messages)


def told(story: Sequence[Saying]) -> list[tuple[object, ...]]:
    levels = {OK: "ok", WARN: "warning", ERROR: "error"}
    return [(pytest.approx(t), name, levels[level], *words, "") for t, name, level, *words in story]


def stopping(mode: str, cause: str) -> dict[str, str]:
    return {"mode": mode, "cause": cause}


def test_the_first_fault_of_each_node_that_stopped_the_arm_is_the_first_warning(tmp_path):
    story: list[Saying] = [
        (0.1, "clik", ERROR, "halted", stopping("stopped", "halt")),
        (0.2, "pybullet_bridge", ERROR, "protective stop", stopping("stopping", "acceleration")),
        (0.3, "clik", ERROR, "it is blocked", stopping("stopped", "not_following")),
        (0.4, "clik", ERROR, "it is at a pole", stopping("stopped", "singularity")),
        (0.5, "watchdog", WARN, "braking", stopping("braking", "silence")),
        (0.6, "clik", OK, "following a reference", stopping("following", "")),
        (0.9, "clik", ERROR, "no states", stopping("stopped", "no_states")),
    ]
    stops = [
        "pybullet_bridge stopped the arm at 0.200 s: acceleration",
        "clik stopped the arm at 0.300 s: not_following",
    ]
    run = load(write_story(tmp_path, story))
    found = [warning for warning in run.warnings if warning.kind is BagFlaw.STOPPED]
    assert [warning.text for warning in found] == stops
    assert run.warning.startswith("; ".join(stops))


def test_what_an_arm_does_after_it_was_stopped_counts_from_there(tmp_path):
    q = [0.001 * min(k, 60) for k in range(STATES)]  # at rest from 0.6 s on
    speeds = [0.1 * (k < 60) for k in range(STATES)]
    plain = write_run(tmp_path / "plain", q, speeds=speeds)
    assert measure("stop_way", load(plain)) == np.inf
    halted = saying(0.3, "clik", ERROR, "halted", stopping("stopped", "halt"))
    blocked = saying(0.5, "clik", ERROR, "blocked", stopping("stopped", "not_following"))
    messages = sorted([*Bag(plain).read_raw(), halted, blocked], key=lambda one: one.log_time)
    run = load(write_messages(tmp_path / "run", topics_of(plain), messages))
    assert run.stopped == pytest.approx(0.3)
    assert measure("stop_time", run) == run.stopped
    assert measure("stop_time", run, cause="not_following") == pytest.approx(0.5)
    assert measure("stop_time", run, cause="runaway") == np.inf
    chord = 1e3 * np.linalg.norm(run.measured.p_e[60] - run.measured.p_e[30])
    assert measure("stop_way", run) == pytest.approx(chord)
    assert measure("stop_way", run, lasting=0.1) < chord / 2
    assert measure("stop_joint_speed", run) == pytest.approx(0.1)
    assert measure("stop_joint_speed", run, since=0.35) == 0.0
    assert measure("stop_speed_ratio", run) == pytest.approx(1.0)
    assert measure("stop_tip_speed", run, since=0.35) == 0.0


@pytest.mark.parametrize("late", ["", "clik", "fault_injector"])
def test_each_change_is_told_once_with_its_time_and_what_to_do(tmp_path, late):
    digest = Digest.of(load(write_story(tmp_path, STORY, late=late)))
    assert list(digest.reports) == told(NEW)


@pytest.mark.parametrize(
    ("said", "told_of"),
    [
        (
            ("left/clik", "/left/tool/camera", "right/clik", "fault_injector"),
            {
                "/left": ["/left/tool/camera", "fault_injector", "left/clik"],
                "/right": ["fault_injector", "right/clik"],
            },
        ),
        (("left/clik", "clik"), {"": ["clik"], "/left": ["left/clik"]}),
        (("/clik",), {"": ["/clik"]}),
    ],
)
def test_the_nodes_of_another_arm_are_not_told_and_those_of_none_are(tmp_path, said, told_of):
    plain = write_run(tmp_path / "plain", [0.0] * 30)
    sayings = [saying(0.0, name, OK, "here", {}) for name in said]
    bag = arms_together(tmp_path / "arms", dict.fromkeys(told_of, plain), sayings)
    for side, names in told_of.items():
        run = load(bag, namespace=side)
        assert sorted(report.node for report in run.reports) == names


def page_of(folder: Path, story: Sequence[Saying]) -> str:
    write_page(folder / "page.html", [Digest.of(load(write_story(folder, story)))], "", "")
    return (folder / "page.html").read_text(encoding="utf-8")


def test_the_page_tells_it_as_text_if_there_is_anything(tmp_path):
    text = page_of(tmp_path / "story", STORY)
    row = text[text.index('<tr class="said-error">') :]
    row = row[: row.index("</tr>")]
    assert '<td class="number">0.304</td><td class="node">clik</td>' in row
    assert "holding still: &lt;b&gt;the arm&lt;/b&gt; is blocked" in row
    assert "send the reference again" in row
    assert text.count('<tr class="said-') == len(NEW)
    assert "Reports</h2>" in text
    assert "Reports</h2>" not in page_of(tmp_path / "nothing", [])


SLOW = {"mode": "following", "pace": "0.98", "frozen": "0"}


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
    tmp_path, keys, delays, trajectory
):
    story = [*STORY[:2], (0.25, "clik", WARN, "slow", keys), STORY[-1], (0.9, *STORY[-1][1:])]
    story.insert(-1, (0.8, "clik", WARN, "slow", keys))
    path = write_story(tmp_path, story, lasting=0.5 if trajectory else 0.0)
    for start in (0.0, 0.5):  # it is late from then on
        run = load(path, start=start)
        warns = delays and trajectory
        assert run.warning.count("has to wait, first at 0.250 s") == warns
        assert ("wait" in run.warning) == warns


# --- what was made of a reference ------------------------------------------------------------
TARGETS = {
    "/target_pose": "geometry_msgs/msg/PoseStamped",
    "/target_twist": "geometry_msgs/msg/TwistStamped",
}


def write_made(
    folder: Path,
    rate: float,
    size: float,
    of: Sequence[str] = ("clik",),
    targets: Sequence[RawMessage] = (),
) -> Path:
    """Write a run that was asked to move by ``DISTANCE``, and moved by a part of it, slower."""
    plain = write_run(folder / "plain", [0.0] * STATES, lasting=0.4)
    messages = [*Bag(plain).read_raw(), *targets]
    keys = {"mode": "following", PACE: "1", SLOWED: f"{rate}", SATURATED: "7"}
    messages += [saying(t, "clik", OK, "following", keys) for t in (0.2, 0.7)]
    motion = Trajectory(
        [0.0, 0.4 / rate],
        [DesiredFrame(np.array([1.0, 0.0, z]), np.eye(3)) for z in (0.0, size * DISTANCE)],
    )
    for name in of:
        for k in range(0, STATES - 60, 2):  # then a fault, that ends it
            frame, stamp = motion.sample(0.01 * k), START + k * PERIOD_NS
            msg = motion_to_ros(Trajectory([0.0], [frame]), "base", "tip")
            msg.header.stamp = stamp_to_ros(stamp)
            messages.append(RawMessage(f"/{name}/desired", stamp, stamp, serialize_message(msg)))
    messages.sort(key=lambda one: one.log_time)
    kind = topics_of(plain)["/reference"]
    topics = topics_of(plain) | {f"/{name}/desired": kind for name in of} | TARGETS
    return write_messages(folder / "run", topics, messages)


@pytest.mark.parametrize(
    ("rate", "part", "words"),
    [
        (1.0, 1.0, None),  # to the bit: no warning
        (0.5, 1.0, ", with time at 50 % at the slowest"),
        (1.0, 0.5, ""),
    ],
)
def test_what_was_made_of_a_reference_is_compared_with_it(tmp_path, rate, part, words):
    digest = Digest.of(load(write_made(tmp_path, rate, part)))
    assert [one.kind for one in digest.warnings] == [BagFlaw.SHAPED] * (words is not None)
    if words is not None:
        s = np.arange(0.0, 1.0, 0.05)  # so much of its time had gone by at the samples

        def gone(s: np.ndarray) -> np.ndarray:
            return 10 * s**3 - 15 * s**4 + 6 * s**5

        away = 1e3 * DISTANCE * np.abs(gone(s) - part * gone(rate * s)).max()
        found = f"differ from what was asked, by {away:.3g} mm at most{words}: errors here"
        assert found in digest.warning
    fastest = DISTANCE / 0.4 * 15 / 8  # of a quintic from rest to rest
    (asked,), (made,) = digest.curves["asked_speed"], digest.curves["tip_speed"]
    assert asked.y.max() == pytest.approx(fastest)
    here = made.y[np.abs(made.t - 0.2).argmin()]
    at = min(0.2 * rate / 0.4, 1.0)
    assert here == pytest.approx(fastest * rate * part * 16 * (at * (1 - at)) ** 2)
    for name, value in (("pace", 1.0), ("slowed", rate), ("saturation", 7.0)):
        (curve,) = digest.curves[name]
        assert (curve.t[0], set(curve.y.tolist())) == (pytest.approx(0.2), {value})


def test_without_a_reference_errors_are_those_against_what_was_made(tmp_path):
    made = write_made(tmp_path, 1.0, 0.5)
    bag = rewritten(made, tmp_path / "other", lambda *_: None, topic="/reference")
    digest = Digest.of(load(bag, tip_frame="tip"))
    assert [one.kind for one in digest.warnings] == [BagFlaw.INCOMPLETE]
    assert "errors are those against ~/desired" in digest.warning
    (error,) = digest.curves["position_error"]
    assert np.nanmax(error.y) == pytest.approx(1e3 * DISTANCE / 2, rel=0.01)  # near its end
    assert "tip_speed" in digest.curves
    assert "asked_speed" not in digest.curves  # nobody knows


@pytest.mark.parametrize("sent", [(), ("/target_pose",), tuple(TARGETS)])
def test_targets_that_led_the_arm_besides_the_reference_are_named(tmp_path, sent):
    data = bytes(serialize_message(PoseStamped()))
    targets = [RawMessage(topic, START, START, data) for topic in sent]
    digest = Digest.of(load(write_made(tmp_path, 0.5, 1.0, targets=targets)))
    words = f"; {' and '.join(sent)} led the arm, too, but do not count here" if sent else ""
    assert digest.warning.count("led the arm") == bool(sent)
    assert words in digest.warning
