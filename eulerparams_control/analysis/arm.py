"""The arms of a bag: their topics, parameters, robots."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from eulerparams_control.analysis.controllers import options_of, recorded
from eulerparams_control.analysis.topics import namespaces, topics
from eulerparams_control.bags.format import BagFlaw, BagWarning
from eulerparams_control.bags.reader import Bag
from eulerparams_control.errors import BagError, ConfigurationError, EulerParamsError, RobotError
from eulerparams_control.laws.orientation import EulerSequence, OrientationOptions
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.parameters.efforts import require_size
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.robot.robot import Robot

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
    """An arm, as a bag tells of it.

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
        flaws: what is wrong, the keys in the order in which it was found.

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
        self.orientation = self._options_of_orientation()
        self.urdf = options.urdf or bag.robot_description(self.topics.get("robot_description"))
        self.robot = self._make_robot()

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
        """Keep what is wrong, once."""
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
            raise BagError(
                f"{self._bag.path}: nothing in it names the tip frame; give it with --tip-frame, "
                "and with --base-frame what poses refer to"
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
