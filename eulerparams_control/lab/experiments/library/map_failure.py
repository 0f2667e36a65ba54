"""Where in SO(3) dynamic control (38), (40) fails: errors at rest, and a turn that is followed.

A free frame, J = I: it has no workspace and no singularity of its own, so that what fails is the
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
from eulerparams_control.laws._old.dynamic_control import ResolvedAcceleration
from eulerparams_control.laws.rotations import Array, angle_between, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import RobotState

MAP = Map(COLUMNS, directions=150, seed=1, trials=2, tasks=(45.0, 100.0, 150.0, 0.0))
"""Tasks: the error [deg] of a frame at rest; 0 is a turn that is followed for the whole run."""
SPEED = math.radians(90.0)  # [rad/s] of that
RATE = 20.0  # [1/s] k_Po = rate^2, k_Vo = 2 rate
NOISE = math.radians(0.1)  # of the measured orientation, about each axis
SETTLED = math.radians(0.5)
FAST = 1.5  # peak speed, over that of a direct turn, that counts as a failure
_DT, _STEPS = 2e-3, 300  # 0.6 s
_FASTEST = 1e6  # [rad/s] beyond it has diverged
_ZERO, _SIX, _J = np.zeros(3), np.zeros(6), np.eye(6)


def simulate(column: Column, error: float, R_d: Array, random: Generator) -> dict[str, float]:
    """Return the peak speed over that of a direct turn, infinite if the frame is lost."""
    k_Po = RATE**2 / column.representation.slope  # the same for small errors
    law = ResolvedAcceleration(column.representation, k_Po=k_Po, k_Vo=2 * RATE)
    r, theta = random_axis(random), math.radians(error)
    omega_d, direct = (_ZERO, RATE * theta / math.e) if theta else (SPEED * r, SPEED)

    def desired(t: float) -> DesiredFrame:
        R = exp((t - _STEPS * _DT / 2) * omega_d) @ R_d
        return DesiredFrame(_ZERO, R, omega_d=omega_d)

    return {"speed": peak_speed(law, desired, desired(0.0).R_d @ exp(-theta * r), random) / direct}


def peak_speed(
    law: ResolvedAcceleration,
    desired: Callable[[float], DesiredFrame],
    R: Array,
    random: Generator,
) -> float:
    """Return the peak speed [rad/s] of a free frame that a law drives from R; infinite if lost.

    It is lost where it diverges, or is not settled: at the end, or where it turns at any time.
    """
    omega, noise = desired(0.0).omega_d, NOISE * random.normal(size=(_STEPS, 3))
    turns, peak, is_lost, x_de = omega.any(), 0.0, False, None
    for i in range(_STEPS):
        target = desired(i * _DT)
        is_lost = angle_between(R, target.R_d) > SETTLED or (is_lost and turns)
        measured = RobotState(_SIX, _SIX, _ZERO, exp(noise[i]) @ R, _ZERO, omega, _J)
        try:
            a, _, x_de = law.acceleration(measured, target, x_de)
        except (SingularityError, OverflowError):
            return math.inf
        before, omega = omega, omega + _DT * a[3:]
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
