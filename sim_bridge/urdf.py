"""The URDF that PyBullet is given: the robot's own, made exact and complete.

PyBullet takes liberties with a URDF: a link without ``<inertial>`` gets 1 kg, a full
inertia tensor is diagonalised to 1e-6 only, one that no body can have becomes zero.
And its joint reaction counts the velocity terms of the mass beyond that joint twice.
So the text is edited before it is loaded:

- the mass of links that are fixed to each other is lumped, about principal axes;
- a massless link at the sensor frame carries what is distal, on a fixed joint.  With
  nothing but massless links beyond it, the reaction of that joint is exactly what
  touches them; weight and inertia of the load are added by the simulator;
- joints that do not belong to the arm are fixed at zero, and damping is left to the simulator.
"""

import math
import os.path
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import RobotError
from eulerparams_control.laws.orientation import EulerSequence
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.catalogue import RobotDescription
from eulerparams_control.robot.urdf import (
    NO_LIMIT,
    UrdfTree,
    attribute,
    numbers,
    text_of,
)

SENSOR_LINK = "_force_torque_sensor"
"""The massless link at the sensor frame; the fixed joint above it measures."""

_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


class Body(NamedTuple):
    """A rigid body seen from a frame.

    Attributes:
        mass: kg.
        com: centre of mass, m; (3,).
        inertia: about the centre of mass, axes of the frame, kg m^2; (3, 3).
    """

    mass: float
    com: Array
    inertia: Array

    @property
    def moments(self) -> Array:
        """The second moments of (x, y, z, 1) over the mass, (4, 4): J' = T J T^T."""
        h = np.append(self.com, 1.0)
        J = self.mass * np.outer(h, h)
        J[:3, :3] += 0.5 * np.trace(self.inertia) * np.eye(3) - self.inertia
        return J

    @classmethod
    def of_moments(cls, J: Array) -> "Body":
        """Return the body of these second moments (4, 4); those of several add."""
        mass = float(J[3, 3])
        com = J[:3, 3] / mass if mass > 0.0 else np.zeros(3)
        spread = J[:3, :3] - mass * np.outer(com, com)
        return cls(mass, com, np.trace(spread) * np.eye(3) - spread)


class SimulationUrdf(NamedTuple):
    """What the simulator loads, and what it must know besides.

    Attributes:
        text: the URDF.
        load: the body beyond the sensor, in the sensor frame.
        moments: principal moments of inertia of each link, kg m^2; (3,).
    """

    text: str
    load: Body
    moments: dict[str, Array]


class Placed(NamedTuple):
    """A shape in a frame.

    Attributes:
        geometry: the ``<geometry>``.
        position: m; 3.
        R: orientation, (3, 3).
    """

    geometry: ET.Element
    position: Sequence[float]
    R: Array

    def attach(self, link: ET.Element) -> None:
        """Let it be seen and touched as a part of a link, in whose frame it is."""
        for part in ("visual", "collision"):
            element = ET.SubElement(link, part)
            rpy = text_of(_rpy(self.R))
            ET.SubElement(element, "origin", xyz=text_of(self.position), rpy=rpy)
            element.append(self.geometry)


