"""A URDF, read once, whoever sent it: the tree of links and joints that it must be.

Values that count are checked and rewritten, numbers as numbers, axes of length 1; only they are
given to Pinocchio and PyBullet, so that both see the same arm.  By itself Pinocchio goes on with a
massless link where it cannot read an ``<inertial>``, so that the arm would be held with too little
effort, and PyBullet takes the length of an ``<axis>`` for a factor of the joint's motion.
"""

import copy
import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from eulerparams_control.errors import RobotError, UnknownNameError
from eulerparams_control.robot.urdf_text import EXPECTED, parse

LARGEST = 1e9
"""No length, mass or inertia of an arm is larger; what is would overflow sooner or later."""

NO_LIMIT = 1e12
"""Stands for infinity where Pinocchio and PyBullet need a number."""

_ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

# Entries of bodies that are points have a rounded zero on their diagonal [kg m^2].
_ROUNDING = 1e-9

# An axis that is shorter is a zero with rounding.
_SHORTEST_AXIS = 1e-9

MOVING = ("revolute", "continuous", "prismatic")
"""The types of joints of one degree of freedom."""

_TYPES = (*MOVING, "fixed", "floating", "planar")

# More than any robot has: parsers in C++ go down a chain by recursion, until the stack is full.
_MOST_LINKS = 5000
_LONGEST_CHAIN = 200
_LONGEST_NAME = 1000  # characters; PyBullet writes a longer one over other memory

COULOMB_SPEED = 0.05
"""Coulomb friction is tanh(dq / COULOMB_SPEED) [rad/s] of its value; a step would chatter."""

_LIMIT = '<limit lower="-3.1" upper="3.1" effort="100" velocity="2"/>'


@contextmanager
def _naming(owner: str) -> Iterator[None]:
    """Let a refusal begin with what it is about."""
    try:
        yield
    except RobotError as error:
        raise RobotError(f"{owner}: {error}") from error


def attribute(element: ET.Element, name: str) -> str:
    """Return an attribute.

    Raises:
        RobotError: if there is none of this name.
    """
    value = element.get(name)
    if value is None:
        raise RobotError(f"a <{element.tag}> has no attribute '{name}'")
    return value


def _number(text: str) -> float:
    """Return a number as URDF has it, NaN if it is none: neither ``1_0`` nor other digits are."""
    if "_" in text or not text.isascii():
        return math.nan
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return math.nan if math.isinf(value) and "inf" not in text.lower() else value


def number(element: ET.Element, name: str, default: str | None = None) -> float:
    """Return the number of an attribute; it may be infinite.

    Raises:
        RobotError: if it is no number, or is not there and there is no default.
    """
    text = attribute(element, name) if default is None else element.get(name, default)
    value = _number(text)
    if math.isnan(value):
        raise RobotError(
            f"{name} of its <{element.tag}> is '{text}'; expected a number, as 0.5 or 1e-3"
        )
    return value


def numbers(element: ET.Element, name: str, default: str) -> list[float]:
    """Return the three numbers of an attribute, each finite and at most ``LARGEST``.

    Raises:
        RobotError: if they are not.
    """
    text = element.get(name, default)
    values = [_number(word) for word in text.split()]
    if len(values) != 3 or not all(map(is_plausible, values)):
        raise RobotError(
            f"{name} of its <{element.tag}> is '{text}'; expected three numbers up to {LARGEST:g} "
            "with blanks between them, as '0 0 0.5'"
        )
    return values


def text_of(values: Iterable[float]) -> str:
    """Return numbers as URDF has them, without loss."""
    return " ".join(repr(float(value)) for value in values)


def is_plausible(value: float) -> bool:
    """Return whether a value is finite and not larger than ``LARGEST``."""
    return math.isfinite(value) and abs(value) <= LARGEST


def _clean_link(link: ET.Element) -> ET.Element:
    """Return a link with its checked inertia, if it has one, and its shapes."""
    clean = ET.Element("link", name=attribute(link, "name"))
    with _naming(f"link '{clean.get('name')}'"):
        clean.extend([_clean_inertial(inertial) for inertial in link.findall("inertial")[:1]])
    clean.extend([part for part in link if part.tag in ("visual", "collision")])
    return clean


