"""Metrics of raw messages, invalid ones and repeated stamps too: for runs with faults.

A Recording has only what is valid, up to where the clock of the robot jumps.  These numbers are
of all messages of a bag, in the order of recording.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.quantities.base import metric
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.topics import joint_rows, stamps_of
from eulerparams_control.bags.columns import columns
from eulerparams_control.bags.reader import Bag
from eulerparams_control.errors import BagError, InvalidMessageError
from eulerparams_control.laws.rotations import Array, angle_between
from eulerparams_control.messages.from_ros import motion_from_ros

FIELDS: Mapping[str, tuple[str, ...]] = {
    "joint_reference": ("position", "velocity"),
    "joint_effort": ("effort",),
    "joint_states": ("position", "velocity"),
}
"""The numbers of each topic."""

_ROUNDING = 1e-9  # tolerance of a value that was cut to a limit: of it, or of 1 if that is more
_TIMEOUT = 0.1  # [s] default of state_timeout: no tick of a controller lasts longer


class Wire(NamedTuple):
    """N messages of a topic with the joints of the arm.

    Attributes:
        t: (N,) when they were recorded, since the first [s].
        stamp: (N,) of their headers, since the first [s].
        values: (N, n) of each field; NaN where it is empty.
        broken: how many messages more are not of the arm: a joint or a value is missing.
    """

    t: Array
    stamp: Array
    values: dict[str, Array]
    broken: int


def wire(recording: Recording, name: str) -> Wire:
    """Return the messages of a topic; raises BagError if there are none."""
    bag, topic = Bag(recording.path), f"{recording.namespace}/{name}"
    messages = list(bag.read_raw([topic]))
    if not messages:
        raise BagError(f"{recording.path}: {topic} has no message")
    parts, places, broken = [], [], 0
    for group in columns(bag.schema(topic), [message.data for message in messages]):
        try:
            values = joint_rows(group, recording.robot.joints, FIELDS[name])
        except (InvalidMessageError, LookupError):  # a damaged schema has other fields
            broken += len(group.index)
            continue
        parts.append([stamps_of(group), *values])
        places.append(group.index)
    if not parts:
        raise BagError(f"{recording.path}: no message of {topic} is of this arm")
    place = np.concatenate(places)
    order = np.argsort(place)
    stamp, *found = (np.concatenate(column)[order] for column in zip(*parts, strict=True))
    t = np.array([message.log_time for message in messages])[place[order]]
    fields = dict(zip(FIELDS[name], found, strict=True))
    return Wire((t - t[0]) / 1e9, (stamp - stamp[0]) / 1e9, fields, broken)


def _command(recording: Recording) -> tuple[str, Wire]:
    """Return the commands of the controller, and the name of their topic."""
    topics = Bag(recording.path).topics
    for name in ("joint_effort", "joint_reference"):
        topic = f"{recording.namespace}/{name}"
        if topic in topics and topics[topic].count:
            return name, wire(recording, name)
    raise BagError(f"{recording.path} has no joint_reference and no joint_effort")


@metric("")
def nonfinite_commands(recording: Recording) -> float:
    """Commands with a number that is not finite, or without one for each joint."""
    _, found = _command(recording)
    bad = [~np.isfinite(values).all(axis=1) for values in found.values.values()]
    return float(np.any(bad, axis=0).sum() + found.broken)


@metric("")
def commands_beyond_limits(recording: Recording) -> float:
    """Commands with a position, a speed or an effort beyond a limit of the URDF."""
    _, found = _command(recording)
    limits = recording.robot.limits
    bounds = {
        "position": (limits.lower, limits.upper),
        "velocity": (-limits.velocity, limits.velocity),
        "effort": (-limits.effort, limits.effort),
    }
    beyond = [_is_beyond(values, *bounds[name]) for name, values in found.values.items()]
    return float(np.any(beyond, axis=0).sum())


def _is_beyond(values: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Return which rows (N, n) have a number beyond its limits (n,); NaN is not beyond."""
    slack = _ROUNDING * np.maximum(1.0, np.minimum(np.abs(high), 1e6))
    found: NDArray[np.bool_] = ((values < low - slack) | (values > high + slack)).any(axis=1)
    return found


@metric("")
def command_jump_of_rate(recording: Recording, timeout: float = _TIMEOUT) -> float:
    """Largest change between two commands over what their rate limit allows.

    Of efforts ``max_effort_rate`` of the controller, of positions the velocity limits, times the
    time between the two: as they were recorded or as they are stamped, the longer, where stamps
    count up to ``timeout`` [s], and not less than the usual step.
    """
    name, found = _command(recording)
    field = FIELDS[name][0]
    finite = np.isfinite(found.values[field]).all(axis=1)
    t, stamp, values = found.t[finite], found.stamp[finite], found.values[field][finite]
    if len(t) < 2:
        raise BagError(f"{recording.path}: fewer than two commands on {name}")
    steps = np.diff(stamp)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    dt = np.maximum(np.maximum(np.diff(t), np.clip(steps, usual, timeout)), usual)
    rate = _effort_rate(recording) if name == "joint_effort" else recording.robot.limits.velocity
    return float((np.abs(np.diff(values, axis=0)) / (rate * dt[:, None])).max())


def _effort_rate(recording: Recording) -> float:
    """Return the parameter max_effort_rate of the controller, of the fastest joint [Nm/s]."""
    for values in recording.parameters.values():
        if "max_effort_rate" in values:
            given = np.array(values["max_effort_rate"])
            return float(np.max(given if given.size else recording.robot.limits.effort_rate))
    raise BagError(f"{recording.path}: no controller has told its max_effort_rate")


@metric("")
def peak_measured_speed_of_limit(recording: Recording) -> float:
    """Largest measured speed of a joint over its velocity limit.

    Of all states, also after the clock of the robot has jumped.
    """
    dq = wire(recording, "joint_states").values["velocity"]
    return float(np.nanmax(np.abs(dq) / recording.robot.limits.velocity, initial=0.0))


@metric("mm")
def distance_to_goal(recording: Recording) -> float:
    """Distance of the tip from the end of the last reference, at the end."""
    p, _, p_d, _ = _ends(recording)
    return 1e3 * float(np.linalg.norm(p - p_d))


@metric("deg")
def angle_to_goal(recording: Recording) -> float:
    """Angle of the tip from the end of the last reference, at the end."""
    _, R, _, R_d = _ends(recording)
    return math.degrees(angle_between(R, R_d))


def _ends(recording: Recording) -> tuple[Array, Array, Array, Array]:
    """Return p, R of the tip in the last state, and p, R of the end of the last reference."""
    q = wire(recording, "joint_states").values["position"]
    q = q[np.isfinite(q).all(axis=1)]
    if not len(q):
        raise BagError(f"{recording.path}: no joint_states that are finite")
    state = recording.robot.state(q[-1], np.zeros(q.shape[1]))
    goal = _last_reference(recording)
    return state.p_e, state.R_e, goal.p_d, goal.R_d


def _last_reference(recording: Recording) -> Any:
    """Return the frame at which the last valid reference ends."""
    robot, bag = recording.robot, Bag(recording.path)
    goal = None
    for message in bag.messages([f"{recording.namespace}/reference"]):
        try:
            motion, _ = motion_from_ros(message.message, robot.base_frame, robot.tip_frame, 0.0)
        except InvalidMessageError:
            continue
        goal = motion.frames[-1]
    if goal is None:
        raise BagError(f"{recording.path}: no valid reference was recorded")
    return goal
