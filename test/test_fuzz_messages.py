"""Messages with any content: refused as InvalidMessageError, or a result that is finite.

First the functions that check them, then the controllers: none ends, none commands
what is not finite or beyond the limits, and after the storm a good message is answered as before.
"""

import copy
import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    Transform,
    Twist,
    Vector3,
    Wrench,
    WrenchStamped,
)
from hypothesis import given
from hypothesis import strategies as st
from in_process import World
from ros_processes import (
    FRAMES,
    MODEL,
    UR5,
    Controlled,
    Graph,
    assert_may_stay,
    pose,
    reference,
)
from samples import examples
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.messages.from_ros import (
    LARGEST,
    CommandReader,
    JointStateReader,
    motion_from_ros,
    pose_from_ros,
    wrench_from_ros,
)
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import MAX_POINTS

LONGEST_REFUSAL = 5000  # characters

# A command may exceed a limit by its rounding.
ROUNDING = 1e-9

# Bytes by which the memory of a process may grow over thousands of refused messages: measured are
# 0.3 MB, what the allocator keeps; their complaints alone, if they were kept, are 5 MB.
GROWTH = 2 * 2**20

SPECIAL = (
    *(math.nan, math.inf, -math.inf, 1e308, -1e308, 1.7976931348623157e308, 5e-324, -0.0),
    *(1e9, -1e9, 1e10, 1e154, 1e-160, 1.0, -1.0, 0.0, 3.141592653589793),
)
INT32 = st.integers(-(2**31), 2**31 - 1)
UINT32 = st.integers(0, 2**32 - 1)
NUMBER = st.sampled_from(SPECIAL) | st.floats()
SMALL = st.floats(-2.0, 2.0)
LETTERS = st.characters(exclude_categories=("Cs",), exclude_characters="\0")
TEXT = st.sampled_from(["", "\u00e9\u2603", "x" * 10_000, "a\nb\x1b[2J", " "]) | st.text(LETTERS)


Message = Any
Place = tuple[Any, Any, Any]  # an owner, the name or index of what it has, and that


def places(msg: Message) -> Iterator[Place]:
    """Yield the numbers, texts and lists of a message, and of what is in it."""
    for name in msg.get_fields_and_field_types():
        value = getattr(msg, name)
        yield msg, name, value
        if hasattr(value, "get_fields_and_field_types"):
            yield from places(value)
        elif not isinstance(value, str | int | float):
            for index, each in enumerate(value):
                yield value, index, each
                if hasattr(each, "get_fields_and_field_types"):
                    yield from places(each)


def put(owner: Any, key: Any, value: Any) -> None:
    if isinstance(key, str):
        setattr(owner, key, value)
    else:
        owner[key] = value


def other(key: Any, value: Any) -> st.SearchStrategy[Any]:
    """Draw another value for a place of a message."""
    if isinstance(value, float):
        return NUMBER
    if isinstance(value, int):
        return INT32 if key == "sec" else UINT32
    if isinstance(value, str):
        return TEXT
    items = list(value)
    return st.sampled_from([[], items[:-1], items + items[:1], items[::-1], items * 5])


@st.composite
def odd(draw: Any, valid: st.SearchStrategy[Message]) -> Message:
    """Draw a message that would be valid, but for some fields."""
    msg = copy.deepcopy(draw(valid))
    for _ in range(draw(st.integers(0, 3))):
        spots = [spot for spot in places(msg) if isinstance(spot[2], PLAIN) or len_of(spot[2])]
        owner, key, value = spots[draw(st.integers(0, len(spots) - 1))]
        put(owner, key, draw(other(key, value)))
    return msg


PLAIN = (str, int, float)


def len_of(value: Any) -> int:
    """Return the length of a list; 0 for a message."""
    return 0 if hasattr(value, "get_fields_and_field_types") else len(value)


