"""E5: from any error CLIK with Euler parameters (28) goes as (29)-(31) say."""

import math

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.experiments.library._arms import STEP_NS, clik, ur5
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.orientation import representation
from eulerparams_control.laws.rotations import Array, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory

ERRORS_DEG = (30, 60, 90, 120, 150, 170, 180)
K = 10.0  # k_Po [1/s]
DURATION = 1.5  # [s]
_SHOWN = 5  # ticks between the points of the chart


def run() -> Result:
    """Return how far eta is from its closed form, and how much V_1 rises, for each error."""
    t = np.linspace(0.0, DURATION, round(DURATION * 1e9 / STEP_NS) + 1)
    found = {error: large_error(error) for error in ERRORS_DEG}
    closed = {error: closed_form(error, t) for error in ERRORS_DEG}
    apart = {error: float(np.abs(eta - closed[error]).max()) for error, (eta, _) in found.items()}
    rise = max(float(np.diff(V).max()) for _, V in found.values())
    left = max(2 * math.degrees(math.acos(min(1.0, eta[-1]))) for eta, _ in found.values())
    numbers = {
        f"apart_{error}": Number(value, f"largest |eta - tanh(k t / 2 + c)| from {error} deg")
        for error, value in apart.items()
    }
    numbers |= {
        "apart": Number(max(apart.values()), "largest |eta - tanh(k t / 2 + c)|"),
        "V_1_rise": Number(max(rise, 0.0), "largest rise of V_1 in a tick"),
        "final_error": Number(left, "largest orientation error at the end", "deg"),
    }
    return Result(numbers, _chart(t, {error: eta for error, (eta, _) in found.items()}, closed))


def _chart(t: Array, found: dict[int, Array], closed: dict[int, Array]) -> Chart:
    """Return the picture of eta over time, with its closed forms."""
    lines = [
        Line(
            "tanh(k t / 2 + c), eq. (29)" if error == ERRORS_DEG[0] else "",
            np.column_stack((t, eta))[::_SHOWN],
            "predicted",
            False,
        )
        for error, eta in closed.items()
    ]
    lines += [
        Line(f"from {error} deg", np.column_stack((t, eta))[::_SHOWN], markers=False)
        for error, eta in found.items()
    ]
    return Chart("time [s]", "eta of the mutual quaternion", tuple(lines))


def large_error(error_deg: float) -> tuple[Array, Array]:
    """Return eta and V_1 (N,) of CLIK at each tick, from an error that the last joint makes."""
    robot, home = ur5()
    turn_y, turn_z = np.array([0.0, math.radians(60), 0.0]), np.array([0.0, 0.0, math.pi / 2])
    frame = DesiredFrame(np.array([0.485, 0.07, 0.425]), exp(turn_y) @ exp(turn_z))  # LE
    q_0 = inverse_kinematics(robot, frame, home)
    q_0[-1] -= math.radians(error_deg)
    law = representation("euler_parameters")
    motion = Trajectory([0.0], [frame])
    ticks = list(clik(robot, law, (K, K), q_0, motion, DURATION))
    V_1 = [law.lyapunov_1(tick.x_de, K) for tick in ticks]
    eta = np.array([tick.x_de.Q_de.eta for tick in ticks])
    return eta, np.array([V.V for V in V_1 if V is not None])


def closed_form(error_deg: float, t: Array) -> Array:
    """Return eta (N,) by (16) and (29): tanh(k t / 2 + c), with c of the first error."""
    c = math.atanh(math.cos(math.radians(error_deg) / 2))
    eta: Array = np.tanh(K * t / 2 + c)
    return eta
