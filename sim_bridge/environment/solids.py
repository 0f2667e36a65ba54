"""Solid things, which the tool touches: compliant, with friction.

What a sphere, a capsule or a box meets on a plane, a box, a sphere or the end of a cylinder is
exact to 1e-5.  What PyBullet does less well:

- a flat end of a cylinder on a face, or a cylinder or capsule lying along one, is half to
  2.5 times as stiff as stated, because PyBullet keeps older points;
- on the round side of a cylinder the depth is wrong by up to a thousandth of the radius of
  the tool, and the normal by up to 0.02 rad;
- edges of cylinders, and those of boxes against all but boxes and planes, are rounded by 1 mm;
- friction has its magnitude, but where the arm yields more in one direction than in another, it
  is up to 35 deg off the direction of sliding.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

from sim_bridge.environment.base import Thing
from sim_bridge.environment.keys import NO_TURN, ORIGIN, number, quaternion, vector

# A plane is the top of a box that is much larger than any arm, m: boxes touch each other at
# up to four points, but PyBullet's planes at one.
_WIDE, _DEEP = 200.0, 20.0

_MOST_FRICTION = 10.0  # PyBullet takes more for this


class Geometry(NamedTuple):
    """A shape of :mod:`sim_bridge.shapes`, in the frame of its solid.

    Attributes:
        name: of the shape.
        size: its numbers, m.
        center: m; 3.
    """

    name: str
    size: tuple[float, ...]
    center: tuple[float, ...] = ORIGIN


@dataclass(frozen=True, kw_only=True)
class Solid(Thing, ABC):
    """A solid that does not move.

    It pushes along its normal with stiffness times depth plus damping times its rate, and
    never pulls; a face has the mean depth of its points, see :mod:`sim_bridge.contacts`.
    Along its surface it holds what does not slide, with up to friction times that force,
    and brakes what does with as much.  One that comes where the tool is pushes with the depth
    that it finds.

    Attributes:
        position: of its origin, m; 3.
        orientation: x, y, z, w.
        stiffness: N/m.
        damping: Ns/m.
        friction: coefficient of Coulomb friction.
    """

    position: tuple[float, ...] = vector("m")
    orientation: tuple[float, ...] = quaternion(default=NO_TURN)
    stiffness: float = number("N/m", default=1e5, above=0.0)
    damping: float = number("Ns/m", default=1e3, least=0.0)
    friction: float = number(default=0.5, least=0.0, most=_MOST_FRICTION)

    @property
    @abstractmethod
    def geometry(self) -> Geometry:
        """What can be touched."""


@dataclass(frozen=True, kw_only=True)
class Box(Solid, shape="box"):
    """A box about its position.

    Attributes:
        size: its edges along x, y, z, m; 3.
    """

    size: tuple[float, ...] = vector("m", above=0.0)

    @property
    def geometry(self) -> Geometry:
        """The box."""
        return Geometry("box", self.size)


@dataclass(frozen=True, kw_only=True)
class Sphere(Solid, shape="sphere"):
    """A sphere about its position.

    Attributes:
        radius: m.
    """

    radius: float = number("m", above=0.0)

    @property
    def geometry(self) -> Geometry:
        """The sphere."""
        return Geometry("sphere", (self.radius,))


@dataclass(frozen=True, kw_only=True)
class Cylinder(Solid, shape="cylinder"):
    """A cylinder about its position, along its z axis.

    Attributes:
        radius, length: m.
    """

    radius: float = number("m", above=0.0)
    length: float = number("m", above=0.0)

    @property
    def geometry(self) -> Geometry:
        """The cylinder."""
        return Geometry("cylinder", (self.radius, self.length))


@dataclass(frozen=True, kw_only=True)
class Plane(Solid, shape="plane"):
    """A plane through its position; the side to which its z axis points is free."""

    @property
    def geometry(self) -> Geometry:
        """A box below the plane."""
        return Geometry("box", (_WIDE, _WIDE, _DEEP), (0.0, 0.0, -0.5 * _DEEP))
