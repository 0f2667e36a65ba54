"""Geometric impedance control on SO(3), arXiv 2211.07945, is (59): the moments and the energies.

With R = R_d' R_c its moment is (K_R R - R' K_R)^vee in the axes of the compliant frame, of the
energy tr(K_R (I - R)).
"""

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.as_shipped.laws import LAMBDA, K_R_of, geometric_moment
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.experiments.library._rest import at_rest
from eulerparams_control.lab.experiments.library.e1 import generator, rotations
from eulerparams_control.laws.orientation import representation
from eulerparams_control.laws.orientation.euler_parameters import EulerParametersRepresentation
from eulerparams_control.laws.rotations import Array, angle_between, quaternion

COUNT = 1000
_WANTED, _REACHED = np.diag([100.0, 10.0, 10.0]), np.diag([100.0, 50.0, 50.0])  # [Nm/rad]
K_O, D_O = np.diag([55.0, 45.0, 20.0]), 10.0  # [Nm/rad], [Nms/rad]
MU, MU_SOFT = np.array([-8.0, 5.66025404, 10.19615242]), np.array([0.0, 4.0, 0.0])  # [Nm]


def run() -> Result:
    """Return how far both are apart over random K_R, and which K_R a stiff axis needs."""
    halves = generator(71).normal(size=(COUNT, 3, 3))
    K_Rs = 20.0 * (halves + np.swapaxes(halves, 1, 2)) / 2  # any sign
    apart = np.array([_apart(K_R, R) for K_R, R in zip(K_Rs, rotations(COUNT, 72), strict=True)])
    ratios = np.geomspace(1.0, 100.0, 41)
    least = [float(np.linalg.eigvalsh(K_R_of(np.diag([k, 1.0, 1.0])))[0]) for k in ratios]
    return Result(
        {
            "moment": Number(float(apart[:, 0].max()), "largest difference of the moments", "Nm"),
            "energy": Number(float(apart[:, 1].max()), "largest difference of the energies", "J"),
            "least_K_R": Number(
                float(np.linalg.eigvalsh(K_R_of(_WANTED))[0]),
                "least eigenvalue of the K_R for K_o = diag(100, 10, 10)",
                "Nm/rad",
            ),
            "bound": Number(
                float(np.interp(0.0, -np.array(least), ratios)),
                "stiff axis over the other two from which on K_R is not positive",
            ),
            **_turns(),
        },
        Chart(
            "stiffest axis of K_o over the other two",
            "least eigenvalue of K_R over these",
            (
                Line("K_R = tr(K_o) I / 2 - K_o", np.column_stack((ratios, least))),
                Line("0: triangle inequality", ((1.0, 0.0), (100.0, 0.0)), "bound"),
            ),
            log="x",
        ),
    )


def _turns() -> dict[str, Number]:
    """Return how far a moment turns the laws: those of the experiment geometric_contact.

    At rest version 2 has f + LAMBDA D_o f = mu.
    """
    laws = {"version_1": ("euler_parameters", 1.0), "intuitive": ("as_shipped_sin", 1.0)}
    laws["version_2"] = "euler_parameters", 1.0 + LAMBDA * D_O
    found = {of: _turn(name, K_O, MU, factor) for of, (name, factor) in laws.items()}
    found["wanted"] = _turn("euler_parameters", _WANTED, MU_SOFT)
    found["reached"] = _turn("euler_parameters", _REACHED, MU_SOFT)
    return {of: Number(turn, f"turn by the moment, {of}", "deg") for of, turn in found.items()}


def _turn(name: str, K_o: Array, mu: Array, factor: float = 1.0) -> float:
    """Return the angle [deg] at which a law, times a factor, balances a moment (3,)."""
    law = representation(name)

    def moment(R: Array) -> Array:
        spring = law.spring(np.eye(3), R, K_o)
        total: Array = factor * spring.moment + mu
        return total

    return float(np.degrees(angle_between(np.eye(3), at_rest(moment, np.eye(3)))))


def _apart(K_R: Array, R: Array) -> tuple[float, float]:
    """Return by what moments and energies differ; both moments in the compliant axes."""
    law, K_o, Q = EulerParametersRepresentation(), np.trace(K_R) * np.eye(3) - K_R, quaternion(R)
    moment = geometric_moment(R, K_R) - R.T @ law.elastic_moment(*Q, K_o)
    energy = np.trace(K_R @ (np.eye(3) - R)) - law.elastic_energy(Q, K_o)
    return float(np.abs(moment).max()), abs(float(energy))
