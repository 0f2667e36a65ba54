"""E2: near the pole the analytical Jacobian (24) is ill-conditioned, the geometric one is not."""

import math

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.experiments.library._arms import T1, ur5
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.orientation import EulerSequence

DELTAS_DEG = (30.0, 10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01)
_NEAR = 10.0  # [deg] up to which the slope is taken


def run() -> Result:
    """Return the condition numbers of both Jacobians on T1 at 2 s over the distance delta."""
    numbers = np.array([condition_numbers(math.radians(delta)) for delta in DELTAS_DEG])
    cond_J_A, cond_J = numbers.T
    near = np.array(DELTAS_DEG) <= _NEAR
    slope = float(np.polyfit(np.log(np.array(DELTAS_DEG)[near]), np.log(cond_J_A[near]), 1)[0])
    at = dict(zip(DELTAS_DEG, cond_J_A.tolist(), strict=True))
    return Result(
        {
            "slope": Number(slope, "slope of log cond(J_A) over log delta"),
            "cond_J": Number(float(cond_J.max()), "largest cond(J)"),
            "cond_J_A_10": Number(at[10.0], "cond(J_A) 10 deg from the pole"),
            "cond_J_A_1": Number(at[1.0], "cond(J_A) 1 deg from the pole"),
            "cond_J_A_0_1": Number(at[0.1], "cond(J_A) 0.1 deg from the pole"),
        },
        Chart(
            "distance to the pole of XYZ, delta [deg]",
            "condition number",
            (
                Line("slope -1", tuple((d, at[1.0] / d) for d in DELTAS_DEG), "predicted"),
                Line("cond(J) < 10", ((DELTAS_DEG[-1], 10.0), (DELTAS_DEG[0], 10.0)), "bound"),
                Line("cond(J_A), eq. (24)", np.column_stack((DELTAS_DEG, cond_J_A))),
                Line("cond(J)", np.column_stack((DELTAS_DEG, cond_J))),
            ),
            log="xy",
        ),
    )


def condition_numbers(delta: float) -> tuple[float, float]:
    """Return cond(J_A) and cond(J) of the UR5 on T1 at 2 s, delta [rad] from the pole of XYZ.

    With the end at 130 deg T1 is at 90 deg then, its closest approach.
    """
    robot, home = ur5()
    frame = T1(delta, end=math.radians(130)).sample(2.0)
    J = robot.state(inverse_kinematics(robot, frame, home), np.zeros(robot.n)).J
    sequence = EulerSequence("XYZ")
    T = sequence.T(sequence.extract(frame.R_d))
    J_A = np.vstack((J[:3], np.linalg.solve(T, J[3:])))  # eq. (24)
    return float(np.linalg.cond(J_A)), float(np.linalg.cond(J))