STAMPS = st.builds(Time, sec=st.integers(1, 3), nanosec=st.integers(0, 10**9 - 1))
VECTORS = st.builds(Vector3, x=SMALL, y=SMALL, z=SMALL)
TWISTS = st.lists(st.builds(Twist, linear=VECTORS, angular=VECTORS), max_size=1)
UNIT = Quaternion(x=0.6, y=0.0, z=0.0, w=0.8)
TRANSFORMS = st.builds(Transform, translation=VECTORS, rotation=st.just(UNIT))


def headers(frame: str) -> st.SearchStrategy[Header]:
    return st.builds(Header, stamp=STAMPS, frame_id=st.just(frame))


def joint_states(joints: tuple[str, ...]) -> st.SearchStrategy[JointState]:
    n = len(joints)
    numbers = st.lists(SMALL, min_size=n, max_size=n)
    names = st.permutations(joints)
    fields = {"position": numbers, "velocity": numbers, "effort": numbers}
    return odd(st.builds(JointState, header=headers("base"), name=names, **fields))


@st.composite
def trajectories(draw: Any, base: str, tip: str) -> MultiDOFJointTrajectory:
    msg = MultiDOFJointTrajectory(header=draw(headers(base)), joint_names=[tip])
    for second in range(draw(st.integers(1, 3))):
        point = MultiDOFJointTrajectoryPoint(transforms=[draw(TRANSFORMS)])
        point.velocities, point.accelerations = draw(TWISTS), draw(TWISTS)
        point.time_from_start = Duration(sec=second)
        msg.points.append(point)
    return msg


def references(base: str, tip: str) -> st.SearchStrategy[MultiDOFJointTrajectory]:
    return odd(trajectories(base, tip))


def poses(base: str) -> st.SearchStrategy[PoseStamped]:
    points = st.builds(Point, x=SMALL, y=SMALL, z=SMALL)
    pose = st.builds(Pose, position=points, orientation=st.just(UNIT))
    return odd(st.builds(PoseStamped, header=headers(base), pose=pose))


def wrenches(frame: str) -> st.SearchStrategy[WrenchStamped]:
    wrench = st.builds(Wrench, force=VECTORS, torque=VECTORS)
    return odd(st.builds(WrenchStamped, header=headers(frame), wrench=wrench))


# --- the functions that check ----------------------------------------------------------------


def taken(read: Callable[[], Any]) -> Any:
    """Return what is read, None if it is refused in one line."""
    refusals: list[str] = []
    found = None
    try:
        found = read()
    except InvalidMessageError as error:
        refusals.append(str(error))
    assert all(text.isprintable() and len(text) < LONGEST_REFUSAL for text in refusals)
    return found


def assert_possible(*values: Any) -> None:
    for value in values:
        assert np.isfinite(value).all()
        assert (np.abs(value) <= LARGEST).all()


JOINTS = ("shoulder", "elbow")


@given(joint_states(JOINTS), st.booleans())
def test_joint_states_are_finite_or_refused(msg: JointState, needs_velocity: bool) -> None:
    found = taken(lambda: JointStateReader(JOINTS, needs_velocity).from_ros(msg))
    if found is not None:
        _, q, dq = found
        assert q.shape == dq.shape == (2,)
        assert_possible(q, dq)
        assert all(list(msg.name).count(joint) == 1 for joint in JOINTS)


@given(joint_states(JOINTS))
def test_commands_are_finite_or_refused(msg: JointState) -> None:
    position = taken(lambda: CommandReader(JOINTS, "position").position_from_ros(msg))
    effort = taken(lambda: CommandReader(JOINTS, "torque").effort_from_ros(msg))
    for values in (*(position or ()), *(() if effort is None else (effort,))):
        assert np.isfinite(np.square(values)).all()  # nothing overflows in the robot


@examples(300)
@given(references("base", "tip"), st.lists(st.floats(-1.0, 5.0), min_size=3, max_size=3))
def test_a_reference_is_finite_at_every_time_or_refused(
    msg: MultiDOFJointTrajectory, times: list[float]
) -> None:
    found = taken(lambda: motion_from_ros(msg, "base", "tip", 0.1))
    if found is None:
        return
    motion, _ = found
    ends = getattr(motion, "times", [0.0])
    with np.errstate(all="raise", under="ignore"):
        for t in (*times, *ends, ends[-1] / 2, math.nextafter(ends[-1], 0.0)):
            assert all(np.isfinite(value).all() for value in motion.sample(t))


