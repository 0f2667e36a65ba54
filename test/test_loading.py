"""From bags to recordings: the time that is looked at, references, and what is left out."""

import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import synthetic_runs as runs
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from eulerparams_control.analysis import loading
from eulerparams_control.analysis.loading import DesiredFrames, load
from eulerparams_control.analysis.series import Frames
from eulerparams_control.analysis.topics import NO_START, RecordedReferences
from eulerparams_control.bags import Bag, BagWriter
from eulerparams_control.bags.columns import columns
from eulerparams_control.bags.format import Topic
from eulerparams_control.bags.reader import RawMessage
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.laws.rotations import exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.shaper import Shaper
from eulerparams_control.motion.trajectories import Trajectory

LONG = [0.5 * math.sin(0.05 * k) for k in range(400)]
NODE = {"orientation": "euler_parameters", "k_Po": 10.0, "quaternion_sign": "continuous"}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("long") / "run"
    wrenches = [[k, 0.0, 1.0, 0.0, 0.0, 0.1] for k in range(400)]
    compliant = [DesiredFrame(np.array([1.0, 0.0, 1e-4 * k]), np.eye(3)) for k in range(400)]
    return runs.write_run(
        folder, LONG, LONG, lasting=1.0, wrenches=wrenches, compliant=compliant, parameters=NODE
    )


def test_only_the_time_that_is_asked_for_is_looked_at(bag):
    run, whole = load(bag, start=1.0, end=2.0), load(bag)
    assert run.measured.t[[0, -1]].tolist() == [1.0, 2.0]
    assert run.compliant is not None
    assert run.compliant.t[[0, -1]].tolist() == [1.0, 2.0]
    np.testing.assert_array_equal(run.leading.desired.p, whole.leading.desired.p[100:201])
    with pytest.raises(BagError, match="no joint_states from 9 to 10 s"):
        load(bag, start=9.0, end=10.0)


def test_a_bag_is_read_no_farther_than_to_the_end_that_is_asked_for(tmp_path):
    bag = runs.write_run(tmp_path / "run", [0.1] * 9000 + [math.nan])
    assert "1 messages of joint_states are not valid" in load(bag).warning
    assert load(bag, end=1.0).warning == ""


def _references(
    sent: Sequence[int], motions: Sequence[SetPoint | Trajectory], starts: Sequence[int | None]
) -> RecordedReferences:
    frames = Frames.of([motion.frames[0] for motion in motions])
    found = {k: motion for k, motion in enumerate(motions) if isinstance(motion, Trajectory)}
    begin = np.array([NO_START if start is None else start for start in starts], dtype=int)
    return RecordedReferences(np.array(sent), begin, frames, found)


def _frame(seed: int) -> DesiredFrame:
    rng = np.random.default_rng(seed)
    R = exp(rng.normal(size=3))
    return DesiredFrame(rng.normal(size=3), R, *rng.normal(size=(4, 3)))


HELD = _frame(0).at_rest()

LATER = (None, None, None, 205_000_000, 250_000_001, None, 700_000_000)
"""Starts [ns] of some references: after they were sent, before, and after the next was sent."""


@pytest.mark.parametrize("starts", [(None,) * 7, LATER])
def test_references_are_followed_as_controllers_follow_them(starts):
    """Set-points, trajectories at once and later, and set-points again."""
    lasting, period = 0.05, 10_000_000
    sent = [-5, 25_000_000, 25_000_001, 55_000_000, 300_000_000, 620_000_000, 640_000_000]
    motions: list[SetPoint | Trajectory] = [
        Trajectory([0.1, 0.2], [_frame(1), _frame(12)]),  # from where it is held
        SetPoint(_frame(2), lasting),  # replaced before a tick
        SetPoint(_frame(3), lasting),
        Trajectory([0.1, 0.3], [_frame(4), _frame(5)]),
        Trajectory([0.0, 0.2, 0.4], [_frame(6), _frame(7), _frame(8)]),
        SetPoint(_frame(9), lasting),
        Trajectory([0.2, 0.3], [_frame(10), _frame(11)]),
    ]
    ticks = np.arange(100) * period + 1
    expected, motion, pending = [], None, list(zip(sent, motions, starts, strict=True))
    for tick in ticks.tolist():
        while pending and pending[0][0] <= tick:
            _, new, start = pending.pop(0)
            motion = motion or Shaper(HELD)
            motion.follow(new, start)
        expected.append(motion.sample(tick) if motion else None)
    references = _references(sent, motions, starts)
    desired = DesiredFrames(references, ticks, ticks, lasting, lambda stamp: HELD)
    for one, other in zip(desired.at(ticks).columns, Frames.of(expected).columns, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)


