"""A URDF, whoever sent it: its text, its tree of links and joints, what its joints state.

Checked is what its readers let pass: Pinocchio drops an ``<inertial>`` that it cannot read, so that
the arm would be held with too little effort, and PyBullet takes the length of an ``<axis>`` for a
factor of the motion.  Both are given :meth:`UrdfTree.moving_only`, with numbers rewritten and axes
of length 1.  The text is read as the parser of ROS reads it, without its entities and files.
"""

import copy
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.parsers import expat

from eulerparams_control.errors import RobotError, UnknownNameError

MOVING = ("revolute", "continuous", "prismatic")  # the joint types of one degree of freedom
NO_LIMIT = 1e12  # stands for infinity where Pinocchio and PyBullet need a number
COULOMB_SPEED = 0.05  # [rad/s] Coulomb friction is tanh(dq / COULOMB_SPEED); a step would chatter

_TYPES = (*MOVING, "fixed", "floating", "planar")
_PLACE = ("origin", "parent", "child", "axis")
_LIMITS = ("lower", "upper", "velocity", "effort")
_LARGEST = 1e9  # [m, kg, kg m^2] beyond it numbers would overflow sooner or later
_ROUNDING = -1e-9  # [kg m^2] of the inertia of a point
_INERTIAL = (  # element, least number, attributes
    ("mass", 0.0, ("value",)),
    ("inertia", _ROUNDING, ("ixx", "iyy", "izz")),
    ("inertia", -_LARGEST, ("ixy", "ixz", "iyz")),
)

# Beyond these Pinocchio (a chain of 5000 links) and PyBullet (a name of 3000) end the process.
_MOST_LINKS = 1000
_LONGEST_NAME = 1000  # characters

_URDF = "expected the text of a URDF, <robot name=...> ... </robot>"
_CONTENT = (
    f"{_URDF}: set what is in the file, in a launch file by Command(['xacro ', FILE]), "
    "elsewhere in a parameter file, as the block after 'robot_description: |2'"
)
_LIMIT = 'expected <limit lower="-3.1" upper="3.1" effort="100" velocity="2"/>'
_NO_XML = (
    (r"$", "empty"),
    (r"(\w+://|~?\.{0,2}/)[^\n]*$|[^<>\n]*\.(urdf|xacro|xml|sdf|usda?)$", "a path"),
    (r"\$\(|xacro ", "a command that was not run"),
    (r"---|%YAML|[\w/*.~-]+:\s", "YAML"),
    ("", "no XML"),
)
_DEFINITIONS = ("xacro:property", "xacro:arg", "xacro:macro")  # do no harm where nothing uses them


def read_urdf(path: Path) -> str:
    """Return the text of a file, in UTF-8 or else in Latin 1; raises OSError."""
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise OSError(f"{path} is no file")
    data = path.read_bytes()
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def parse(text: str) -> ET.Element:
    """Return the ``<robot>`` of a text; prefixes stay in the names of elements, as ROS has them."""
    text = text.strip("\ufeff \t\r\n")
    if not text.startswith("<"):
        kind = next(kind for pattern, kind in _NO_XML if re.match(pattern, text))
        raise RobotError(f"the robot description is {kind}, '{text[:80]}'; {_CONTENT}")
    if re.search(r"<!DOCTYPE[^>]*(SYSTEM|PUBLIC|\[)", text):  # entities grow without bound
        raise RobotError("not a URDF: it has a DOCTYPE with entities or a file; remove it")
    builder, parser = ET.TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, ValueError) as error:  # the latter for text that no file can have
        raise RobotError(f"not valid XML: {error}; {_CONTENT}") from error
    robot = builder.close()
    if robot.tag != "robot":
        raise RobotError(f"the robot description is no URDF: its root is <{robot.tag}>; {_URDF}")
    for part in robot:
        if part.tag.startswith(("link", "joint", "xacro:")) and part.tag not in _DEFINITIONS:
            _refuse_xacro(part)
    return robot


def _refuse_xacro(part: ET.Element) -> None:
    for element in part.iter():
        for text in (f"<{element.tag}>", *element.attrib.values()):
            if re.search(r"^<xacro:|\$[{(]", text) and element.tag != "mesh":
                raise RobotError(
                    f"the robot description is xacro that was not expanded: it has {text}; expand "
                    "it: xacro FILE.xacro > FILE.urdf, in a launch file Command(['xacro ', FILE])"
                )


@contextmanager
def _naming(element: ET.Element) -> Iterator[None]:
    """Let a refusal begin with the link or joint that it is about."""
    try:
        yield
    except RobotError as error:
        raise RobotError(f"{element.tag} '{element.get('name')}': {error}") from error