@given(poses("base"))
def test_a_pose_is_a_rotation_and_finite_or_refused(msg: PoseStamped) -> None:
    found = taken(lambda: pose_from_ros(msg, "base"))
    if found is not None:
        assert_possible(*found)
        np.testing.assert_allclose(found[1] @ found[1].T, np.eye(3), atol=ROUNDING)


@given(wrenches("sensor"))
def test_a_wrench_is_finite_or_refused(msg: WrenchStamped) -> None:
    found = taken(lambda: wrench_from_ros(msg, "sensor"))
    if found is not None:
        assert_possible(found)


def test_what_a_refusal_quotes_is_short_and_can_be_printed() -> None:
    msg = JointState(name=["\x1b[2J" * 10_000] * 5000, position=[0.0] * 5000)
    with pytest.raises(InvalidMessageError, match=r"found \\x1b\[2J.* and 4980 more$") as refusal:
        JointStateReader(JOINTS).from_ros(msg)
    assert len(str(refusal.value)) < LONGEST_REFUSAL
    assert str(refusal.value).isprintable()


def test_a_joint_that_is_there_twice_is_refused() -> None:
    msg = JointState(name=["shoulder", "elbow", "shoulder"], position=[0.0, 1.0, 2.0])
    with pytest.raises(InvalidMessageError, match="joint_states has shoulder twice"):
        JointStateReader(JOINTS).from_ros(msg)


@pytest.mark.parametrize("value", [1e10, -1e308])
def test_a_number_that_no_machine_measures_is_refused(value: float) -> None:
    msg = JointState(name=list(JOINTS), position=[0.0, value])
    with pytest.raises(InvalidMessageError, match="has a too large position"):
        JointStateReader(JOINTS).from_ros(msg)
    wrench = WrenchStamped(wrench=Wrench(torque=Vector3(x=value)))
    with pytest.raises(InvalidMessageError, match="has a too large value"):
        wrench_from_ros(wrench, "")


def test_a_reference_of_too_many_points_or_before_its_start_is_refused() -> None:
    point = MultiDOFJointTrajectoryPoint(transforms=[Transform()])
    long = MultiDOFJointTrajectory(joint_names=["tip"], points=[point] * (MAX_POINTS + 1))
    with pytest.raises(InvalidMessageError, match=f"20001 points; expected at most {MAX_POINTS}"):
        motion_from_ros(long, "", "tip", 0.1)
    early = MultiDOFJointTrajectory(joint_names=["tip"], points=[point])
    early.points[0].time_from_start = Duration(sec=-1)
    with pytest.raises(InvalidMessageError, match="begins at time_from_start -1 s"):
        motion_from_ros(early, "", "tip", 0.1)


# --- the controllers, over DDS ---------------------------------------------------------------


PARAMETERS = {
    "clik": FRAMES,
    "dynamic_control": FRAMES,
    "impedance_control": {**FRAMES, "tare_samples": 20},
}


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Controlled]]:
    """Starts the controllers, each once for all examples."""
    with ExitStack() as stack:

        @cache
        def start(executable: str) -> Controlled:
            world = stack.enter_context(World(tmp_path_factory.mktemp(executable)))
            return Controlled(world, executable, PARAMETERS[executable])

        yield start


@pytest.fixture(params=PARAMETERS)
def node(request: pytest.FixtureRequest, shared: Callable[[str], Controlled]) -> Controlled:
    return shared(request.param)


MESSAGES = st.one_of(
    joint_states(UR5.joints),
    references(UR5.base_frame, UR5.tip_frame),
    wrenches(UR5.tip_frame),
    st.builds(String, data=TEXT),
)