def _joint_state(names: Sequence[str], q: Sequence[float], stamp: int) -> bytes:
    message = JointState(name=list(names), position=list(q), velocity=[0.0] * len(q))
    message.header.stamp.sec = stamp
    return bytes(serialize_message(message))


def _schema(tmp_path: Path, kind: str) -> Bag:
    with BagWriter(tmp_path / "types") as writer:
        writer.add_topic(Topic("/t", kind))
        writer.write("/t", bytes(serialize_message(JointState())), 1, 1)
    return Bag(tmp_path / "types")


def test_messages_of_several_layouts_become_columns(tmp_path):
    schema = _schema(tmp_path, "sensor_msgs/msg/JointState").schema("/t")
    messages = [
        _joint_state(["a", "b"], [1.0, 2.0], 1),
        _joint_state(["b", "a"], [4.0, 3.0], 2),
        _joint_state(["a", "b"], [5.0, 6.0], 3),
        _joint_state(["long", "b", "c"], [7.0, 8.0, 9.0], 4),
        _joint_state([], [], 5),
        b"\0\1\0\0\1\2",
        b"",
        _joint_state(["a", "b"], [1.0, 2.0], 6)[:-9],
    ]
    messages[2] = messages[2][:17] + b"\4\5\6" + messages[2][20:]  # what pads a message is any
    found = {tuple(g.index.tolist()): g for g in columns(schema, messages)}
    assert sorted(found) == [(0, 2), (1,), (3,), (4,)]
    assert found[0, 2].numbers["position"].tolist() == [[1.0, 2.0], [5.0, 6.0]]
    assert found[0, 2].numbers["header.stamp.sec"].tolist() == [1, 3]
    assert found[(1,)].texts["name"] == ["b", "a"]
    assert found[(3,)].texts["name"] == ["long", "b", "c"]
    assert found[(4,)].numbers["position"].shape == (1, 0)


def test_topics_may_have_other_names(tmp_path):
    source = Bag(runs.write_run(tmp_path / "source", [0.1] * 5, desired=False))
    topics = {"/arm/measured": "sensor_msgs/msg/JointState", "/chatter": "std_msgs/msg/String"}
    states = [m._replace(topic="/arm/measured") for m in source.read_raw(["/joint_states"])]
    bag = runs.write_messages(tmp_path / "run", topics, states)
    options = {"urdf": runs.URDF, "tip_frame": "tip"}
    run = load(bag, names={"joint_states": "/arm/measured"}, **options)
    assert run.measured.q[:, 0].tolist() == [0.1] * 5
    with pytest.raises(BagError, match="--topic joint_states:=/NAME"):
        load(bag, **options)
    with pytest.raises(UnknownNameError, match="/arm/measured"):
        load(bag, names={"joint_states": "/arm/measurd"}, **options)
    with pytest.raises(BagError, match="is std_msgs/msg/String; expected"):
        load(bag, names={"joint_states": "/chatter"}, **options)


def test_messages_that_are_not_valid_are_left_out_and_counted(tmp_path):
    q = [0.1, math.nan, 0.3, math.inf, 0.5]
    run = runs.recorded(tmp_path / "run", q)
    assert run.measured.q[:, 0].tolist() == [0.1, 0.3, 0.5]
    assert "2 messages of joint_states are not valid and left out" in run.warning


