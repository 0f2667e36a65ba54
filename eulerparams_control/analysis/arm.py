"""The arms of a bag: their topics, parameters, robots."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from eulerparams_control.analysis.controllers import options_of, recorded
from eulerparams_control.analysis.topics import TYPES
from eulerparams_control.bags.columns import have_same_fields
from eulerparams_control.bags.format import BagFlaw, BagWarning
from eulerparams_control.bags.reader import Bag
from eulerparams_control.bags.writer import message_definition
from eulerparams_control.errors import (
    BagError,
    ConfigurationError,
    EulerParamsError,
    RobotError,
    UnknownNameError,
)
from eulerparams_control.laws.orientation import EulerSequence, OrientationOptions
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.parameters.efforts import require_size
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.robot.robot import Robot

_DESCRIPTION = "robot_description"
_SHARED = ("diagnostics", "robot_description")  # one may be for all arms
_OF_A_NODE = "desired", "impedance"  # below the name of a controller: which of two, is not known


def namespaces(bag: Bag, names: Mapping[str, str]) -> list[str]:
    """Return the namespaces of the arms in a bag, "" for one that has none.

    Args:
        bag: the bag.
        names: what a topic is called in this bag, by what it is called here.

    Raises:
        BagError: if no joint_states were recorded.
    """
    if "joint_states" in names:
        return [""]
    found = sorted(topic.rpartition("/")[0] for topic in _playing(bag, "joint_states"))
    if not found:
        raise BagError(
            f"{bag.path}: no joint_states; found {', '.join(sorted(bag.topics)) or 'nothing'}; "
            "if they have another name, give it with --topic joint_states:=/NAME"
        )
    return found


def topics(bag: Bag, namespace: str, names: Mapping[str, str]) -> dict[str, str]:
    """Return the topics of an arm by what they are called here; without those not recorded.

    Raises:
        UnknownNameError: if ``names`` has a name that is none, or a topic that is not there.
        BagError: if a topic that was named has another type.
    """
    chosen = {}
    for name in TYPES:
        there = _playing(bag, name)
        own = [topic for topic in there if topic.rpartition("/")[0] == namespace]
        if name in _OF_A_NODE:
            below = [topic for topic in there if topic.rsplit("/", 2)[0] == namespace]
            own = below if len(below) == 1 else []
        if own:
            chosen[name] = own[0]
        elif len(there) == 1 and name not in _OF_A_NODE and (name in _SHARED or not namespace):
            chosen[name] = there[0]
    for name, topic in names.items():
        chosen[name] = _named(bag, name, topic)
    return chosen


def _playing(bag: Bag, name: str) -> list[str]:
    """Return the topics whose last part and type are those of ``name``, and have messages."""
    return [
        topic
        for topic, info in bag.topics.items()
        if topic.rpartition("/")[2] == name and info.type == TYPES[name] and info.count
    ]


def _why_unreadable(bag: Bag, topic: str, kind: str) -> str:
    """Return why the messages of a topic are not those of a type; "" if they are."""
    try:
        definition = message_definition(kind).encode()
    except BagError:  # it is not installed here: the bag is believed
        return ""
    try:
        if have_same_fields(bag.schema(topic), definition):
            return ""
    except BagError as error:
        return str(error)
    return f"it has other fields in this bag than {kind} has: is its schema damaged?"


def _named(bag: Bag, name: str, topic: str) -> str:
    if name not in TYPES:
        raise UnknownNameError("topic", name, TYPES)
    if topic not in bag.topics:
        raise UnknownNameError("topic in the bag", topic, bag.topics)
    found = bag.topics[topic].type
    if found != TYPES[name]:
        raise BagError(f"{bag.path}: {topic} is {found}; expected {TYPES[name]} for {name}")
    return topic


LASTING = ControlParameters.reference_timeout
"""[s] for which a streamed frame goes on."""


@dataclass(frozen=True)
class Options:
    """Which part of a bag is read, and how.

    Attributes:
        urdf: text of a URDF; "" takes the robot_description in the bag.
        tip_frame: the link to look at; "" takes that of the reference, or of the parameters.
        base_frame: what poses refer to; "" as above, else the root of the URDF.
        namespace: of the arm; None is the only one.
        names: what topics are called in this bag, by what they are called here.
        start, end: [s] of the recording that is looked at.
        euler_sequence: of the Euler angles; "" takes that of the parameters, XYZ if they name none.
    """

    urdf: str = ""
    tip_frame: str = ""
    base_frame: str = ""
    namespace: str | None = None
    names: Mapping[str, str] = field(default_factory=dict)
    start: float = 0.0
    end: float = math.inf
    euler_sequence: str = ""


class Arm:
    """An arm as it was recorded in a bag.

    Args:
        bag: the bag.
        options: which arm, and how it is read.

    Attributes:
        namespace: of its nodes.
        others: namespaces of other arms in the bag.
        topics: by what they are called here.
        parameters: by node and name.
        orientation: how the controller represents it.
        urdf, robot: its model.
        flaws: of the recording, as keys, in the order in which they were found.

    Raises:
        BagError: if there is no such arm, or nothing tells its frames.
        RobotError: if the URDF does not fit.
    """

    def __init__(self, bag: Bag, options: Options) -> None:
        self._bag, self._options = bag, options
        arms = namespaces(bag, options.names)
        self.namespace = _namespace(bag, arms, options.namespace)
        self.others = set(arms) - {self.namespace}
        self.topics = topics(bag, self.namespace, options.names)
        self.parameters = _parameters(bag, self.namespace)
        self.flaws: dict[BagWarning, None] = {}
        self._leave_out_unreadable()
        self.orientation = self._options_of_orientation()
        self.urdf = options.urdf or bag.robot_description(self.topics.get(_DESCRIPTION))
        self.robot = self._make_robot()

    def _leave_out_unreadable(self) -> None:
        """Leave out the topics whose messages have other fields than their type.

        Raises:
            BagError: of one that was named, or that nothing can be done without.
        """
        needed = {"joint_states", *self._options.names}
        if self._options.urdf:
            self.topics.pop(_DESCRIPTION, None)
        else:
            needed.add(_DESCRIPTION)
        for name, topic in tuple(self.topics.items()):
            if why := _why_unreadable(self._bag, topic, TYPES[name]):
                if name in needed:
                    raise BagError(f"{self._bag.path}: {topic} cannot be read: {why}")
                self.warn(BagFlaw.LEFT_OUT, f"{topic} is left out: {why}")
                del self.topics[name]

    def _make_robot(self) -> Robot:
        options = self._options
        base, tip = given = self._frames()
        base, tip = options.base_frame or base, options.tip_frame or tip
        if "reference" in self.topics and (base, tip) != given:
            text = f"its reference is for {given[1]} in {given[0]}, not for {tip} in {base}"
            self.warn(BagFlaw.FRAMES, f"{text}: errors are not known")
        gravity = ImpedanceParameters.gravity
        try:
            if told := recorded(self.parameters, ImpedanceParameters):
                require_size("gravity", told.gravity, 3)
                gravity = told.gravity
        except (BagError, ConfigurationError) as error:
            self.warn(BagFlaw.PARAMETERS, f"{error}: the gravity is taken for {gravity}")
        try:
            return Robot(self.urdf, base, tip, gravity=gravity)
        except RobotError as error:
            raise RobotError(f"{self._bag.path}: {error}") from error

    def _options_of_orientation(self) -> OrientationOptions:
        try:
            told = options_of(self.parameters)
            name = self._options.euler_sequence
            return replace(told, sequence=EulerSequence(name)) if name else told
        except EulerParamsError as error:
            text = f"the parameters of the controller are not valid ({error}): the defaults of "
            self.warn(BagFlaw.PARAMETERS, f"{text}euler_sequence and quaternion_sign are taken")
            return OrientationOptions()

    def warn(self, kind: BagFlaw, text: str) -> None:
        """Add a flaw, once."""
        self.flaws[BagWarning(kind, text)] = None

    def _frames(self) -> tuple[str, str]:
        """Return base and tip frame: from the references, else from the parameters."""
        if "reference" in self.topics:
            for raw in self._bag.read_raw([self.topics["reference"]]):
                with suppress(BagError):  # a damaged one
                    found = self._bag.decode(raw)
                    if len(found.joint_names) == 1:
                        return str(found.header.frame_id), str(found.joint_names[0])
        for values in self.parameters.values():
            if "tip_frame" in values:
                return str(values.get("base_frame", "")), str(values["tip_frame"])
        if not self._options.tip_frame:
            told = "".join(f" ({flaw.text})" for flaw in self.flaws)
            raise BagError(
                f"{self._bag.path}: nothing in it names the tip frame{told}; give it with "
                "--tip-frame, and with --base-frame what poses refer to"
            )
        return "", ""

    def lasting(self) -> float:
        """Return for how long the controller lets a set-point go on [s]."""
        for values in self.parameters.values():
            told = values.get("reference_timeout") if "orientation" in values else None
            if isinstance(told, int | float) and 0 <= told < math.inf:
                return float(told)
        return LASTING


def _namespace(bag: Bag, arms: Sequence[str], wanted: str | None) -> str:
    """Return the namespace of the arm that is wanted, or of the only one."""
    if wanted is not None and wanted in arms:
        return wanted
    if wanted is None and len(arms) == 1:
        return arms[0]
    raise BagError(
        f"{bag.path} has the arms {', '.join(name or '(without a namespace)' for name in arms)}; "
        "choose one of them with --namespace"
    )


def _parameters(bag: Bag, namespace: str) -> dict[str, dict[str, Any]]:
    """Return the parameters by node and name; what has another form is left out."""
    found = {}
    for name, node in bag.parameters().items():
        values = node.get("ros__parameters") if isinstance(node, dict) else None
        if isinstance(values, dict) and str(name).startswith(namespace):
            found[str(name)] = values
    return found
