"""The apparent stiffness of the compliant frame over the tool axis, K_o = k I: (58), (62).

Small moments about the axes of K_o are applied to the compliance law until it is at rest.
"""

import math

import numpy as np
from matplotlib.colors import LogNorm

from eulerparams_control.errors import SingularityError
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.experiments.library._map import COLUMNS, Column, Map
from eulerparams_control.laws.compliant_frame import ComplianceLaw, CompliantFrame
from eulerparams_control.laws.impedance_matrices import Impedance, damping_of_ratio
from eulerparams_control.laws.rotations import Array, log
from eulerparams_control.motion.frames import DesiredFrame

MAP = Map(COLUMNS, directions=120, seed=4)
K_O = 100.0 * np.eye(3)  # [Nm/rad]
MOMENTS = 1e-3 * K_O  # [Nm], small
_RATE = 20.0  # [1/s] of the critically damped impedance
_DT, _STEPS = 5e-3, 160  # 0.8 s
_AT_REST = 0.02  # [rad/s]


def simulate(column: Column, _: float, R_d: Array, _random: object) -> dict[str, float]:
    """Return the smallest and the largest apparent over chosen stiffness.

    The apparent stiffness is the inverse of the matrix of turns by moment.
    """
    M_o = K_O / _RATE**2
    Z = Impedance(M_o, damping_of_ratio(M_o, K_O, 1.0), K_O)
    law = ComplianceLaw(column.representation, Z, Z)
    try:
        turns = np.array([turn(law, R_d, R_d @ mu) for mu in MOMENTS])
        apparent = np.linalg.inv(np.linalg.solve(MOMENTS, turns).T)
        relative = np.linalg.eigvalsh((apparent + apparent.T) / 2 / K_O[0, 0])
    except (SingularityError, np.linalg.LinAlgError):
        return {"smallest": math.nan, "largest": math.nan}
    return {"smallest": float(relative[0]), "largest": float(relative[-1])}


def turn(law: ComplianceLaw, R_d: Array, mu: Array) -> Array:
    """Return the rotation vector (3,) of R_d' R_c at rest under mu, base frame; NaN if it moves."""
    desired, frame = DesiredFrame(np.zeros(3), R_d), CompliantFrame(law)
    wrench = np.concatenate((np.zeros(3), mu))
    for _ in range(_STEPS):
        compliant = frame.step(_DT, desired, wrench)
    is_at_rest = np.abs(compliant.omega_d).max() < _AT_REST
    return log(R_d.T @ compliant.R_d) if is_at_rest else np.full(3, math.nan)


def result(outcomes: dict[str, Array]) -> Result:
    """Return the ranges of all representations; of Euler angles k/(1+s) to k/(1-s) by (58)."""
    rows: dict[str, tuple[Array, list[str]]] = {}
    numbers: dict[str, Number] = {}
    for name, extreme in (("largest", np.nanmax), ("smallest", np.nanmin)):
        values = outcomes[name][0, :, :, 0]
        rows[name] = values, [f"{np.nanmin(v):.2f} to {np.nanmax(v):.2f}" for v in values]
        numbers |= MAP.numbers(name, extreme(values, axis=1), f"{name} apparent over chosen")
    label, ticks = "apparent stiffness / K_o  [1]", (1 / 16, 1 / 4, 1 / 2, 1, 2, 4, 16)
    return Result(numbers, MAP.spheres(rows, LogNorm(1 / 16, 16), "PuOr", label, ticks, "both"))
