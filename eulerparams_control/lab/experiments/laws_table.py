"""The table of the comparison, law by law, all of it measured."""

import math
import time

import numpy as np

from eulerparams_control.lab.as_shipped.laws import PREFIX
from eulerparams_control.lab.experiments.library._arms import ur5
from eulerparams_control.lab.experiments.library.closed_path_law import SHIPPED, closed_path, work
from eulerparams_control.laws.clik import Clik
from eulerparams_control.laws.orientation import ORIENTATIONS, representation
from eulerparams_control.laws.orientation.base import OrientationRepresentation
from eulerparams_control.laws.rotations import exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.parameters.clik import ClikParameters

_AXIS = np.array([0.36, -0.48, 0.8])
_ELSEWHERE = exp(np.array([0.7, 0.4, -1.1]))  # R_e, away from the poles
_ANGLES_DEG = (90.0, 150.0, 179.0)
_MADE = 1e-5  # of what is exchanged: what the steps of the path leave is less
_TICKS = 300


def table_of_laws() -> list[dict[str, str]]:
    """Return a row for each law: the heads of its columns, and what is in them."""
    path = closed_path()
    rows = []
    for name in (*ORIENTATIONS, *SHIPPED):
        law, done = representation(name), work(name, path)
        share = float(done.sum() / np.abs(done).sum())
        gains = (f"{gain(law, angle):.3g}" for angle in _ANGLES_DEG)
        rows.append(
            {
                "law": name,
                "singular at": singular_at(law),
                "work on a closed path": f"{100 * share:.2g} %",
                "conservative": "yes" if abs(share) < _MADE else "no",
                "gain at 90°, 150°, 179°": ", ".join(gains),
                "cost of a tick": "" if name.startswith(PREFIX) else f"{1e6 * cost(law):.0f} us",
            }
        )
    return rows


def singular_at(law: OrientationRepresentation) -> str:
    """Return where the distance to the singularity is zero, of errors and of the frames."""
    R = _ELSEWHERE
    errors = [
        f"{angle:g}°"
        for angle in (90.0, 180.0)
        if law.singularity_distance(R @ exp(math.radians(angle) * _AXIS), R) < 1e-6
    ]
    pole = exp(np.array([0.0, math.pi / 2, 0.0]))  # of XYZ
    if law.singularity_distance(pole, pole) < 1e-6:
        return "poles of the frames"
    if law.singularity_distance(R @ pole, R) < 1e-6 and not errors:
        return "errors at a pole, 90° (XYZ)"
    return "errors of " + ", ".join(errors) if errors else "nowhere"


def gain(law: OrientationRepresentation, angle_deg: float) -> float:
    """Return the length of the error over its angle, over that at zero."""
    theta = math.radians(angle_deg)
    error = law.displacement(_ELSEWHERE @ exp(theta * _AXIS), _ELSEWHERE).error
    return float(np.linalg.norm(error)) / (theta * law.slope)


def cost(law: OrientationRepresentation) -> float:
    """Return the time [s] of one tick of CLIK on a UR5, the fastest of some."""
    robot, home = ur5()
    scheme = Clik(robot, ClikParameters(orientation=law.name, enforce_limits=False))
    state = robot.state(home, np.zeros_like(home))
    desired = DesiredFrame(state.p_e, state.R_e @ exp(0.1 * _AXIS))
    scheme.reset(home)
    best = math.inf
    for _ in range(_TICKS):
        began = time.perf_counter()
        scheme.tick(1e-3, home, np.zeros_like(home), desired)
        best = min(best, time.perf_counter() - began)
    return best
