"""Bags are read in parts of bounded memory, and the parts are the whole."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from synthetic_runs import URDF, write_run

from eulerparams_control.analysis.desired import NO_START, DesiredFrames, References
from eulerparams_control.analysis.frames import Frames
from eulerparams_control.analysis.loading import Options, blocks
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.bags import Bag, BagWriter
from eulerparams_control.bags.columns import columns
from eulerparams_control.bags.format import Topic
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.motion import DesiredFrame, DesiredMotion, SetPoint, Trajectory
from eulerparams_control.rotations import exp

LONG = [0.5 * math.sin(0.05 * k) for k in range(400)]
NODE = {"orientation": "euler_parameters", "k_Po": 10.0, "quaternion_sign": "continuous"}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("long") / "run"
    wrenches = [[k, 0.0, 1.0, 0.0, 0.0, 0.1] for k in range(400)]
    compliant = [DesiredFrame(np.array([1.0, 0.0, 1e-4 * k]), np.eye(3)) for k in range(400)]
    return write_run(
        folder, LONG, LONG, lasting=1.0, wrenches=wrenches, compliant=compliant, parameters=NODE
    )


@pytest.mark.parametrize("size", [1, 7, 50, 399, 400, 1000])
def test_the_parts_of_a_run_are_the_run(bag: Path, size: int) -> None:
    whole, parts = Recording.load(bag), list(blocks(bag, size=max(size, 2)))
    assert len(parts) > 1 or size > 350
    for part, after in itertools.pairwise(parts):
        assert part.measured.t[-1] == after.measured.t[0]  # they share a sample
    for of in (
        lambda run: (run.measured.t, run.measured.q),
        lambda run: (run.leading.t, run.leading.desired.p),
        lambda run: (run.compliant.t, run.compliant.frames.p),
        lambda run: (run.compliant.t, run.compliant.desired.R),
        lambda run: (run.leading.t[run.known], run.displacements("euler_parameters").error),
        lambda run: (run.wrench.t, run.wrench.f),
    ):
        pieces: dict[float, np.ndarray] = {}
        for part in parts:
            pieces |= dict(zip(of(part)[0].tolist(), of(part)[1], strict=True))
        t, values = of(whole)
        assert sorted(pieces) == t.tolist()
        np.testing.assert_array_equal([pieces[instant] for instant in t.tolist()], values)


def test_only_the_time_that_is_asked_for_is_looked_at(bag: Path) -> None:
    run, whole = Recording.load(bag, start=1.0, end=2.0), Recording.load(bag)
    assert run.measured.t[[0, -1]].tolist() == [1.0, 2.0]
    assert run.compliant is not None
    assert run.compliant.t[[0, -1]].tolist() == [1.0, 2.0]
    np.testing.assert_array_equal(run.leading.desired.p, whole.leading.desired.p[100:201])
    parts = list(blocks(bag, Options(start=1.0, end=2.0), size=30))
    assert parts[0].measured.t[0] == 1.0
    assert parts[-1].measured.t[-1] == 2.0
    with pytest.raises(BagError, match="no joint_states from 9 to 10 s"):
        Recording.load(bag, start=9.0, end=10.0)


def _references(sent: Sequence[int], motions: Sequence[SetPoint | Trajectory]) -> References:
    frames = Frames.of([motion.frames[0] for motion in motions])
    found = {k: motion for k, motion in enumerate(motions) if isinstance(motion, Trajectory)}
    return References(np.array(sent), np.full(len(sent), NO_START), frames, found)


def _frame(seed: int) -> DesiredFrame:
    rng = np.random.default_rng(seed)
    R = exp(rng.normal(size=3))
    return DesiredFrame(rng.normal(size=3), R, *rng.normal(size=(4, 3)))


HELD = _frame(0).at_rest()


@pytest.mark.parametrize("split", [0, 37, 61, 100])
def test_references_are_followed_as_the_controllers_follow_them(split: int) -> None:
    """Set-points, trajectories at once and later, and set-points again; in one part and in two."""
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
    expected, motion, pending = [], None, list(zip(sent, motions, strict=True))
    for tick in ticks.tolist():
        while pending and pending[0][0] <= tick:
            new = pending.pop(0)[1]
            motion = motion or DesiredMotion(HELD)
            motion.follow(new, None)
        expected.append(motion.sample(tick) if motion else None)
    desired, found, done = DesiredFrames(lasting, lambda stamp: HELD), [], 0
    for part in (ticks[:split], ticks[split:]):
        left = _references(sent[done:], motions[done:])
        frames, finished = desired.follow(left, part, part)
        found.append(frames)
        done += finished
    assert done == len(sent)
    columns_found = zip(*(frames.columns for frames in found), strict=True)
    both = Frames(*map(np.concatenate, columns_found))
    for one, other in zip(both.columns, Frames.of(expected).columns, strict=True):
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


def test_messages_of_several_layouts_become_columns(tmp_path: Path) -> None:
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
    found = {tuple(g.index.tolist()): g for g in columns(schema, messages)}
    assert sorted(found) == [(0, 2), (1,), (3,), (4,)]
    assert found[0, 2].numbers["position"].tolist() == [[1.0, 2.0], [5.0, 6.0]]
    assert found[0, 2].numbers["header.stamp.sec"].tolist() == [1, 3]
    assert found[(1,)].texts["name"] == ["b", "a"]
    assert found[(3,)].texts["name"] == ["long", "b", "c"]
    assert found[(4,)].numbers["position"].shape == (1, 0)


def test_columns_know_arrays_of_types_of_other_packages(tmp_path: Path) -> None:
    schema = _schema(tmp_path, "std_msgs/msg/Float64MultiArray").schema("/t")
    message = Float64MultiArray(data=[1.0, 2.0, 3.0])
    message.layout.dim.append(MultiArrayDimension(label="V", size=3, stride=9))
    (group,) = columns(schema, [bytes(serialize_message(message))])
    assert group.numbers["data"].tolist() == [[1.0, 2.0, 3.0]]
    assert group.texts["layout.dim[0].label"] == "V"
    assert group.numbers["layout.dim[0].stride"].tolist() == [9]


def _two_arms(folder: Path, tmp_path: Path) -> Path:
    """Two arms in one bag, /left at q = 0.1 and /right at q = 0.2."""
    with BagWriter(folder) as bag:
        for side, q in (("/left", 0.1), ("/right", 0.2)):
            source = Bag(write_run(tmp_path / side[1:], [q] * 5))
            for name, info in source.topics.items():
                bag.add_topic(Topic(side + name, info.type))
            for topic, log_time, publish_time, data in source.read_raw():
                bag.write(side + topic, data, log_time, publish_time)
    return folder


def test_each_arm_of_a_bag_is_a_run_of_its_own(tmp_path: Path) -> None:
    bag = _two_arms(tmp_path / "both", tmp_path)
    with pytest.raises(BagError, match=r"has the arms /left, /right"):
        Recording.load(bag)
    for side, q in (("/left", 0.1), ("/right", 0.2)):
        run = Recording.load(bag, namespace=side)
        assert run.name == f"both{side}"
        assert run.leading.orientation_error.tolist() == pytest.approx([q] * 5)


def test_topics_may_have_other_names(tmp_path: Path) -> None:
    source = Bag(write_run(tmp_path / "source", [0.1] * 5, desired=False))
    with BagWriter(tmp_path / "run") as bag:
        bag.add_topic(Topic("/arm/measured", "sensor_msgs/msg/JointState"))
        bag.add_topic(Topic("/chatter", "std_msgs/msg/String"))
        for _, log_time, publish_time, data in source.read_raw(["/joint_states"]):
            bag.write("/arm/measured", data, log_time, publish_time)
    options = {"urdf": URDF, "tip_frame": "tip"}
    run = Recording.load(tmp_path / "run", names={"joint_states": "/arm/measured"}, **options)
    assert run.measured.q[:, 0].tolist() == [0.1] * 5
    with pytest.raises(BagError, match="--topic joint_states:=/NAME"):
        Recording.load(tmp_path / "run", **options)
    with pytest.raises(UnknownNameError, match="/arm/measured"):
        Recording.load(tmp_path / "run", names={"joint_states": "/arm/measurd"}, **options)
    with pytest.raises(BagError, match="is std_msgs/msg/String; expected"):
        Recording.load(tmp_path / "run", names={"joint_states": "/chatter"}, **options)


def test_messages_that_are_not_valid_are_left_out_and_counted(tmp_path: Path) -> None:
    q = [0.1, math.nan, 0.3, math.inf, 0.5]
    run = Recording.load(write_run(tmp_path / "run", q))
    assert run.measured.q[:, 0].tolist() == [0.1, 0.3, 0.5]
    assert "2 messages of joint_states are not valid and left out" in run.warning
