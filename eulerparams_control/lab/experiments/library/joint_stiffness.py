"""The stiffness that joints feel, -d tau / dq with tau = J' w: symmetric if w is of an energy."""

import numpy as np

import eulerparams_control.lab.as_shipped.laws  # noqa: F401  registers its laws
from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.experiments.library._arms import ur5
from eulerparams_control.laws.orientation import ORIENTATIONS, representation
from eulerparams_control.laws.rotations import Array, exp
from eulerparams_control.robot.robot import Robot

SHIPPED = ("as_shipped_eps", "as_shipped_theta", "as_shipped_sin")
ANGLES_DEG = (0.0, 5.0, 10.0, 20.0, 30.0, 45.0, 60.0)
K_O = np.diag([50.0, 20.0, 5.0])  # [Nm/rad]
_AXIS = np.array([0.6, -0.48, 0.64])
_STEP = 1e-6  # [rad]


def run() -> Result:
    """Return the asymmetry of each law, the tool turned off the desired frame by some angles."""
    robot, home = ur5()
    found = {
        name: [asymmetry(robot, home, name, angle) for angle in ANGLES_DEG]
        for name in (*ORIENTATIONS, *SHIPPED)
    }
    at = ANGLES_DEG.index(30.0)
    numbers = {
        "gradients": Number(
            max(max(found[name]) for name in ORIENTATIONS), "largest, of all representations"
        ),
        "aligned": Number(max(found[name][0] for name in SHIPPED), "K e, without an error"),
    }
    numbers |= {n: Number(found[n][at], f"{n}, 30 deg off") for n in SHIPPED}
    drawn = ("euler_parameters", "rotation_vector", *SHIPPED)
    lines = [Line(n, np.column_stack((ANGLES_DEG, found[n]))) for n in drawn]
    label = "|A - A'| / |A + A'|"
    return Result(numbers, Chart("orientation error [deg]", label, tuple(lines)))


def asymmetry(robot: Robot, q: Array, name: str, angle_deg: float) -> float:
    """Return |A - A'| / |A + A'| of A = -d tau / dq by central differences."""
    law, R_d = representation(name), _desired(robot, q, angle_deg)

    def tau(q: Array) -> Array:
        state = robot.state(q, np.zeros_like(q))
        mu = law.spring(R_d, state.R_e, K_O).moment
        effort: Array = state.J[3:].T @ mu
        return effort

    steps = _STEP * np.eye(len(q))
    A = np.array([(tau(q - h) - tau(q + h)) / (2 * _STEP) for h in steps]).T
    return float(np.linalg.norm(A - A.T) / np.linalg.norm(A + A.T))


def _desired(robot: Robot, q: Array, angle_deg: float) -> Array:
    R_e = robot.state(q, np.zeros_like(q)).R_e
    R_d: Array = R_e @ exp(-np.radians(angle_deg) * _AXIS)
    return R_d
