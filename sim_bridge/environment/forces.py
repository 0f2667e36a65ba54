"""Forces on the tool without a touch, and their sum."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.rotations import Array, cross
from sim_bridge.environment.base import Thing


class SensorMotion(NamedTuple):
    """Pose and velocity of the sensor frame, in base axes.

    Attributes:
        p: position of its origin, m; (3,).
        R: orientation, (3, 3).
        v: velocity of its origin, m/s; (3,).
        omega: angular velocity, rad/s; (3,).
    """

    p: Array
    R: Array
    v: Array
    omega: Array


class Force(Thing, ABC):
    """A thing that exerts a force and a moment on the tool."""

    @abstractmethod
    def exerted(self, t: float, sensor: SensorMotion) -> tuple[Array, Array]:
        """Return force [N] and moment [Nm] about the sensor's origin, (3,) each, base axes.

        Args:
            t: time at which it is there, s.
            sensor: where the tool is, and how it moves.
        """


def total_wrench(forces: Iterable[Force], t: float, sensor: SensorMotion) -> Array:
    """Return the sum of what they exert (6,), in the sensor's axes about its origin, N and Nm."""
    total = np.zeros((2, 3))
    for force in forces:
        if force.is_there(t):
            total += force.exerted(t, sensor)
    turned: Array = total.dot(sensor.R).ravel()  # rows, each turned by R'
    return turned


def at_point(f: Array, arm: Array) -> tuple[Array, Array]:
    """Return force and moment about the sensor's origin of f (3,) that acts ``arm`` from there."""
    return f, cross(arm, f)
