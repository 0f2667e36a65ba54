"""Kind "set_points": how far astray set-points lead that are interpolated by component."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm

from eulerparams_control.lab.maps.base import (
    MapKind,
    MapVariant,
    Picture,
    Row,
    Table,
    of_variant,
)
from eulerparams_control.lab.maps.sampling import over_directions, random_axis, with_tool_axis
from eulerparams_control.lab.maps.spheres import WHERE, spheres
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    angle_between,
    exp,
    matrix,
    quaternion,
    rotation_vector,
)
from sim_bridge.environment.keys import number

_SHARES = np.linspace(0.0, 1.0, 41)[:, None]
_LOST = 45.0  # [deg] beyond which a set-point has nothing to do with the two beside it
_NEXT_TO = math.cos(math.radians(10.0))


@dataclass(frozen=True, kw_only=True)
class SetPointsMap(MapKind):
    """Two set-points next to each other, in the coordinates of a representation of R itself.

    ``samples`` counts the directions of the tool axis; roll and axis of the step are random.

    Attributes:
        step: [deg] from one set-point to the next.
    """

    kind = "set_points"

    step: float = number(default=2.0, least=0.0)

    def cells(self) -> list[Row]:
        """Return variants x directions."""
        return over_directions(len(self.variants), self.samples)

    def simulate(self, cell: Row) -> dict[str, float]:
        """Return how far [deg] what is between them is off the nearer one, the step apart."""
        random = self.random(cell)
        z = np.array([cell["x"], cell["y"], cell["z"]], dtype=float)
        R = with_tool_axis(z, random.uniform(-math.pi, math.pi))
        step = exp(math.radians(self.step) * random_axis(random))
        return {"astray": astray(self.variant(cell), R, R @ step)}

    def pictures(self, table: Table) -> list[Picture]:
        """Return the sphere of each representation, and the share of steps that are lost."""
        cells, found = [], []
        for i, variant in enumerate(self.variants):
            part = of_variant(table, i)
            off = part["astray"]
            down = off[part["z"] < -_NEXT_TO]
            share, lost = 100 * np.mean(off > _LOST), 100 * np.mean(down > _LOST)
            cells.append((part, np.maximum(off, 0.01), f"{share:.1f} %, tool down {lost:.1f} %"))
            found.append(f"{variant.label} {off.max():.0f}° ({lost:.1f} % of tool down)")
        label, ticks = "off the way between two set-points [deg]", (0.01, 0.1, 1, 10, 180)
        figure = spheres(self, {"": cells}, LogNorm(0.01, 180.0), "viridis", label, ticks)
        caption = (
            f"Two set-points {self.step:g} deg apart at each direction of {WHERE}, about a random "
            "axis, interpolated by component: the farthest from the geodesic. Below: the share "
            f"that is off by more than {_LOST:g} deg, of all and within 10 deg of tool down. The "
            "geodesic is off by nothing."
        )
        return [Picture("set_points", "At worst astray by " + ", ".join(found), caption, figure)]


def astray(variant: MapVariant, R_1: Array, R_2: Array) -> float:
    """Return the largest angle [deg] of what is between R_1 and R_2 off the geodesic."""
    step = rotation_vector(quaternion(R_1.T @ R_2))
    geodesic = R_1 @ exp(_SHARES * step)
    return math.degrees(float(angle_between(geodesic, between(variant, R_1, R_2)).max()))


def between(variant: MapVariant, R_1: Array, R_2: Array, shares: Array = _SHARES) -> Array:
    """Return rotations (N, 3, 3) from R_1 to R_2 by component, at shares (N, 1) of the way.

    Components are those of R itself: theta r, 2 tan(theta/2) r, 4 tan(theta/4) r, {eta, eps} with
    eta >= 0, or Euler angles, which are not wrapped.
    """
    name, sequence = variant.orientation, variant.representation.options.sequence
    if name == "euler_angles":
        x = _way(sequence.extract(R_1), sequence.extract(R_2), shares)
        axes = ("XYZ".index(letter) for letter in variant.sequence)
        i, j, k = (exp(x[:, n, None] * np.eye(3)[axis]) for n, axis in enumerate(axes))
        R: Array = i @ j @ k
        return R
    Q_1, Q_2 = quaternion(R_1), quaternion(R_2)
    if name == "rotation_vector":
        return exp(_way(rotation_vector(Q_1), rotation_vector(Q_2), shares))
    to, back = _OF_Q[name]
    Q = back(_way(to(Q_1), to(Q_2), shares))
    Q = Q / np.linalg.norm(Q, axis=1, keepdims=True)
    eta: Any = Q[:, 0]
    return matrix(EulerParameters(eta, Q[:, 1:]))


def _way(x_1: Array, x_2: Array, shares: Array) -> Array:
    return x_1 + shares * (x_2 - x_1)


def _unreduced(scalar: Array, vector: Array) -> Array:
    return np.hstack([np.broadcast_to(scalar, (len(vector), 1)), vector])


_OF_Q: dict[str, tuple[Callable[[EulerParameters], Array], Callable[[Array], Array]]] = {
    "euler_parameters": (lambda Q: np.array([Q.eta, *Q.eps]), lambda x: x),
    "rodrigues": (lambda Q: Q.eps / Q.eta, lambda x: _unreduced(np.ones(1), x)),
    "modified_rodrigues": (
        lambda Q: Q.eps / (1 + Q.eta),
        lambda x: _unreduced(1 - (x * x).sum(axis=1, keepdims=True), 2 * x),
    ),
}
"""From a quaternion to components, and from these to one, its norm left open."""
