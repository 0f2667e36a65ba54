"""How far astray set-points 2 deg apart lead by component, over the direction of the tool axis."""

import math

import numpy as np
from matplotlib.colors import LogNorm
from numpy.random import Generator

from eulerparams_control.lab.experiments.library import Result
from eulerparams_control.lab.experiments.library._map import Column, Map, random_axis
from eulerparams_control.lab.experiments.library.set_points import STEP, astray
from eulerparams_control.laws.rotations import Array, exp

COLUMNS = (
    Column("vector", "rotation vector", "rotation_vector"),
    Column("xyz", "Euler angles XYZ", "euler_angles"),
    Column("zyz", "Euler angles ZYZ", "euler_angles", "ZYZ"),
    Column("quaternion", "quaternion, eta >= 0", "euler_parameters"),
    Column("modified", "modified Rodrigues", "modified_rodrigues"),
)
MAP = Map(COLUMNS, directions=5000, seed=8)
LOST = 45.0  # [deg] beyond which a set-point has nothing to do with the two beside it
_NEXT_TO = math.cos(math.radians(10.0))


def simulate(column: Column, _: float, R: Array, random: Generator) -> dict[str, float]:
    """Return how far [deg] what is between is off the geodesic, about a random axis."""
    R_2 = R @ exp(STEP * random_axis(random))
    return {"astray": astray(column.orientation, R, R_2, column.sequence)}


def result(outcomes: dict[str, Array]) -> Result:
    """Return the worst of each representation, and the share of steps that are lost."""
    off = outcomes["astray"][0, :, :, 0]
    lost = 100 * (off > LOST)
    down = lost[:, MAP.tool_axes[:, 2] < -_NEXT_TO].mean(axis=1)
    shares = zip(lost.mean(axis=1), down, strict=True)
    rows = {"": (np.maximum(off, 0.01), [f"{a:.1f} %, tool down {d:.1f} %" for a, d in shares])}
    numbers = MAP.numbers("worst", off.max(axis=1), "off the geodesic at worst", "deg")
    numbers |= MAP.numbers("down", down, f"steps off by more than {LOST:g} deg, tool down", "%")
    label, ticks = "off the way between two set-points [deg]", (0.01, 0.1, 1, 10, 180)
    return Result(numbers, MAP.spheres(rows, LogNorm(0.01, 180.0), "viridis", label, ticks))
