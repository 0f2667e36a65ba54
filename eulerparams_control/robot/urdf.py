"""A URDF as the tree of links and joints that it must be, whoever sent it.

Its XML is parsed without entities, files or endless nesting.  The mass of a link is checked:
Pinocchio leaves out an ``<inertial>`` that it cannot read and goes on with a massless link, so
that the arm would be held with too little effort, and PyBullet takes it for another one.
"""

import math
import xml.etree.ElementTree as ET
from typing import NamedTuple, NoReturn

from eulerparams_control.errors import RobotError, UnknownNameError

LARGEST = 1e9
"""No length, mass or inertia of an arm is larger; what is would overflow sooner or later."""

_LONGEST_TEXT = 64_000_000  # characters
_DEEPEST = 50  # elements within elements; robots have seven

_ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

# Entries of bodies that are points have a rounded zero on their diagonal [kg m^2].
_ROUNDING = 1e-9

MOVING = ("revolute", "continuous", "prismatic")
"""The types of joints of one degree of freedom."""

_TYPES = (*MOVING, "fixed", "floating", "planar")

# More than any robot has: parsers in C++ go down a chain by recursion, until the stack is full.
_MOST_LINKS = 5000
_LONGEST_CHAIN = 200

COULOMB_SPEED = 0.05
"""Coulomb friction is tanh(dq / COULOMB_SPEED) [rad/s] of its value; a step would chatter."""


class _Builder(ET.TreeBuilder):
    """Builds the tree; refuses what a URDF does not need and a hostile one has."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def doctype(self, *_: object) -> NoReturn:
        """Refuse a DOCTYPE: only by it come entities, which grow without bound or name files."""
        raise RobotError("not a URDF: it has a DOCTYPE; remove it")

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        """Begin an element."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise RobotError(f"not a URDF: more than {_DEEPEST} elements within each other")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        """End an element."""
        self._depth -= 1
        return super().end(tag)


def parse(text: str) -> ET.Element:
    """Return the ``<robot>`` of an XML text.

    Raises:
        RobotError: if it is not XML, not a URDF, longer or deeper than a URDF is, or has a DOCTYPE.
    """
    if len(text) > _LONGEST_TEXT:
        raise RobotError(f"the URDF has {len(text)} characters; expected at most {_LONGEST_TEXT}")
    try:
        root = ET.fromstring(text, parser=ET.XMLParser(target=_Builder()))
    except (ET.ParseError, ValueError) as error:  # the latter for text that no file can have
        raise RobotError(f"not valid XML: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"not a URDF: the root element is <{root.tag}>, expected <robot>")
    return root


def attribute(element: ET.Element, name: str) -> str:
    """Return an attribute.

    Raises:
        RobotError: if there is none of this name.
    """
    value = element.get(name)
    if value is None:
        raise RobotError(f"a <{element.tag}> has no attribute '{name}'")
    return value


def number(text: str) -> float:
    """Return a number as URDF has it; Python's ``1_0`` or digits of other scripts are none.

    Raises:
        ValueError: if it is none.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"could not convert string to float: {text!r}")
    return float(text)


def numbers(element: ET.Element, name: str, default: str) -> list[float]:
    """Return the three numbers of an attribute, each finite and at most ``LARGEST``.

    Raises:
        RobotError: if they are not.
    """
    text = element.get(name, default)
    try:
        values = [number(word) for word in text.split()]
    except ValueError as error:
        raise RobotError(f"{name} of a <{element.tag}>: {error}") from error
    if len(values) != 3 or not all(map(is_plausible, values)):
        raise RobotError(
            f"{name} of a <{element.tag}> is '{text}'; expected three numbers up to {LARGEST:g}"
        )
    return values


def is_plausible(value: float) -> bool:
    """Return whether a value is finite and not larger than ``LARGEST``."""
    return math.isfinite(value) and abs(value) <= LARGEST


def check_inertial(link: ET.Element) -> None:
    """Check the ``<inertial>`` of a link; a link without one has no mass.

    Raises:
        RobotError: if mass or inertia is not stated, is no finite number, or is negative.
    """
    inertial = link.find("inertial")
    if inertial is None:
        return
    try:
        _check_origin(inertial)
        mass = _value(inertial, "mass", "value")
        entries = {name: _value(inertial, "inertia", name) for name in _ENTRIES}
    except (ValueError, RobotError) as error:
        raise RobotError(f"inertial of link '{link.get('name')}': {error}") from error
    negative = {name: entries[name] for name in ("ixx", "iyy", "izz") if entries[name] < -_ROUNDING}
    if mass < 0 or negative:
        raise RobotError(
            f"inertial of link '{link.get('name')}': mass {mass:g} kg, negative moments "
            f"{negative or 'none'}; expected 0 or more"
        )


def _check_origin(inertial: ET.Element) -> None:
    origin = inertial.find("origin")
    if origin is not None:
        numbers(origin, "xyz", "0 0 0")
        numbers(origin, "rpy", "0 0 0")


