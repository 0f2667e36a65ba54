"""What the tip does where position and orientation are one error: log6, dual quaternions.

CLIK in the pose alone, dT = T S(v): with log6 of T_e^-1 T_d the tip goes along a screw, with the
unit dual quaternion x_e* x_d, whose dual part has half the displacement, nearly so.  Position and
orientation apart go straight.
"""

import math
from collections.abc import Callable

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.as_shipped.pose import Dual, Log6
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.laws.rotations import Array, exp, quaternion, right_jacobian

ANGLES_DEG = (30.0, 60.0, 90.0, 130.0, 170.0)
WAY = 0.3  # [m], perpendicular to the axis of the turn
_STEP, _STEPS = 5e-3, 1000  # gain times time; the middle is passed


def run() -> Result:
    """Return how far the tip leaves the straight line, for each law and angle."""
    found = {name: [1e3 * off_line(law, a) for a in ANGLES_DEG] for name, law in LAWS.items()}
    arc = [1e3 * WAY / 2 * math.tan(math.radians(a) / 4) for a in ANGLES_DEG]
    at = ANGLES_DEG.index(90.0)
    apart = max(abs(f - p) for f, p in zip(found["log6"], arc, strict=True))
    numbers = {
        "screw_90": Number(found["log6"][at], "log6, 0.3 m and 90 deg: off the line", "mm"),
        "screw_170": Number(found["log6"][-1], "log6, 0.3 m and 170 deg: off the line", "mm"),
        "closed_form": Number(apart, "log6: largest difference from the arc", "mm"),
        "dual_90": Number(found["dual quaternion"][at], "dual quaternion, 90 deg", "mm"),
        "apart": Number(max(found["apart"]), "position and orientation apart", "mm"),
    }
    lines = [Line("d/2 tan(theta/4)", np.column_stack((ANGLES_DEG, arc)), "predicted")]
    lines += [Line(name, np.column_stack((ANGLES_DEG, f))) for name, f in found.items()]
    return Result(numbers, Chart("turn [deg]", "tip off the straight line [mm]", tuple(lines)))


def off_line(law: "Law", angle_deg: float) -> float:
    """Return how far [m] the tip leaves the line to a goal that is turned about z."""
    p, R = np.zeros(3), np.eye(3)
    p_d, R_d = np.array([WAY, 0.0, 0.0]), exp(np.array([0.0, 0.0, math.radians(angle_deg)]))
    most = 0.0
    for _ in range(_STEPS):
        v, omega = law(R.T @ (p_d - p), R.T @ R_d)  # in the axes of the tip
        # along the twist, exactly: the step leaves no error of its own
        p = p + R @ (right_jacobian(-_STEP * omega) @ (_STEP * v))
        R = R @ exp(_STEP * omega)
        most = max(most, abs(float(p[1])))
    return most


type Law = Callable[[Array, Array], tuple[Array, Array]]


def _apart(p: Array, R: Array) -> tuple[Array, Array]:
    """Return p and 2 eps, (28): the tip goes straight in the base axes."""
    return p, 2.0 * quaternion(R).eps


LAWS: dict[str, Law] = {"log6": Log6().twist, "dual quaternion": Dual().twist, "apart": _apart}