def _clean_inertial(inertial: ET.Element) -> ET.Element:
    mass = _plausible(inertial, "mass", "value")
    entries = {name: _plausible(inertial, "inertia", name) for name in _ENTRIES}
    negative = {name: entries[name] for name in ("ixx", "iyy", "izz") if entries[name] < -_ROUNDING}
    if mass < 0 or negative:
        raise RobotError(
            f"its <inertial> has mass {mass:g} kg, negative moments {negative or 'none'}; expected "
            "0 or more"
        )
    clean = ET.Element("inertial")
    clean.extend(_clean_origin(inertial))
    ET.SubElement(clean, "mass", value=repr(mass))
    ET.SubElement(clean, "inertia", {name: repr(entry) for name, entry in entries.items()})
    return clean


def _plausible(inertial: ET.Element, part: str, name: str) -> float:
    element = inertial.find(part)
    if element is None:
        raise RobotError(
            f"its <inertial> has no <{part}>; expected one, or no <inertial> where there is no mass"
        )
    value = number(element, name)
    if not is_plausible(value):
        raise RobotError(f"{name} of its <{part}> is {value:g}; expected at most {LARGEST:g}")
    return value


def _clean_origin(element: ET.Element) -> list[ET.Element]:
    """Return the ``<origin>`` of a joint or an inertia in a list, which is empty if it has none."""
    origins = [
        (numbers(o, "xyz", "0 0 0"), numbers(o, "rpy", "0 0 0"))
        for o in element.findall("origin")[:1]
    ]
    return [ET.Element("origin", xyz=text_of(xyz), rpy=text_of(rpy)) for xyz, rpy in origins]


def _clean_joint(joint: ET.Element) -> ET.Element:
    """Return a joint with its checked place and ends; its limits are checked where it moves."""
    name = attribute(joint, "name")
    with _naming(f"joint '{name}'"):
        kind = attribute(joint, "type")
        clean = ET.Element("joint", name=name, type=kind)
        clean.extend(_clean_origin(joint))
        for end in ("parent", "child"):
            element = joint.find(end)
            if element is None:
                raise RobotError(f"it has no <{end}>")
            ET.SubElement(clean, end, link=attribute(element, "link"))
        if kind in MOVING:
            ET.SubElement(clean, "axis", xyz=text_of(_unit_axis(joint)))
    kept = ("limit", "safety_controller", "mimic", "dynamics")
    clean.extend([part for part in joint if part.tag in kept])
    return clean


def _unit_axis(joint: ET.Element) -> list[float]:
    axis = joint.find("axis")
    direction = [1.0, 0.0, 0.0] if axis is None else numbers(axis, "xyz", "1 0 0")
    length = math.hypot(*direction)
    if length < _SHORTEST_AXIS:
        raise RobotError("its axis is zero; expected a direction, as xyz='0 0 1'")
    return [value / length for value in direction]


class Limits(NamedTuple):
    """The limits that a joint states: rad, rad/s, Nm (or m, m/s, N); infinite if none."""

    lower: float
    upper: float
    velocity: float
    effort: float