def simulation_urdf(
    robot: RobotDescription,
    tool: Body,
    *,
    stops: bool,
    shapes: Iterable[str],
    touching: Placed | None = None,
) -> SimulationUrdf:
    """Return the URDF of the robot with its sensor and its tool, as PyBullet must see it.

    Args:
        robot: the arm.
        tool: fixed to the sensor, in the sensor frame.
        stops: whether the joints end at their limits.
        shapes: which of "visual" and "collision" the links keep.
        touching: the shape of the tool in the sensor frame; None cannot be touched.

    Raises:
        RobotError: if a joint type is not supported, a joint of the arm moves beyond
            the sensor, or a mesh that is to be touched is not found.
    """
    tree = UrdfTree(robot.urdf)
    carried = {link: set(tree.chain(tree.root, link)) for link in tree.links}
    if blind := set(robot.joints) - carried[robot.sensor_frame]:
        raise RobotError(f"the sensor at '{robot.sensor_frame}' is not moved by {sorted(blind)}")
    root = tree.moving_only(robot.joints, tuple(shapes))
    for limit in () if stops else root.iter("limit"):
        limit.attrib.update(lower=repr(-NO_LIMIT), upper=repr(NO_LIMIT))
    for link in root.findall("link"):
        name = attribute(link, "name")
        if carried[name].isdisjoint(robot.joints):  # it touches nothing
            _drop(link, "collision")
        _find_meshes(link, robot.urdf_path)
    _insert_sensor(root, robot.sensor_frame)
    load, moments = _lump(root, tree.root, tool)
    _prune(root)
    if touching is not None:
        touching.attach(_link(root, SENSOR_LINK))
    return SimulationUrdf(_text(root), load, moments)


def solid_urdf(solid: Placed) -> str:
    """Return the URDF of a solid in the frame of its only link."""
    robot = ET.Element("robot", name="solid")
    link = ET.SubElement(robot, "link", name="solid")
    _write_body(link, Body(0.0, np.zeros(3), np.zeros((3, 3))))
    solid.attach(link)
    return _text(robot)


def _text(robot: ET.Element) -> str:
    """Return a URDF of short lines: PyBullet breaks those of 8191 characters anywhere."""
    ET.indent(robot, space="")
    return ET.tostring(robot, encoding="unicode")


def _link(root: ET.Element, name: str) -> ET.Element:
    return next(link for link in root.findall("link") if link.get("name") == name)


def _insert_sensor(root: ET.Element, frame: str) -> None:
    """Let a massless link at ``frame`` carry all that is distal to it.

    It goes below the fixed joint of ``frame``, or else on a fixed joint of its own.
    """
    joints = root.findall("joint")
    carrier = next((j for j in joints if _part(j, "child").get("link") == frame), None)
    if carrier is not None and carrier.get("type") == "fixed":
        _part(carrier, "child").set("link", SENSOR_LINK)
        _attach(root, SENSOR_LINK, frame)
    else:
        for joint in joints:
            if _part(joint, "parent").get("link") == frame:
                _part(joint, "parent").set("link", SENSOR_LINK)
        _attach(root, frame, SENSOR_LINK)
    ET.SubElement(root, "link", name=SENSOR_LINK)


def _attach(root: ET.Element, parent: str, child: str) -> None:
    """Add a fixed joint without offset."""
    joint = ET.SubElement(root, "joint", name=f"{parent}-{child}", type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)


def _lump(root: ET.Element, base: str, tool: Body) -> tuple[Body, dict[str, Array]]:
    """Move the mass of what is fixed to a link into that link.

    Returns:
        The body that the sensor link carried, and the principal moments of all links.
    """
    links = {attribute(link, "name"): link for link in root.findall("link")}
    J = {name: _read_body(link).moments for name, link in links.items()}  # (4, 4) each
    J[SENSOR_LINK] += tool.moments
    load = tool
    for joint in _leaves_first(root, base):
        child, parent = (attribute(_part(joint, end), "link") for end in ("child", "parent"))
        if child == SENSOR_LINK:
            load = Body.of_moments(J[child])
        if joint.get("type") == "fixed":
            T = _placement(joint)
            J[parent] += T @ J[child] @ T.T
            J[child] = np.zeros((4, 4))
    return load, {name: _write_body(link, Body.of_moments(J[name])) for name, link in links.items()}


def _leaves_first(root: ET.Element, link: str) -> Iterator[ET.Element]:
    """Yield the joints below a link, each after all that are below it."""
    for joint in root.findall("joint"):
        if _part(joint, "parent").get("link") == link:
            yield from _leaves_first(root, attribute(_part(joint, "child"), "link"))
            yield joint


