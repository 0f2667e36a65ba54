"""Geometric impedance control on SO(3), arXiv 2211.07945, is (59): the moments and the energies.

With R = R_d' R_c its moment is (K_R R - R' K_R)^vee in the axes of the compliant frame, of the
energy tr(K_R (I - R)).
"""

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.experiments.library.e1 import generator, rotations
from eulerparams_control.laws.orientation.euler_parameters import elastic_energy, elastic_moment
from eulerparams_control.laws.rotations import Array, quaternion

COUNT = 1000
_WANTED = np.diag([100.0, 10.0, 10.0])  # [Nm/rad]


def run() -> Result:
    """Return how far both are apart over random K_R, and which K_R a stiff axis needs."""
    halves = generator(71).normal(size=(COUNT, 3, 3))
    K_Rs = 20.0 * (halves + halves.mT) / 2  # any sign
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
        },
        Chart(
            "stiffest axis of K_o over the other two",
            "least eigenvalue of K_R over these",
            (
                Line("K_R = tr(K_o) I / 2 - K_o", tuple(zip(ratios.tolist(), least, strict=True))),
                Line("0: triangle inequality", ((1.0, 0.0), (100.0, 0.0)), "bound"),
            ),
            log="x",
        ),
    )


def K_R_of(K_o: Array) -> Array:
    """Return K_R (3, 3) with K_o = tr(K_R) I - K_R."""
    K_R: Array = np.trace(K_o) / 2 * np.eye(3) - K_o
    return K_R


def _apart(K_R: Array, R: Array) -> tuple[float, float]:
    """Return by what moments and energies differ; both moments in the compliant axes."""
    K_o, Q = np.trace(K_R) * np.eye(3) - K_R, quaternion(R)
    A = K_R @ R - R.T @ K_R
    geometric = np.array([A[2, 1], A[0, 2], A[1, 0]])
    moment = R.T @ elastic_moment(Q, K_o)
    energy = np.trace(K_R @ (np.eye(3) - R)) - elastic_energy(Q, K_o)
    return float(np.abs(geometric - moment).max()), abs(float(energy))