def _value(inertial: ET.Element, part: str, name: str) -> float:
    element = inertial.find(part)
    if element is None:
        raise RobotError(f"a <{inertial.tag}> has no <{part}>")
    value = number(attribute(element, name))
    if not is_plausible(value):
        raise RobotError(f"{name} of <{part}> is {value:g}; expected a finite number")
    return value


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
        element: the parsed ``<robot>``.
        links: the names of the links, in the order of the file.
        joints: the ``<joint>`` of each name, in the order of the file.
        root: the link that no joint carries.

    Raises:
        RobotError: if the text is not XML, not a URDF, or not one tree; if a name is there twice;
            if the limits or the place of a joint, or the mass of a link, are impossible.
    """

    def __init__(self, text: str) -> None:
        self.element = parse(text)
        links, joints = self.element.findall("link"), self.element.findall("joint")
        self.links = _names("link", links)
        self.joints = dict(zip(_names("joint", joints), joints, strict=True))
        self._above: dict[str, str] = {}  # link -> the joint that carries it
        self._connect()
        for link in links:
            check_inertial(link)
        roots = [link for link in self.links if link not in self._above]
        if len(roots) != 1:
            raise RobotError(f"expected one root link, found {len(roots)}: {', '.join(roots[:20])}")
        self.root = roots[0]
        self._check_chains()

    def _connect(self) -> None:
        known = set(self.links)
        for name, joint in self.joints.items():
            for end in ("parent", "child"):
                if self.end(name, end) not in known:
                    raise RobotError(f"joint '{name}': no link '{self.end(name, end)}' as {end}")
            if self.end(name, "child") in self._above:
                raise RobotError(f"link '{self.end(name, 'child')}' has two parents")
            self._above[self.end(name, "child")] = name
            _check_joint(name, joint)

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
        element = self.joints[joint].find(end)
        if element is None:
            raise RobotError(f"joint '{joint}' has no <{end}>")
        return attribute(element, "link")

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
        """Return the moving joints from ``base`` to ``tip`` that mimic no other."""
        chain = [self.joints[name] for name in self.chain(base, tip)]
        free = (j for j in chain if j.get("type") in MOVING and j.find("mimic") is None)
        return tuple(attribute(joint, "name") for joint in free)


def _names(kind: str, elements: list[ET.Element]) -> list[str]:
    """Return the names of links or joints, in the order of the file.

    Raises:
        RobotError: if there are too many, or one is empty, there twice, or that of Pinocchio's
            own joint.
    """
    if len(elements) > _MOST_LINKS:
        raise RobotError(f"the URDF has {len(elements)} {kind}s; expected at most {_MOST_LINKS}")
    names = [attribute(element, "name") for element in elements]
    seen = set[str]()
    for name in names:
        if not name.strip():
            raise RobotError(f"a {kind} has an empty name")
        if name in seen:
            raise RobotError(f"two {kind}s have the name '{name}'; expected one")
        if kind == "joint" and name == "universe":
            raise RobotError("a joint has the name 'universe', which Pinocchio keeps for itself")
        seen.add(name)
    return names


def _check_joint(name: str, joint: ET.Element) -> None:
    """Raise RobotError if type, axis, place or limits of a joint are impossible."""
    kind = attribute(joint, "type")
    if kind not in _TYPES:
        raise RobotError(f"joint '{name}': {UnknownNameError('type', kind, _TYPES)}")
    try:
        for element in joint.findall("origin"):
            numbers(element, "xyz", "0 0 0")
            numbers(element, "rpy", "0 0 0")
        axis = joint.find("axis")
        if axis is not None and not any(numbers(axis, "xyz", "1 0 0")) and kind in MOVING:
            raise RobotError("its axis is zero; expected a direction")
        _check_limit(kind, joint.find("limit"))
    except RobotError as error:
        raise RobotError(f"joint '{name}': {error}") from error
    joint_limits(joint)


def _check_limit(kind: str, limit: ET.Element | None) -> None:
    """Raise RobotError if a joint that moves lacks what Pinocchio and PyBullet ask for."""
    if kind not in MOVING or (kind == "continuous" and limit is None):
        return
    stated = {} if limit is None else limit.attrib
    if lacks := [name for name in ("effort", "velocity") if name not in stated]:
        what = "<limit> is missing" if limit is None else f"<limit> has no {' and no '.join(lacks)}"
        raise RobotError(
            f"its {what}; expected <limit lower=... upper=... effort=... velocity=.../> of a joint "
            f"that is {kind} (one that turns without end is continuous)"
        )


def joint_limits(joint: ET.Element) -> Limits:
    """Return the limits of a ``<joint>``.

    Raises:
        RobotError: if one is not a number, negative where it must not be, or if the
            lower one exceeds the upper one.
    """
    element = joint.find("limit")
    stated = {} if element is None else element.attrib
    default = "inf" if element is None or joint.get("type") == "continuous" else "0"
    try:
        limits = Limits(
            -math.inf if default == "inf" else number(stated.get("lower", default)),
            math.inf if default == "inf" else number(stated.get("upper", default)),
            number(stated.get("velocity", "inf")),
            number(stated.get("effort", "inf")),
        )
    except ValueError as error:
        raise RobotError(f"limits of joint '{joint.get('name')}': {error}") from error
    if not (limits.lower <= limits.upper and limits.velocity >= 0.0 and limits.effort >= 0.0):
        raise RobotError(f"impossible limits of joint '{joint.get('name')}': {limits}")
    return limits


def joint_friction(joint: ET.Element) -> tuple[float, float]:
    """Return the viscous [Nm s/rad] and the Coulomb friction [Nm] of a ``<joint>``.

    They are ``damping`` and ``friction`` of its ``<dynamics>``, 0 where it states none.

    Raises:
        RobotError: if one is not a finite number of 0 or more.
    """
    element = joint.find("dynamics")
    stated = {} if element is None else element.attrib
    try:
        viscous, coulomb = number(stated.get("damping", "0")), number(stated.get("friction", "0"))
    except ValueError as error:
        raise RobotError(f"dynamics of joint '{joint.get('name')}': {error}") from error
    if not (0.0 <= viscous < math.inf and 0.0 <= coulomb < math.inf):
        raise RobotError(
            f"dynamics of joint '{joint.get('name')}': damping {viscous}, friction {coulomb}; "
            "expected finite numbers of 0 or more"
        )
    return viscous, coulomb
