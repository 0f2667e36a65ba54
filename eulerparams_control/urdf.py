"""A URDF as the tree of links and joints that it must be."""

import math
import xml.etree.ElementTree as ET
from typing import NamedTuple

from eulerparams_control.errors import RobotError, UnknownNameError

MOVING = ("revolute", "continuous", "prismatic")
"""The types of joints of one degree of freedom."""


COULOMB_SPEED = 0.05
"""Coulomb friction is tanh(dq / COULOMB_SPEED) [rad/s] of its value; a step would chatter."""


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
        RobotError: if the text is not XML, not a URDF, or not one tree; if the limits
            of a joint are impossible.
    """

    def __init__(self, text: str) -> None:
        self.element = _parse(text)
        self.links = [attribute(link, "name") for link in self.element.findall("link")]
        self.joints = {attribute(j, "name"): j for j in self.element.findall("joint")}
        self._above: dict[str, str] = {}  # link -> the joint that carries it
        for name, joint in self.joints.items():
            for end in ("parent", "child"):
                if self.end(name, end) not in self.links:
                    raise RobotError(f"joint '{name}': no link '{self.end(name, end)}' as {end}")
            if self.end(name, "child") in self._above:
                raise RobotError(f"link '{self.end(name, 'child')}' has two parents")
            self._above[self.end(name, "child")] = name
            joint_limits(joint)
        roots = [link for link in self.links if link not in self._above]
        if len(roots) != 1:
            raise RobotError(f"expected one root link, found {len(roots)}: {', '.join(roots)}")
        self.root = roots[0]
        for link in self.links:
            self.chain(self.root, link)

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


def attribute(element: ET.Element, name: str) -> str:
    """Return an attribute.

    Raises:
        RobotError: if there is none of this name.
    """
    value = element.get(name)
    if value is None:
        raise RobotError(f"a <{element.tag}> has no attribute '{name}'")
    return value


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
            -math.inf if default == "inf" else float(stated.get("lower", default)),
            math.inf if default == "inf" else float(stated.get("upper", default)),
            float(stated.get("velocity", "inf")),
            float(stated.get("effort", "inf")),
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
        viscous, coulomb = float(stated.get("damping", 0)), float(stated.get("friction", 0))
    except ValueError as error:
        raise RobotError(f"dynamics of joint '{joint.get('name')}': {error}") from error
    if not (0.0 <= viscous < math.inf and 0.0 <= coulomb < math.inf):
        raise RobotError(
            f"dynamics of joint '{joint.get('name')}': damping {viscous}, friction {coulomb}; "
            "expected finite numbers of 0 or more"
        )
    return viscous, coulomb


def _parse(text: str) -> ET.Element:
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise RobotError(f"not valid XML: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"not a URDF: the root element is <{root.tag}>, expected <robot>")
    return root
