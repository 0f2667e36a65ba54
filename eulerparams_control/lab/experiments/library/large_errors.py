"""How each law comes back from errors of 10 to 179.9 deg, all with the same slope at zero.

Dynamic control of a body of unit inertia at 1 kHz, (40) with f(theta) r for eps_de:
domega = -k_V omega - k_P f(theta) r, critically damped where theta is small.
"""

import math
from typing import Any

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.laws.orientation import OrientationOptions, SignRule, representation
from eulerparams_control.laws.orientation.base import OrientationRepresentation
from eulerparams_control.laws.rotations import Array, exp

ERRORS_DEG = (10.0, 45.0, 90.0, 135.0, 170.0, 179.9)
LAWS = {
    "rodrigues": lambda theta: 2 * math.tan(theta / 2),
    "modified_rodrigues": lambda theta: 4 * math.tan(theta / 4),
    "rotation_vector": lambda theta: theta,
    "euler_parameters": lambda theta: 2 * math.sin(theta / 2),
    "angle_axis": math.sin,
}
"""f(theta) by closed form; the vectors themselves come from the representations."""
K_P, K_V = 100.0, 20.0  # [1/s^2], [1/s]
_DT, _STEPS = 1e-3, 4000
_SETTLED = math.radians(1.0)


def run() -> Result:
    """Return times to settle, peak speeds and peak efforts of each law, and the worst of each."""
    found = {name: np.array(_all_errors(name)) for name in LAWS}  # (errors, 3)
    numbers = {}
    for name, all_errors in found.items():
        time, speed, effort = all_errors[-1].tolist()
        numbers[f"{name}_time"] = Number(time, f"{name} from 179.9 deg: time to 1 deg", "s")
        numbers[f"{name}_speed"] = Number(speed, f"{name} from 179.9 deg: peak speed", "rad/s")
        numbers[f"{name}_effort"] = Number(effort, f"{name}: peak effort per inertia", "rad/s^2")
    time = _all_errors("as_shipped_sliding")[-1][0]
    numbers["sliding_time"] = Number(time, "sliding variable from 179.9 deg: time to 1 deg", "s")
    small = np.array([f[0, 0] for f in found.values()])
    numbers["same_slope"] = Number(float(np.ptp(small) / small.mean()), "spread of times at 10 deg")
    first = {
        n: max(abs(f[i, 2] / _largest(n, e) - 1) for i, e in enumerate(ERRORS_DEG))
        for n, f in found.items()
        if n != "rodrigues"  # it goes beyond half a turn
    }
    text = "peak effort off k_P times the largest f on the way, relative"
    numbers["closed_form"] = Number(float(max(first.values())), text)
    lines = [Line(name, np.column_stack((ERRORS_DEG, f[:, 2]))) for name, f in found.items()]
    label = "peak effort per inertia [rad/s^2]"
    return Result(numbers, Chart("error at first [deg]", label, tuple(lines), log="y"))


def _all_errors(name: str) -> list[tuple[float, float, float]]:
    law = representation(name, OrientationOptions(sign=SignRule("hysteretic")))
    return [come_back(law, math.radians(error)) for error in ERRORS_DEG]


def come_back(law: OrientationRepresentation, theta_0: float) -> tuple[float, float, float]:
    """Return the time to 1 deg [s], the peak speed [rad/s] and the peak effort [rad/s^2]."""
    axis, theta, speed, x_de = np.array([0.0, 0.0, 1.0]), theta_0, 0.0, None
    time, fastest, strongest = 0.0, 0.0, 0.0
    for step in range(_STEPS):
        x_de = law.displacement(np.eye(3), exp(-theta * axis), x_de)
        pull = K_P / law.slope * float(_finite(x_de.error) @ axis)
        strongest = max(strongest, abs(pull))
        speed += _DT * _acceleration(law, x_de, speed * axis, pull)
        theta += _DT * speed
        fastest = max(fastest, abs(speed))
        left = abs(math.remainder(theta, 2 * math.pi))
        if left > _SETTLED:
            time = (step + 1) * _DT
        elif left < _SETTLED / 2 and abs(speed) < _SETTLED:
            break  # it only creeps on
    return time if time < _STEPS * _DT else math.inf, fastest, strongest


def _acceleration(law: OrientationRepresentation, x_de: Any, omega: Array, pull: float) -> float:
    """Return that of the error about z [rad/s^2], which turns by omega (3,)."""
    if law.name == "as_shipped_sliding":
        still = np.zeros(3)
        a = law.acceleration(x_de, still, still, -omega, K_P / law.slope, K_V)
        return -float(a[2])
    return float(-K_V * omega[2] - pull)


def _largest(name: str, error_deg: float) -> float:
    """Return k_P times the largest f(theta) on the way from an error to 0."""
    way = np.linspace(0.0, math.radians(error_deg), 1801)
    return K_P * max(map(LAWS[name], way.tolist()))


def _finite(error: Array) -> Array:
    return np.nan_to_num(error, nan=0.0)