def _prune(root: ET.Element) -> None:
    """Remove fixed leaves without shape, all massless by now: each costs time."""
    links = {attribute(link, "name"): link for link in root.findall("link")}
    parents = [_part(joint, "parent").get("link") for joint in root.findall("joint")]
    for joint in root.findall("joint[@type='fixed']"):
        child = attribute(_part(joint, "child"), "link")
        bare = links[child].find("visual") is None and links[child].find("collision") is None
        if bare and child != SENSOR_LINK and child not in parents:
            root.remove(joint)
            root.remove(links[child])
            return _prune(root)


def _read_body(link: ET.Element) -> Body:
    """Return the body of an ``<inertial>`` in the frame of its link, massless if none."""
    inertial = link.find("inertial")
    if inertial is None:
        return Body(0.0, np.zeros(3), np.zeros((3, 3)))
    T, entries = _placement(inertial), _part(inertial, "inertia")
    xx, xy, xz, yy, yz, zz = (float(attribute(entries, name)) for name in _INERTIA)
    mass = float(attribute(_part(inertial, "mass"), "value"))
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Body(mass, T[:3, 3], T[:3, :3] @ inertia @ T[:3, :3].T)


def _write_body(link: ET.Element, body: Body) -> Array:
    """State the principal axes of a link, and return its moments (3,).

    The text does not state the moments: PyBullet would refuse those that no body can have.
    """
    moments, axes = np.linalg.eigh(body.inertia)
    axes = axes * np.sign(np.linalg.det(axes))  # a rotation, not a reflection
    _drop(link, "inertial")
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=text_of(body.com), rpy=text_of(_rpy(axes)))
    ET.SubElement(inertial, "mass", value=repr(body.mass))
    ET.SubElement(inertial, "inertia", dict.fromkeys(_INERTIA, "0"))
    return moments


def _placement(element: ET.Element) -> Array:
    """Return the ``<origin>`` of an element as a homogeneous transform (4, 4)."""
    T = np.eye(4)
    if (origin := element.find("origin")) is not None:
        roll, pitch, yaw = numbers(origin, "rpy", "0 0 0")
        T[:3, :3] = EulerSequence("ZYX").R(np.array([yaw, pitch, roll]))
        T[:3, 3] = numbers(origin, "xyz", "0 0 0")
    return T


def _rpy(R: Array) -> tuple[float, float, float]:
    """Return roll, pitch, yaw; exact also where the pitch is pi / 2."""
    yaw = math.atan2(R[1, 0], R[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    return math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1]), pitch, yaw


def _find_meshes(link: ET.Element, urdf_path: Path) -> None:
    """Give the meshes of a link their paths: PyBullet reads the text from elsewhere.

    A link of which a picture is missing is not seen; what it touches with has to be there.
    """
    for shape in link.findall("visual") + link.findall("collision"):
        for mesh in shape.iter("mesh"):
            name = mesh.get("filename", "")
            path = _find_mesh(name, urdf_path)
            if path is not None:
                mesh.set("filename", str(path))
            elif shape.tag == "visual":
                link.remove(shape)
            else:
                raise RobotError(
                    f"link '{link.get('name')}': mesh '{name}' was not found from "
                    f"{urdf_path.parent}; expected its file there; or set collide_links and "
                    "gui to false"
                )


def _find_mesh(name: str, urdf_path: Path) -> Path | None:
    package = name.removeprefix("package://")
    folders = urdf_path.parents if package != name else urdf_path.parents[:1]
    paths = (folder / package.removeprefix("file://") for folder in folders)
    return next((path for path in paths if os.path.isfile(path)), None)  # whatever its name


def _part(element: ET.Element, name: str) -> ET.Element:
    part = element.find(name)
    if part is None:
        raise RobotError(f"a <{element.tag}> has no <{name}>")
    return part


def _drop(element: ET.Element, *names: str) -> None:
    for child in [child for child in element if child.tag in names]:
        element.remove(child)