class Storm:
    """Sends messages of any kind to a controller, and looks at what it commands."""

    def __init__(self, node: Controlled) -> None:
        self.node = node
        self._wrenches = node.arm.sensor.wrenches if node.arm.sensor else None
        self._descriptions = node.arm._description

    def send(self, msg: Any) -> None:
        if isinstance(msg, JointState):
            self.node.arm.states.publish(msg)
        elif isinstance(msg, MultiDOFJointTrajectory):
            self.node.references.publish(msg)
        elif isinstance(msg, WrenchStamped) and self._wrenches is not None:
            self._wrenches.publish(msg)
        elif isinstance(msg, String):
            self._descriptions.publish(msg)

    def calm(self) -> Any:
        """Return the answer to a good state, after all that was sent."""
        self.node.arm.start_anew()
        return self.node.arm.start_anew()


def assert_within_limits(command: Any) -> None:
    for values in (command.position, command.velocity, command.effort):
        assert np.isfinite(values).all()
    limits = MODEL.limits
    if command.effort:
        assert (np.abs(command.effort) <= limits.effort + ROUNDING).all()
    if command.velocity:
        assert (np.abs(command.velocity) <= limits.velocity + ROUNDING).all()


@examples(12)
@given(messages=st.lists(MESSAGES, min_size=10, max_size=30))
def test_a_controller_survives_any_messages_and_then_holds_again(
    messages: list[Any], node: Controlled
) -> None:
    assert node.process.exit_code is None, node.process.log
    storm = Storm(node)
    heard: list[Any] = []
    for msg in messages:
        storm.send(msg)
        heard += node.arm.commands
        node.arm.commands.clear()
    for command in heard:
        assert_within_limits(command)
    command = storm.calm()
    assert_within_limits(command)
    assert_may_stay(command, node.arm)
    assert "Traceback" not in node.process.log
    assert "internal error" not in node.process.log


def resident(node: Controlled) -> int:
    """Return the memory [bytes] that a process has now."""
    pid = node.process._child.pid
    with open(f"/proc/{pid}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def rejected(node: Controlled) -> int:
    return node.peer.counter(node.name, "joint_states rejected")


@pytest.mark.parametrize("executable", PARAMETERS)
def test_thousands_of_refused_messages_leave_nothing_behind(executable: str, graph: Graph) -> None:
    node = Controlled(graph, executable, PARAMETERS[executable])
    arm, storm = node.arm, Storm(node)

    def refused(begin: int, count: int) -> None:
        for number in range(begin, begin + count):
            names = [f"joint {number} {'x' * 100}"] * 40  # another complaint each time
            storm.send(JointState(name=names, position=[math.nan] * 40))
            wrong = reference(DesiredFrame(*pose(UR5.home)))
            wrong.header.frame_id = f"frame {number} {'x' * 1000}"
            storm.send(wrong)
            if number % 20 == 0:  # no more than the queues hold
                arm.tick()
        storm.calm()

    refused(0, 300)  # what is allocated once
    before, count = resident(node), rejected(node)
    refused(300, 2000)
    assert resident(node) - before < GROWTH
    assert rejected(node) - count > 1000  # DDS may drop some of what comes so fast
    status = node.status()
    assert len(status.values) < 60
    assert "Traceback" not in node.process.log


@pytest.mark.parametrize("executable", PARAMETERS)
def test_commands_are_the_same_numbers_whether_field_types_are_checked_or_not(
    executable: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = []
    messages = [m for m in sys.modules.values() if hasattr(m, "ros_python_check_fields")]
    for checked in ("1", "0"):
        for module in messages:
            monkeypatch.setattr(module, "ros_python_check_fields", checked)
        with World(tmp_path / checked) as world:
            node = Controlled(world, executable, PARAMETERS[executable])
            p, R = pose(UR5.home)
            node.follow(reference(DesiredFrame(p + [0.0, 0.0, 0.005], R)))
            node.arm.start_afresh()
            commands = node.arm.ticks(5)
            found.append([(c.name, c.position, c.velocity, c.effort) for c in commands])
    assert [len(names) for names, *_ in found[0]] == [6] * 5
    assert found[0] == found[1]