def attribute(element: ET.Element, name: str) -> str:
    """Return an attribute; raises RobotError if there is none of this name."""
    value = element.get(name)
    if value is None:
        raise RobotError(f"a <{element.tag}> has no attribute '{name}'")
    return value


def numbers(
    element: ET.Element, name: str, default: str = "", count: int = 3, least: float = -_LARGEST
) -> list[float]:
    """Return the numbers of an attribute; raises RobotError if they are none, or out of bounds."""
    text = element.get(name, default)
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(least <= x <= max(_LARGEST, -least) for x in values):
        one = "a number of 0 or more" if least >= _ROUNDING else "a number"
        kinds = {1: f"{one}, as 0.5 or 1e-3", 3: "three numbers with blanks, as '0 0 0.5'"}
        expected = kinds.get(count, f"{count} numbers")
        raise RobotError(f"{name} of its <{element.tag}> is '{text}'; expected {expected}")
    return values


def _number(element: ET.Element, name: str, default: str = "0") -> float:
    return numbers(element, name, default, 1, -math.inf)[0]


def text_of(values: Iterable[float]) -> str:
    """Return numbers as URDF has them, without loss."""
    return " ".join(repr(float(value)) for value in values)


def _check_place(element: ET.Element) -> None:
    for origin in element.findall("origin"):
        for name in ("xyz", "rpy"):
            origin.set(name, text_of(numbers(origin, name, "0 0 0")))


def _check_link(link: ET.Element) -> None:
    for inertial in link.findall("inertial"):
        _check_place(inertial)
        for tag, least, names in _INERTIAL:
            part = next(inertial.iter(tag), ET.Element(tag))
            for name in names:
                part.set(name, text_of(numbers(part, name, "", 1, least)))


def _check_joint(joint: ET.Element) -> None:
    _check_place(joint)
    axis = joint.find("axis")
    if attribute(joint, "type") in MOVING:
        axis = ET.SubElement(joint, "axis") if axis is None else axis
        direction = numbers(axis, "xyz", "1 0 0")
        length = math.hypot(*direction)
        if length < 1e-9:
            raise RobotError("its axis is zero; expected a direction, as xyz='0 0 1'")
        axis.set("xyz", text_of(value / length for value in direction))
    elif axis is not None:
        joint.remove(axis)


def _checked(robot: ET.Element, tag: str) -> dict[str, ET.Element]:
    """Return the links or joints by their names; numbers are rewritten, axes of length 1."""
    named: dict[str, ET.Element] = {}
    for element in robot.findall(tag):
        name = attribute(element, "name")
        if name in named:
            raise RobotError(f"two {tag}s have the name '{name}'; expected one")
        if len(name) > _LONGEST_NAME:
            raise RobotError(f"a {tag} has a name of {len(name)} characters; shorten it")
        named[name] = element
        with _naming(element):
            (_check_link if tag == "link" else _check_joint)(element)
    if len(named) > _MOST_LINKS:
        raise RobotError(f"the URDF has {len(named)} {tag}s; expected at most {_MOST_LINKS}")
    return named