class UrdfTree:
    """The links and joints of a URDF, checked to be one tree.

    Args:
        text: the XML text.

    Attributes:
        element: the ``<robot>`` of what counts: links with inertia and shapes, joints, materials.
        links: the names of the links, in the order of the file.
        joints: the ``<joint>`` of each name, in the order of the file.
        root: the link that no joint carries.

    Raises:
        RobotError: if the text is not XML, not a URDF, or not one tree; if a name is there twice;
            if the place of a joint, or the mass of a link, is impossible.
    """

    def __init__(self, text: str) -> None:
        robot = parse(text)
        links, joints = robot.findall("link"), robot.findall("joint")
        self.links = _names("link", links)
        if not links:
            raise RobotError(f"the robot description has no <link>, as an SRDF; {EXPECTED}")
        self.joints = dict(zip(_names("joint", joints), map(_clean_joint, joints), strict=True))
        self.element = ET.Element("robot", name=robot.get("name", "robot"))
        self.element.extend(robot.findall("material"))
        self.element.extend([_clean_link(link) for link in links])
        self.element.extend(self.joints.values())
        self._above: dict[str, str] = {}  # link -> the joint that carries it
        self._connect()
        roots = [link for link in self.links if link not in self._above]
        if len(roots) != 1:
            raise RobotError(f"expected one root link, found {len(roots)}: {', '.join(roots[:20])}")
        self.root = roots[0]
        self._check_chains()

    def _connect(self) -> None:
        known = set(self.links)
        for name in self.joints:
            for end in ("parent", "child"):
                if self.end(name, end) not in known:
                    raise RobotError(f"joint '{name}': no link '{self.end(name, end)}' as {end}")
            if self.end(name, "child") in self._above:
                raise RobotError(f"link '{self.end(name, 'child')}' has two parents")
            self._above[self.end(name, "child")] = name

    def _check_chains(self) -> None:
        """Raise RobotError unless the root carries every link, by a chain that is not too long."""
        depth = {self.root: 0}
        for link in self.links:
            chain = [link]
            while chain[-1] not in depth:
                if len(chain) > _LONGEST_CHAIN:
                    raise RobotError(
                        f"link '{link}' is not carried by link '{self.root}', or by more than "
                        f"{_LONGEST_CHAIN} joints"
                    )
                chain.append(self.end(self._above[chain[-1]], "parent"))
            start = depth[chain[-1]]
            depth.update((above, start + n) for n, above in enumerate(reversed(chain)))
            if depth[link] > _LONGEST_CHAIN:
                raise RobotError(f"link '{link}' is carried by more than {_LONGEST_CHAIN} joints")

    def end(self, joint: str, end: str) -> str:
        """Return the link at the ``parent`` or at the ``child`` end of a joint."""
        return self.joints[joint].find(end).attrib["link"]  # type: ignore[union-attr]

    def link(self, name: str) -> str:
        """Return ``name``.

        Raises:
            UnknownNameError: if it is not a link.
        """
        if name not in self.links:
            raise UnknownNameError("frame", name, self.links)
        return name

    def carrier(self, link: str) -> ET.Element | None:
        """Return the joint that carries a link, None for the root."""
        return self.joints[self._above[link]] if link in self._above else None

    def chain(self, base: str, tip: str) -> list[str]:
        """Return the names of the joints from the link ``base`` to the link ``tip``.

        Raises:
            RobotError: if ``base`` does not carry ``tip``.
        """
        link, names = tip, list[str]()
        while link != base:
            if link not in self._above or len(names) == len(self.joints):
                raise RobotError(f"link '{tip}' is not carried by link '{base}'")
            names.append(self._above[link])
            link = self.end(names[-1], "parent")
        return names[::-1]

    def moving(self, base: str, tip: str) -> tuple[str, ...]:
        """Return the moving joints from ``base`` to ``tip`` that mimic no other.

        Raises:
            RobotError: if ``base`` does not carry ``tip``, or by a joint of an unknown type.
        """
        chain = [self.joints[name] for name in self.chain(base, tip)]
        for joint in chain:
            if (kind := joint.get("type")) not in _TYPES:
                unknown = UnknownNameError("type", kind, _TYPES)
                raise RobotError(f"joint '{joint.get('name')}': {unknown}")
        free = (j for j in chain if j.get("type") in MOVING and j.find("mimic") is None)
        return tuple(attribute(joint, "name") for joint in free)

    def moving_only(self, joints: Collection[str], shapes: Collection[str] = ()) -> ET.Element:
        """Return the ``<robot>`` in which only some joints move, for Pinocchio and PyBullet.

        The others are fixed at 0.  Nothing has friction.

        Args:
            joints: that move.
            shapes: which of "visual" and "collision" the links keep.

        Raises:
            RobotError: if the limits of one of the joints are impossible.
        """
        robot = ET.Element("robot", name="robot")
        robot.extend(self.element.findall("material") if shapes else ())
        for link in self.element.findall("link"):
            kept = ET.SubElement(robot, "link", link.attrib)
            kept.extend([part for part in link if part.tag in ("inertial", *shapes)])
        for name, joint in self.joints.items():
            moves = name in joints
            kind = joint.get("type", "") if moves else "fixed"
            kept = ET.SubElement(robot, "joint", name=name, type=kind)
            tags = ("origin", "parent", "child", *("axis",) * moves)
            kept.extend([part for part in joint if part.tag in tags])
            if moves:
                limits = (min(max(v, -NO_LIMIT), NO_LIMIT) for v in joint_limits(joint))
                stated = dict(zip(Limits._fields, map(repr, limits), strict=True))
                ET.SubElement(kept, "limit", stated)
        return copy.deepcopy(robot)


