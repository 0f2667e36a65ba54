"""A quantity over time: its unit, its meaning, its equation."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import BagError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import Robot

XYZ = ("x", "y", "z")
"""The components of a vector."""

JOINTS = ("each joint",)
"""In place of components: one for each joint of the arm."""


@dataclass(frozen=True)
class Quantity:
    """A quantity of a run over time: values (N,), or (N, m) of components or joints.

    Attributes:
        name: by which an experiment can name it.
        title: of the plot.
        label: of its axis, with the unit; {sequence} stands for the Euler angles.
        caption: what it means, and the equation it belongs to.
        unit: for single values.
        floor: values below are rounding, not motion; 0 never makes the axis logarithmic.
        of: returns instants (N,) [s] and values; raises BagError if it was not recorded.
        limits: returns (n,) limits of the URDF to draw; None has none.
        components: the names of the m components, or ``JOINTS``; () is one line.
        group: its heading in the page.
        logarithmic: whether the axis is logarithmic in any case.
    """

    name: str
    title: str
    label: str
    caption: str
    unit: str
    floor: float
    of: Callable[[Recording], tuple[Array, Array]]
    limits: Callable[[Robot], Array] | None = None
    components: tuple[str, ...] = ()
    group: str = "Over time"
    logarithmic: bool = False

    @property
    def is_of_joints(self) -> bool:
        """Whether its components are joints."""
        return self.components is JOINTS

    @property
    def is_vector(self) -> bool:
        """Whether its components are others."""
        return bool(self.components) and not self.is_of_joints

    def samples(self, recording: Recording) -> tuple[Array, Array]:
        """Return instants (N,) [s] and values; both empty if it was not recorded."""
        try:
            return self.of(recording)
        except BagError:
            return np.zeros(0), np.zeros(0)


type _Vector = tuple[str, str, str, str, str, float, Callable[[Recording], tuple[Array, Array]]]


def vectors(
    group: str, *given: _Vector, components: tuple[str, ...] = XYZ
) -> tuple[Quantity, ...]:
    """Return quantities with components, under one heading, of what is given from name to of."""
    return tuple(Quantity(*each, components=components, group=group) for each in given)


class Prediction(NamedTuple):
    """Prediction of theory for a quantity, drawn dashed.

    Attributes:
        quantity: its name.
        text: what it is, with its equation.
        t: (M,) [s] instants.
        y: (M,) values in the unit of the quantity.
        name: of the line.
    """

    quantity: str
    text: str
    t: Array
    y: Array
    name: str = "predicted"
