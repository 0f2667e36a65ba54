"""The place of the force/torque sensor on the arm, and what it carries by the URDF."""

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import RobotError
from eulerparams_control.laws.orientation import EulerSequence
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import Robot
from eulerparams_control.robot.urdf import UrdfTree, attribute


class Carried(NamedTuple):
    """What is beyond the sensor.

    Attributes:
        mass: [kg].
        com: (3,) [m] centre of mass, sensor frame; 0 if there is no mass.
    """

    mass: float
    com: Array

    def without(self, other: "Carried") -> "Carried":
        """Return what is left when a part of it, or all, is taken away."""
        mass = self.mass - other.mass
        moment = self.mass * self.com - other.mass * other.com
        return Carried(mass, moment / mass if mass else 0.0 * moment)


class SensorMount:
    """A sensor on an arm, rigidly connected to the tip.

    Args:
        urdf: the text of the URDF.
        sensor_frame: link whose axes and origin the wrench refers to.
        tip_frame: link that the tool is given in.
        joints: names of the active joints; () is all that move between root and sensor.

    Attributes:
        frame, tip_frame: as given.
        joints: the active joints, base to tip.
        R, p: orientation (3, 3) and origin (3,) [m] of the sensor frame in the tip frame.
        carried: what the links of the URDF beyond the sensor weigh.

    Raises:
        UnknownNameError: if one of the frames is no link of the URDF.
        RobotError: if the URDF is broken, or if joints move between sensor and tip.
    """

    def __init__(
        self, urdf: str, sensor_frame: str, tip_frame: str, joints: tuple[str, ...] = ()
    ) -> None:
        tree = UrdfTree(urdf)
        self.frame, self.tip_frame = tree.link(sensor_frame), tree.link(tip_frame)
        between = set(tree.moving(tree.root, sensor_frame)) ^ set(tree.moving(tree.root, tip_frame))
        if between:
            raise RobotError(
                f"{', '.join(sorted(between))} moves between the sensor at '{sensor_frame}' and "
                f"the tip_frame '{tip_frame}'; expected a tip_frame that is fixed to the sensor"
            )
        self._robot = Robot(urdf, "", sensor_frame, joints)
        self.joints = self._robot.joints
        zero = np.zeros(self._robot.n)
        sensor = self._robot.state(zero, zero)
        tip = Robot(urdf, "", tip_frame, joints).state(zero, zero)
        self.R, self.p = tip.R_e.T @ sensor.R_e, tip.R_e.T @ (sensor.p_e - tip.p_e)
        self.carried = carried(tree, sensor_frame)

    def orientation(self, q: Array) -> Array:
        """Return R_s (3, 3), the orientation of the sensor frame in root axes, for q (n,)."""
        return self._robot.state(q, np.zeros(len(q))).R_e

    def in_tip(self, point: Array) -> Array:
        """Return in the tip frame a point (3,) [m] that is given in the sensor frame."""
        return self.R @ point + self.p


def carried(tree: UrdfTree, frame: str) -> Carried:
    """Return what the links weigh that ``frame`` carries, with their joints at 0.

    The link ``frame`` itself counts if it is on a fixed joint: then it is a place on the link
    before; else it is the last link of the arm, on which the sensor sits.

    Raises:
        RobotError: if an ``<inertial>`` or an ``<origin>`` is malformed.
    """
    joint = tree.carrier(frame)
    counts = joint is not None and joint.get("type") == "fixed"
    mass, moment = _subtree(tree, frame, np.eye(4), counts)
    return Carried(mass, moment / mass if mass else moment)


def _subtree(tree: UrdfTree, link: str, T: Array, counts: bool = True) -> tuple[float, Array]:
    """Return mass [kg] and its first moment (3,) [kg m] of a link at T (4, 4) and beyond."""
    mass, moment = _own(tree, link, T) if counts else (0.0, np.zeros(3))
    for name, joint in tree.joints.items():
        if tree.end(name, "parent") == link:
            more = _subtree(tree, tree.end(name, "child"), T @ _placement(joint))
            mass, moment = mass + more[0], moment + more[1]
    return mass, moment


def _own(tree: UrdfTree, link: str, T: Array) -> tuple[float, Array]:
    """Return mass and first moment of one link at T (4, 4)."""
    element = tree.element.find(f"link[@name='{link}']/inertial")
    if element is None:
        return 0.0, np.zeros(3)
    part = element.find("mass")
    (mass,) = _numbers("" if part is None else attribute(part, "value"), 1, link)
    return mass, mass * (T @ _placement(element))[:3, 3]


def _placement(element: ET.Element) -> Array:
    """Return the ``<origin>`` of an element as a homogeneous transform (4, 4)."""
    T = np.eye(4)
    origin = element.find("origin")
    if origin is not None:
        roll, pitch, yaw = _numbers(origin.get("rpy", "0 0 0"), 3, element.tag)
        T[:3, :3] = EulerSequence("ZYX").R(np.array([yaw, pitch, roll]))
        T[:3, 3] = _numbers(origin.get("xyz", "0 0 0"), 3, element.tag)
    return T


def _numbers(text: str, count: int, where: str) -> list[float]:
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise RobotError(
            f"'{where}' has '{text}' in its inertial or origin; expected {count} numbers"
        )
    return numbers
