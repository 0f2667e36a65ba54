"""Where in SO(3) dynamic control (38), (40) fails: errors at rest, and a turn that is followed.

A free frame: it has no workspace and no singularity of its own, so that what fails is the
representation. The same errors and noise for each.
"""

import math
from collections.abc import Callable

import numpy as np
from matplotlib.colors import LogNorm
from numpy.random import Generator

from eulerparams_control.errors import SingularityError
from eulerparams_control.lab.experiments.library import Result
from eulerparams_control.lab.experiments.library._map import COLUMNS, Column, Map, random_axis
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array, angle_between, exp
from eulerparams_control.motion.frames import DesiredFrame

MAP = Map(COLUMNS, directions=150, seed=1, trials=2, tasks=(45.0, 100.0, 150.0, 0.0))
"""Tasks: the error [deg] of a frame at rest; 0 is a turn that is followed for the whole run."""
SPEED = math.radians(90.0)  # [rad/s] of that
RATE = 20.0  # [1/s] k_Po = rate^2, k_Vo = 2 rate
NOISE = math.radians(0.1)  # of the measured orientation, about each axis
SETTLED = math.radians(0.5)
FAST = 1.5  # peak speed, over that of a direct turn, that counts as a failure
_DT, _STEPS = 2e-3, 300  # 0.6 s
_FASTEST = 1e6  # [rad/s] beyond it has diverged
_ZERO = np.zeros(3)


def simulate(column: Column, error: float, R_d: Array, random: Generator) -> dict[str, float]:
    """Return the peak speed over that of a direct turn, infinite if the frame is lost."""
    law, r, theta = column.representation, random_axis(random), math.radians(error)
    omega_d, direct = (_ZERO, RATE * theta / math.e) if theta else (SPEED * r, SPEED)

    def desired(t: float) -> DesiredFrame:
        R = exp((t - _STEPS * _DT / 2) * omega_d) @ R_d
        return DesiredFrame(_ZERO, R, omega_d=omega_d)

    return {"speed": peak_speed(law, desired, desired(0.0).R_d @ exp(-theta * r), random) / direct}


def peak_speed(
    law: OrientationRepresentation,
    desired: Callable[[float], DesiredFrame],
    R: Array,
    random: Generator,
) -> float:
    """Return the peak speed [rad/s] of a free frame that a law drives from R; infinite if lost.

    It is lost where it diverges, or is not settled: at the end, or where it turns at any time.
    """
    omega, noise = desired(0.0).omega_d, NOISE * random.normal(size=(_STEPS, 3))
    k_Po, k_Vo = RATE**2 / law.slope, 2 * RATE  # the same for small errors
    turns, peak, is_lost, x_de = bool(omega.any()), 0.0, False, None
    for i in range(_STEPS):
        target = desired(i * _DT)
        is_lost = angle_between(R, target.R_d) > SETTLED or (is_lost and turns)
        x_de = law.displacement(target.R_d, exp(noise[i]) @ R, x_de)
        try:
            a_o = law.acceleration(x_de, target.omega_d, target.domega_d, omega, k_Po, k_Vo)
        except (SingularityError, OverflowError):
            return math.inf
        before, omega = omega, omega + _DT * a_o
        R = exp(_DT / 2 * (before + omega)) @ R
        speed = math.sqrt(omega @ omega)
        if not speed < _FASTEST:
            return math.inf
        peak = max(peak, speed)
    return math.inf if is_lost else peak


def result(outcomes: dict[str, Array]) -> Result:
    """Return the share of runs of each representation that fail, and the worst of all trials."""
    speed = outcomes["speed"]  # (tasks, columns, directions, trials)
    failed = 100 * (speed > FAST).mean(axis=(2, 3))
    worst = np.where(np.isinf(speed), np.nan, speed).max(axis=3)
    names = (f"error {e:g}°" for e in MAP.tasks[:-1])
    rows = {
        name: (worst[i], [f"{share:.1f} % fail" for share in failed[i]])
        for i, name in enumerate((*names, f"turning {math.degrees(SPEED):g}°/s"))
    }
    numbers = MAP.numbers("fails", failed.mean(axis=0), "runs that fail", "%")
    label, ticks = "peak angular speed / that of a direct turn  [1]", (1, 1.5, 2, 3)
    return Result(numbers, MAP.spheres(rows, LogNorm(1.0, 3.0), "viridis", label, ticks, "max"))
