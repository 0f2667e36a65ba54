"""The solids around the robot, and how stiff they are where it touches them.

PyBullet gives each point of a contact the force

    f = k (depth_k - dt v_k+1) - d v_k+1 >= 0,

with depth_k before and v_k+1, the speed of separation, after the step.  A face would be as
many times too stiff as it has points: the stiffness K and the damping of a solid are divided
by n = (sum of depths)^2 / sum of depths^2, which is their number if they are equally deep and
passes over to it without a jump if not.  At rest the sum of their forces is K times the mean
depth, in which each depth weighs as much as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim_bridge.engine import Engine
from sim_bridge.environment import Solid
from sim_bridge.environment.keys import rotation
from sim_bridge.shapes import geometry
from sim_bridge.urdf import Placed


@dataclass
class _Contact:
    """A solid, PyBullet's body of it, n, and whether it is there."""

    solid: Solid
    body: int
    n: float = 1.0
    is_there: bool = True


class Contacts:
    """The solids around a robot; without friction until told otherwise.

    Args:
        engine: the robot.
        solids: by their names.
        single: whether nothing touches a solid at more than one point.

    Attributes:
        bodies: PyBullet's body of each solid.
    """

    def __init__(self, engine: Engine, solids: Mapping[str, Solid], *, single: bool) -> None:
        self._engine = engine
        self._is_single = single or not solids
        self._rubs = False
        self.bodies = {name: engine.add_solid(_placed(solid)) for name, solid in solids.items()}
        self._contacts = [_Contact(solid, self.bodies[name]) for name, solid in solids.items()]
        for contact in self._contacts:
            self._set(contact)

    def rub(self, whether: bool) -> None:
        """Let there be friction from now on, or not.

        Where motors hold the arm, how much of its weight friction carries is undetermined, and
        PyBullet lets it bear much.  So brakes hold without friction, and the sensor feels
        nothing but the solid; a servo that follows a reference has to live with it.
        """
        if whether != self._rubs:
            self._rubs = whether
            for contact in self._contacts:
                self._set(contact)

    def prepare(self, t: float) -> None:
        """Let the solids come and go, and share their stiffness among the points that touch.

        In the step from ``t`` [s] on.
        """
        for contact in self._contacts:
            if contact.is_there != contact.solid.is_there(t):
                contact.is_there = not contact.is_there
                self._engine.let_touch(contact.body, contact.is_there)
        if self._is_single:
            return
        self._engine.find_contacts()
        for contact in self._contacts:
            n = _number(self._engine.depths(contact.body))
            if n != contact.n:
                contact.n = n
                self._set(contact)

    def _set(self, contact: _Contact) -> None:
        solid, n = contact.solid, contact.n
        friction = solid.friction if self._rubs else 0.0
        self._engine.set_contact(contact.body, solid.stiffness / n, solid.damping / n, friction)


def _number(depths: list[float]) -> float:
    """Return n; before anything touches, how many points may do so within the step."""
    touching = [depth for depth in depths if depth > 0.0]
    if not touching:
        return max(1.0, len(depths))
    return sum(touching) ** 2 / sum(depth * depth for depth in touching)


def _placed(solid: Solid) -> Placed:
    R = rotation(solid.orientation)
    shape = solid.geometry
    position = np.array(solid.position) + R @ shape.center
    return Placed(geometry(shape.name, shape.size), position.tolist(), R)
