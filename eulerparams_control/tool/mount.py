"""The place of the force/torque sensor on the arm, and what it carries by the URDF."""

from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import RobotError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import Robot, carried_by
from eulerparams_control.robot.urdf import UrdfTree


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
        RobotError: if the URDF is broken, a frame is none of its links, or joints move between
            sensor and tip.
    """

    def __init__(
        self, urdf: str, sensor_frame: str, tip_frame: str, joints: tuple[str, ...] = ()
    ) -> None:
        tree = UrdfTree(urdf)
        self.frame = tree.link(sensor_frame, "sensor_frame")
        self.tip_frame = tree.link(tip_frame, "tip_frame")
        between = set(tree.moving(tree.root, sensor_frame)) ^ set(tree.moving(tree.root, tip_frame))
        if between:
            raise RobotError(
                f"{', '.join(sorted(between))} moves between the sensor at '{sensor_frame}' and "
                f"the tip_frame '{tip_frame}'; expected a tip_frame that is fixed to the sensor"
            )
        self._robot = Robot(urdf, "", sensor_frame, joints)
        self.joints = self._robot.joints
        self.R, self.p = Robot(urdf, "", tip_frame, joints).placement(sensor_frame)
        body = carried_by(tree, sensor_frame)
        self.carried = Carried(body.mass, body.com)

    def orientation(self, q: Array) -> Array:
        """Return R_s (3, 3), the orientation of the sensor frame in root axes, for q (n,)."""
        return self._robot.state(q, np.zeros(len(q))).R_e

    def in_tip(self, point: Array) -> Array:
        """Return in the tip frame a point (3,) [m] that is given in the sensor frame."""
        return self.R @ point + self.p
