"""Errors next to 180 deg: noise that works against the arm, and the long way round, by sign rule.

The arm turns at k f(theta) r, (28), about one axis; the noise turns what is measured by 0.02 rad,
each time towards the other side.
"""

import math

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.laws.orientation import SIGNS, OrientationOptions, SignRule, representation
from eulerparams_control.laws.rotations import Array, exp

LAWS = ("euler_parameters", "modified_rodrigues", "rotation_vector")
NOISE = 0.02  # [rad]
K = 4.0  # [1/s], over the slope
_START = math.pi - 0.001
_DT, _STEPS, _SHOWN = 1e-3, 5000, 100  # 5 s


def run() -> Result:
    """Return where the error is after 5 s of noise, and how far it turns from the long way."""
    numbers, lines = {}, []
    for name in LAWS:
        for sign in SIGNS:
            theta = noisy(name, SignRule(sign))
            left = abs(math.remainder(theta[-1], 2 * math.pi))
            text = f"{name}, {sign}: error after 5 s"
            numbers[f"{name}_{sign}"] = Number(math.degrees(left), text, "deg")
            if name == LAWS[0]:
                points = np.column_stack((_DT * np.arange(len(theta)), np.degrees(theta)))
                lines.append(Line(sign, points[::_SHOWN], markers=False))
        for sign in ("hysteretic", "continuous"):
            text = f"{name}, {sign}: turn from an error of 2 deg, eta < 0"
            numbers[f"{name}_{sign}_turn"] = Number(unwound(name, sign), text, "deg")
    return Result(numbers, Chart("time [s]", "error [deg]", tuple(lines)))


def noisy(name: str, sign: SignRule) -> Array:
    """Return the error (N,) [rad] over time, its noise against it."""
    law, axis = representation(name, OrientationOptions(sign=sign)), np.array([0.0, 0.0, 1.0])
    theta, x_de, found = _START, None, []
    for _ in range(_STEPS):
        found.append(theta)
        other_side = math.copysign(NOISE, math.pi - theta % (2 * math.pi))
        x_de = law.displacement(exp((theta + other_side) * axis), np.eye(3), x_de)
        theta -= _DT * K / law.slope * float(x_de.error @ axis)
    return np.array(found)


def unwound(name: str, sign: str) -> float:
    """Return how far [deg] it turns from an error of 2 deg that has come with eta < 0."""
    law = representation(name, OrientationOptions(sign=SignRule(sign)))
    axis, theta = np.array([0.0, 0.0, 1.0]), math.radians(2.0)
    x_de = law.displacement(exp(theta * axis), np.eye(3))
    x_de = x_de._replace(Q_de=-x_de.Q_de)
    way = 0.0
    for _ in range(_STEPS):
        x_de = law.displacement(exp(theta * axis), np.eye(3), x_de)
        step = _DT * K / law.slope * float(x_de.error @ axis)
        # the parameters of 360 deg are without bound: no faster than a half turn in a step
        step = math.copysign(min(abs(step), 0.01), step)
        theta, way = theta - step, way + abs(step)
    return math.degrees(way)