def _names(kind: str, elements: list[ET.Element]) -> list[str]:
    """Return the names of links or joints, in the order of the file.

    Raises:
        RobotError: if there are too many, or one is empty or there twice.
    """
    if len(elements) > _MOST_LINKS:
        raise RobotError(f"the URDF has {len(elements)} {kind}s; expected at most {_MOST_LINKS}")
    names = [attribute(element, "name") for element in elements]
    seen = set[str]()
    for name in names:
        if not name.strip():
            raise RobotError(f"a {kind} has an empty name")
        if len(name) > _LONGEST_NAME:
            raise RobotError(f"a {kind} has a name of {len(name)} characters; expected fewer")
        if name in seen:
            raise RobotError(f"two {kind}s have the name '{name}'; expected one")
        seen.add(name)
    return names


def joint_limits(joint: ET.Element) -> Limits:
    """Return the limits of a ``<joint>``, those of its ``<safety_controller>`` among them.

    Raises:
        RobotError: if it has none though it needs them, or if they are impossible.
    """
    with _naming(f"joint '{joint.get('name')}'"):
        if (kind := joint.get("type")) not in MOVING:
            raise RobotError(f"its type is '{kind}'; expected {', '.join(MOVING)}")
        turns, limit = kind == "continuous", joint.find("limit")
        if limit is None and turns:
            return Limits(-math.inf, math.inf, math.inf, math.inf)
        if limit is None:
            raise RobotError(
                f"its <limit> is missing; expected {_LIMIT} (one that turns without end is "
                "continuous)"
            )
        if lacks := [name for name in ("effort", "velocity") if name not in limit.attrib]:
            raise RobotError(f"its <limit> has no {' and no '.join(lacks)}; expected {_LIMIT}")
        lower, upper = (-math.inf, math.inf) if turns else _positions(joint, limit)
        limits = Limits(lower, upper, number(limit, "velocity"), number(limit, "effort"))
        if limits.velocity < 0.0 or limits.effort < 0.0:
            raise RobotError(
                f"its <limit> has velocity {limits.velocity:g}, effort {limits.effort:g}; expected "
                "more than 0"
            )
        return limits


def _positions(joint: ET.Element, limit: ET.Element) -> tuple[float, float]:
    """Return the lower and the upper limit of a joint that has them."""
    lower, upper = number(limit, "lower", "0"), number(limit, "upper", "0")
    if lower > upper:
        raise RobotError(f"its <limit> has lower {lower:g} above upper {upper:g}; swap them")
    soft = joint.find("safety_controller")
    if soft is None:
        return lower, upper
    stated = number(soft, "soft_lower_limit", "-inf"), number(soft, "soft_upper_limit", "inf")
    if stated == (0.0, 0.0):  # what exporters write who know none
        return lower, upper
    within = max(lower, stated[0]), min(upper, stated[1])
    if within[0] > within[1]:
        raise RobotError(
            f"the soft limits of its <safety_controller>, {stated[0]:g} ... {stated[1]:g}, leave "
            f"nothing of {lower:g} ... {upper:g}; expected a range within it"
        )
    return within


def refuse_motionless(joint: ET.Element) -> None:
    """Raise RobotError, with what helps, if the limits of a joint do not let it move."""
    limits = joint_limits(joint)
    name = f"joint '{joint.get('name')}' cannot move: its"
    if limits.lower == limits.upper:
        raise RobotError(
            f"{name} position limits are {limits.lower:g} ... {limits.upper:g} (what is not stated "
            f"is 0); expected {_LIMIT}, type='continuous' if it turns without end, or type='fixed'"
        )
    if limits.velocity == 0.0:
        raise RobotError(f"{name} velocity limit is 0; expected more, as {_LIMIT}")


def joint_friction(joint: ET.Element) -> tuple[float, float]:
    """Return the viscous [Nm s/rad] and the Coulomb friction [Nm] of a ``<joint>``.

    They are ``damping`` and ``friction`` of its ``<dynamics>``, 0 where it states none.

    Raises:
        RobotError: if one is not a finite number of 0 or more.
    """
    element = joint.find("dynamics")
    if element is None:
        return 0.0, 0.0
    with _naming(f"joint '{joint.get('name')}'"):
        viscous, coulomb = number(element, "damping", "0"), number(element, "friction", "0")
        if not (0.0 <= viscous < math.inf and 0.0 <= coulomb < math.inf):
            raise RobotError(
                f"its <dynamics> has damping {viscous:g}, friction {coulomb:g}; expected finite "
                "numbers of 0 or more"
            )
        return viscous, coulomb