# --- what is wrong with a bag is said -----------------------------------------------------
def _shifted(message: RawMessage, dt: int) -> RawMessage:
    """Return a message with a header, its stamp moved by dt [ns]."""
    sec, nanosec = struct.unpack_from("<iI", message.data, 4)
    stamp = max(0, sec * 10**9 + nanosec + dt)
    head = struct.pack("<iI", *divmod(stamp, 10**9))
    return message._replace(data=message.data[:4] + head + message.data[12:])


def _changed(folder: Path, topic: str, change: Any, q: Any = (0.1,) * 30, **options: Any) -> Path:
    """Return a run of which the messages of a topic are changed, see ``rewritten``."""
    source = runs.write_run(folder / "source", q, **options)
    return runs.rewritten(source, folder / "run", change, topic=topic)


def test_where_the_clock_jumps_back_the_run_ends_and_it_is_said(tmp_path):
    """A simulator that restarts after 1 s sends earlier stamps again, the wrench first."""
    sent: dict[str, int] = {}

    def restart(message: RawMessage) -> RawMessage:
        sent[message.topic] = k = sent.get(message.topic, -1) + 1
        if k >= 100 and message.topic in ("/joint_states", "/wrench"):
            message = _shifted(message, -1_005_000_000)
        if message.topic == "/wrench":
            early = {name: getattr(message, name) - 1000 for name in ("log_time", "publish_time")}
            message = message._replace(**early)
        return message

    q, wrenches = [0.1] * 100 + [1.0] * 100, [[k] * 6 for k in range(200)]
    source = runs.write_run(tmp_path / "source", q, wrenches=wrenches)
    messages = map(restart, Bag(source).read_raw())
    run = load(runs.write_messages(tmp_path / "run", runs.topics_of(source), list(messages)))
    assert run.sensed is not None
    assert len(run.measured.t) == 100
    assert run.sensed.t.min() == 0.0
    assert run.leading.orientation_error.max() == pytest.approx(0.1)
    assert "stamps of joint_states jump back at 0.990 s: the rest is left out" in run.warning


def test_samples_without_stamps_are_counted(tmp_path):
    never = -1_800_000_000_000_000_000
    q = [0.01 * k for k in range(30)]
    run = _changed(tmp_path, "/joint_states", lambda message, _k: _shifted(message, never), q)
    assert "29 messages of joint_states have the stamp of another" in load(run).warning


def test_what_came_before_the_first_state_counts(tmp_path):
    """The observer of the energy of a contact begins with the first wrench."""
    late = _changed(
        tmp_path, "/joint_states", lambda m, k: m if k else None, wrenches=[[1] * 6] * 30
    )
    run = load(late)
    assert run.sensed is not None
    assert run.sensed.t[:2].tolist() == [-0.01, 0.0]


def test_a_state_that_is_sent_again_is_no_loss(tmp_path):
    q = [0.01 * k for k in range(50)]
    source = runs.write_run(tmp_path / "source", q)
    twice = [message for message in Bag(source).read_raw() for _ in range(2)]
    run = load(runs.write_messages(tmp_path / "run", runs.topics_of(source), twice))
    assert run.warning == ""
    assert run.measured.q[:, 0].tolist() == q


def test_the_measured_motion_has_a_desired_frame_after_the_controller_died(tmp_path):
    q = [0.0] * 100 + [0.02 * k for k in range(100)]
    options = {"q": q, "command": [0.0] * 200}
    early = _changed(tmp_path, "/joint_reference", lambda m, k: m if k < 100 else None, **options)
    run = load(early)
    assert run.measured.orientation_error[-1] == pytest.approx(q[-1])
    assert run.command is not None
    assert run.command.t[-1] == 0.99
    assert "joint_reference ends at 0.990 s, joint_states at 1.990 s" in run.warning


