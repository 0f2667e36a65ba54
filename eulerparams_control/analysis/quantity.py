"""A quantity over time: its unit, its meaning, its equation."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from eulerparams_control.analysis.recording import Recording
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import Robot


@dataclass(frozen=True)
class Curves:
    """What all quantities over time have.

    Attributes:
        name: by which an experiment can name it.
        title: of the plot.
        label: of its axis, with the unit; {sequence} stands for the Euler angles.
        caption: what it means, and the equation it belongs to.
        unit: for single values.
        floor: values below are rounding, not motion; 0 never makes the axis logarithmic.
        of: returns instants (N,) [s] and values; both empty if nothing was recorded.
    """

    name: str
    title: str
    label: str
    caption: str
    unit: str
    floor: float
    of: Callable[[Recording], tuple[Array, Array]]


@dataclass(frozen=True)
class Quantity(Curves):
    """A quantity of a run over time, values (N,).

    Attributes:
        limits: returns (n,) limits of the URDF to draw; None has none.
        logarithmic: whether the axis is logarithmic in any case.
        group: its heading in the page.
    """

    limits: Callable[[Robot], Array] | None = None
    logarithmic: bool = False
    group: str = "Over time"


@dataclass(frozen=True)
class JointQuantity(Curves):
    """A quantity of each joint over time, values (N, n).

    Attributes:
        limits: returns (n,) limits of the URDF to draw.
        group: its heading in the page.
    """

    limits: Callable[[Robot], Array]
    group: str = "Each joint"


@dataclass(frozen=True)
class VectorQuantity(Curves):
    """The components of a quantity over time, values (N, m).

    Attributes:
        components: the names of the m components.
        group: its heading in the page.
    """

    components: tuple[str, ...] = ("x", "y", "z")
    group: str = "Components"


type AnyQuantity = Quantity | VectorQuantity | JointQuantity


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
