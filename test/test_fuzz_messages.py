"""Messages with any content: refused as InvalidMessageError, or a result that is finite.

First the functions that check them, then the controllers: none ends, none commands
what is not finite or beyond the limits, and after the storm a good message is answered as before.
"""

import copy
import math
import operator
import tracemalloc
from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from in_process import each_once
from ros_processes import FRAMES, MODEL, UR5, Controlled, assert_holds, pose, reference
from samples import examples
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from test_messages import JOINTS, REFUSALS, good
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.messages.from_ros import LARGEST, JointStateReader
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.parameters.schemes import COMMANDS
from sim_bridge.commands import CommandInput

LONGEST_REFUSAL = 5000  # characters
# A command may exceed a limit by its rounding.
ROUNDING = 1e-9

SPECIAL = (
    *(math.nan, math.inf, -math.inf, 1e308, -1e308, 1.7976931348623157e308, 5e-324, -0.0),
    *(1e9, -1e9, 1e10, 1e154, 1e-160, 1.0, -1.0, 0.0, 3.141592653589793),
)
INT32 = st.integers(-(2**31), 2**31 - 1) | st.integers(0, 3)
UINT32 = st.integers(0, 2**32 - 1)
NUMBER = st.sampled_from(SPECIAL) | st.floats() | st.floats(-2.0, 2.0)
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
def odd(draw: Any, good: Message) -> Message:
    """Draw a message that would be good, but for some fields."""
    msg = copy.deepcopy(good)
    for _ in range(draw(st.integers(0, 6))):
        owner, key, value = draw(st.sampled_from([spot for spot in places(msg) if is_odd(spot[2])]))
        put = setattr if isinstance(key, str) else operator.setitem
        put(owner, key, draw(other(key, value)))
    return msg


def is_odd(value: Any) -> bool:
    """Return whether a number, a text or a list can have another value; a message has parts."""
    is_message = hasattr(value, "get_fields_and_field_types")
    return not is_message and (isinstance(value, str | int | float) or len(value) > 0)


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


@given(odd(good("joint_states")[0]))
def test_commands_are_finite_or_refused(msg):
    for read in (CommandInput(JOINTS, control).from_ros for control in COMMANDS):
        for values in taken(partial(read, msg)) or ():
            assert np.isfinite(np.square(values)).all()  # nothing overflows in the robot


@pytest.mark.parametrize("kind", REFUSALS)
@examples(300)
@given(data=st.data(), times=st.lists(st.floats(-1.0, 5.0), min_size=3, max_size=3))
def test_a_message_is_finite_or_refused(kind, data, times):
    msg, read = good(kind)
    found = taken(lambda: read(data.draw(odd(msg))))
    if found is None:
        return
    if kind == "reference":
        motion, _ = found
        ends = getattr(motion, "times", [0.0])
        with np.errstate(all="raise", under="ignore"):
            for t in (*times, *ends, ends[-1] / 2, math.nextafter(ends[-1], 0.0)):
                assert all(np.isfinite(value).all() for value in motion.sample(t))
        return
    assert_possible(*found)
    if kind == "pose":
        np.testing.assert_allclose(found.R_d @ found.R_d.T, np.eye(3), atol=ROUNDING)


def test_what_a_refusal_quotes_is_short_and_can_be_printed():
    msg = JointState(name=["\x1b[2J" * 10_000] * 5000, position=[0.0] * 5000)
    with pytest.raises(InvalidMessageError, match=r"found \\x1b\[2J.* and 4980 more$") as refusal:
        JointStateReader(JOINTS).from_ros(msg)
    assert len(str(refusal.value)) < LONGEST_REFUSAL
    assert str(refusal.value).isprintable()


# --- the controllers, over DDS ---------------------------------------------------------------
PARAMETERS = {
    "clik": FRAMES,
    "dynamic_control": FRAMES,
    "impedance_control": {**FRAMES, "tare_samples": 20},
}
shared = each_once(PARAMETERS.__getitem__)
AT_HOME = JointState(
    name=list(UR5.joints), position=list(UR5.home), velocity=[0.0] * 6, effort=[0.0] * 6
)
MESSAGES = st.one_of(
    odd(AT_HOME), *(odd(good(kind)[0]) for kind in REFUSALS), st.builds(String, data=TEXT)
)


@pytest.fixture(params=PARAMETERS)
def node(request: pytest.FixtureRequest, shared: Any) -> Controlled:
    return shared(request.param)


TOPICS = {
    JointState: "/joint_states",
    MultiDOFJointTrajectory: "/reference",
    PoseStamped: "/target_pose",
    TwistStamped: "/target_twist",
    WrenchStamped: "/wrench",
}


@cache
def publisher(node: Controlled, kind: type) -> Any:
    """Return what sends messages of a type to a controller, as the only one on its topic."""
    own = [*node.peer.node.publishers]
    same = (each for each in own if each.topic_name == TOPICS.get(kind, "/robot_description"))
    return next(same, None) or node.peer.publisher(kind, TOPICS[kind])


def send(node: Controlled, msg: Any) -> None:
    publisher(node, type(msg)).publish(msg)


def calm(node: Controlled) -> Any:
    """Return the answer to a good state, after all that was sent and others that are good."""
    node.arm.send_next(50)
    node.arm.start_anew()
    return node.arm.start_anew()


def assert_within_limits(command: Any) -> None:
    for values in (command.position, command.velocity, command.effort):
        assert np.isfinite(values).all()
    for values, limit in (
        (command.effort, MODEL.limits.effort),
        (command.velocity, MODEL.limits.velocity),
    ):
        assert not values or (np.abs(values) <= limit + ROUNDING).all()


@examples(12)
@given(messages=st.lists(MESSAGES, min_size=10, max_size=30))
def test_a_controller_survives_any_messages_and_then_holds_again(messages, node):
    for msg in messages:
        send(node, msg)
        for command in node.arm.commands:
            assert_within_limits(command)
        node.arm.commands.clear()
    command = calm(node)
    assert_within_limits(command)
    assert_holds(command, node.arm.q)
    assert node.process.exit_code is None, node.process.log
    assert "Traceback" not in node.process.log
    assert "internal error" not in node.process.log


def test_hundreds_of_refused_messages_leave_nothing_behind(world):
    """In the node with the most inputs; what refuses them is the same in each."""
    node = Controlled(world, "impedance_control", PARAMETERS["impedance_control"])
    tracemalloc.start()
    for number in range(400):
        names = [UR5.joints[0], *[f"joint {number} {'x' * 100}"] * 39]  # each another
        send(node, JointState(name=names, position=[math.nan] * 40))
        wrong = reference(DesiredFrame(*pose(UR5.home)))
        wrong.header.frame_id = f"frame {number} {'x' * 1000}"
        send(node, wrong)
    ours = [tracemalloc.Filter(True, "*/eulerparams_control/*")]
    kept = tracemalloc.take_snapshot().filter_traces(ours).statistics("filename")
    tracemalloc.stop()
    assert sum(one.size for one in kept) < 2**18  # bytes; all complaints are 2 MB
    assert_holds(calm(node), node.arm.q)
    assert node.peer.counter(node.name, "joint_states rejected") == 400
    assert node.peer.counter(node.name, "reference rejected") == 400
    assert len(node.status().values) < 60