@pytest.mark.parametrize("velocity", [[], [math.nan] * 2])
def test_velocities_that_are_missing_are_differences(tmp_path, velocity):
    messages = []
    for k in range(50):
        message = JointState(name=["hinge", "roll"], position=[0.02 * k, 0.0], velocity=velocity)
        message.header.stamp.sec, message.header.stamp.nanosec = 5, k * 10_000_000
        messages.append(RawMessage("/joint_states", k, k, bytes(serialize_message(message))))
    topics = {"/joint_states": "sensor_msgs/msg/JointState"}
    bag = runs.write_messages(tmp_path / "run", topics, messages)
    run = load(bag, urdf=runs.URDF, tip_frame="tip")
    np.testing.assert_allclose(run.measured.dq[:, 0], 2.0, rtol=1e-6)
    assert "joint_states lacks velocities" in run.warning


@pytest.mark.parametrize("block", [37, 20_000])
@pytest.mark.parametrize("start", [0.55, 1.0, 3.49])
def test_the_sign_of_the_quaternion_is_that_from_the_start(tmp_path, start, block, monkeypatch):
    """Turned beyond pi, with the sign that never flips, eta is negative: V_1 > 2."""
    monkeypatch.setattr(loading, "_BLOCK", block)
    q = [0.011 * k for k in range(400)]
    node = NODE | {"quaternion_sign": "continuous"}
    path = runs.write_run(tmp_path / "run", q, q, parameters=node)
    whole = load(path).lyapunov
    assert whole is not None
    late = load(path, start=start).lyapunov
    assert late is not None
    np.testing.assert_allclose(late.V, whole.V[whole.t >= start], rtol=1e-12)
    assert late.V.max() > 2.5


def test_the_news_of_one_arm_do_not_move_the_reference_of_the_other(tmp_path):
    arms = {}
    for side, began in (("/left", None), ("/right", 5 * runs.PERIOD_NS)):
        options = {"lasting": 0.1, "began": began, "node": f"{side}/clik"}
        arms[side] = runs.write_run(tmp_path / side[1:], [0.0] * 30, **options)
    both = runs.arms_together(tmp_path / "both", arms)
    left, right = (load(both, namespace=side) for side in arms)
    assert left.measured.desired.p[5, 2] > 0.4 * runs.DISTANCE
    assert right.measured.desired.p[5, 2] == 0.0
    assert right.measured.desired.p[20, 2] == pytest.approx(runs.DISTANCE)


@pytest.mark.parametrize(
    "wrong",
    [
        {"hysteresis": None}, {"hysteresis": [1]}, {"hysteresis": math.nan},
        {"quaternion_initial_sign": "x"}, {"euler_sequence": "QQQ"}, {"quaternion_sign": "foo"},
        *({"reference_timeout": timeout} for timeout in ("abc", [1], math.nan, -1.0)),
    ],
)  # fmt: skip
def test_parameters_that_are_not_valid_leave_the_rest(tmp_path, wrong):
    run = runs.recorded(tmp_path / "run", [0.1] * 5, parameters=NODE | wrong)
    assert run.leading.orientation_error.tolist() == pytest.approx([0.1] * 5)
    told = "the parameters of the controller are not valid" in run.warning
    assert told == ("reference_timeout" not in wrong)  # which has a default
    assert len(run.pole_distance) == 5


def test_before_the_first_wrench_there_is_none(tmp_path):
    wrenches = [[50.0, 0, 0, 0, 0, 0]] * 30
    bag = _changed(tmp_path, "/wrench", lambda m, k: m if k > 9 else None, wrenches=wrenches)
    run = load(bag)
    assert run.wrench is not None
    f, _ = run.wrench.at(run.measured.t)
    assert np.isnan(f[:10]).all()
    assert f[10:, 0].tolist() == pytest.approx([50.0 * math.cos(0.1)] * 20)