class UrdfTree:
    """The links and joints of a URDF, checked to be one tree; RobotError if they are not.

    Attributes:
        element: the ``<robot>``, only of links, joints and materials.
        links: the names of the links, in the order of the file.
        joints: the ``<joint>`` of each name, in the order of the file.
        root: the link that no joint carries.
    """

    def __init__(self, text: str) -> None:
        self.element = robot = parse(text)
        for part in list(robot):
            if part.tag not in ("link", "joint", "material"):
                robot.remove(part)
        self.links, self.joints = list(_checked(robot, "link")), _checked(robot, "joint")
        if not self.links:
            raise RobotError(f"the robot description has no <link>, as an SRDF; {_URDF}")
        self._above: dict[str, str] = {}  # link -> the joint that carries it
        for joint in self.joints:
            for end in ("parent", "child"):
                if (link := self.end(joint, end)) not in self.links:
                    raise RobotError(f"joint '{joint}': no link '{link}' as {end}")
            child = self.end(joint, "child")
            if child in self._above:
                raise RobotError(f"link '{child}' has two parents; expected one")
            self._above[child] = joint
        roots = [link for link in self.links if link not in self._above]
        if len(roots) != 1:
            raise RobotError(f"expected one root link, found {len(roots)}: {', '.join(roots[:20])}")
        self.root = roots[0]
        for link in self.links:
            self.chain(self.root, link)

    def kind(self, joint: str) -> str:
        """Return the type of a joint."""
        return self.joints[joint].attrib["type"]

    def end(self, joint: str, end: str) -> str:
        """Return the link at the ``parent`` or at the ``child`` end of a joint."""
        element = self.joints[joint].find(end)
        return "" if element is None else element.get("link", "")

    def link(self, name: str, parameter: str) -> str:
        """Return ``name``; raises RobotError if it is not a link."""
        if name not in self.links:
            raise RobotError(f"{parameter}: {UnknownNameError('frame', name, self.links)}")
        return name

    def chain(self, base: str, tip: str) -> list[str]:
        """Return the joints from ``base`` to ``tip``, a link that ``base`` has to carry."""
        link, names = tip, list[str]()
        while link != base:
            if link not in self._above or len(names) > len(self.joints):  # a loop
                raise RobotError(f"link '{tip}' is not carried by link '{base}'")
            names.append(self._above[link])
            link = self.end(names[-1], "parent")
        return names[::-1]

    def moving(self, base: str, tip: str, joints: Collection[str] = ()) -> tuple[str, ...]:
        """Return the joints from ``base`` to ``tip`` that move and mimic none; or ``joints``."""
        chain = self.chain(base, tip)
        for name in chain:
            if (kind := self.kind(name)) not in _TYPES:
                raise RobotError(f"joint '{name}': {UnknownNameError('type', kind, _TYPES)}")
        free = [name for name in chain if self.joints[name].find("mimic") is None]
        moving = tuple(name for name in free if self.kind(name) in MOVING)
        for name in joints:
            if name not in moving:
                raise RobotError(f"joints: {UnknownNameError('joint', name, moving)}")
        return tuple(name for name in moving if name in joints or not joints)

    def moving_only(self, joints: Collection[str], shapes: Collection[str] = ()) -> ET.Element:
        """Return the ``<robot>`` in which only ``joints`` move, the others are fixed at 0.

        Nothing has friction; of "visual" and "collision" links keep their ``shapes``.
        """
        robot = ET.Element("robot", name="robot")
        robot.extend(self.element.findall("material") if shapes else ())
        for link in self.element.findall("link"):
            kept = ET.SubElement(robot, "link", link.attrib)
            kept.extend([part for part in link if part.tag in ("inertial", *shapes)])
        for name, joint in self.joints.items():
            kind = self.kind(name) if name in joints else "fixed"
            kept = ET.SubElement(robot, "joint", name=name, type=kind)
            kept.extend([part for part in joint if part.tag in _PLACE])
            if name in joints:
                limit = ET.SubElement(kept, "limit")
                for bound, value in zip(_LIMITS, joint_limits(joint), strict=True):
                    limit.set(bound, repr(min(max(value, -NO_LIMIT), NO_LIMIT)))
        return copy.deepcopy(robot)


def joint_limits(joint: ET.Element) -> tuple[float, float, float, float]:
    """Return lower, upper, velocity and effort limit [rad or m, and s, Nm or N]; inf is none."""
    turns, limit = joint.get("type") == "continuous", joint.find("limit")
    if turns and limit is None:
        return -math.inf, math.inf, math.inf, math.inf
    with _naming(joint):
        if limit is None or not {"velocity", "effort"} <= set(limit.keys()):
            raise RobotError(
                f"its <limit> has no velocity or no effort; {_LIMIT} (a joint that turns "
                "without end is continuous, and needs none)"
            )
        lower, upper, velocity, effort = (_number(limit, name) for name in _LIMITS)
        soft = joint.find("safety_controller")
        if turns:
            lower, upper = -math.inf, math.inf
        elif soft is not None:
            low = _number(soft, "soft_lower_limit", "-inf")
            high = _number(soft, "soft_upper_limit", "inf")
            if (low, high) != (0.0, 0.0):  # what exporters write who know none
                lower, upper = max(lower, low), min(upper, high)
        if lower > upper or velocity < 0.0 or effort < 0.0:
            raise RobotError(
                f"its limits are {lower:g} ... {upper:g} (by its <safety_controller>, too), "
                f"velocity {velocity:g}, effort {effort:g}; expected the lower before the upper, "
                "and no negative velocity or effort"
            )
        return lower, upper, velocity, effort


def refuse_motionless(joint: ET.Element) -> None:
    """Raise RobotError, with what helps, if the limits of a joint do not let it move."""
    lower, upper, velocity, _ = joint_limits(joint)
    if lower == upper or velocity == 0.0:
        raise RobotError(
            f"joint '{joint.get('name')}' cannot move: its limits are {lower:g} ... {upper:g}, its "
            f"velocity limit {velocity:g} (what is not stated is 0); {_LIMIT}, "
            "type='continuous' if it turns without end, or type='fixed'"
        )


def joint_friction(joint: ET.Element) -> tuple[float, float]:
    """Return damping [Nm s/rad] and friction [Nm] of its ``<dynamics>``, 0 if it states none."""
    dynamics = next(joint.iter("dynamics"), ET.Element("dynamics"))
    with _naming(joint):
        return _number(dynamics, "damping"), _number(dynamics, "friction")
