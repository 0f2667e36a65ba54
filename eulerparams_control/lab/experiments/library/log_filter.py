"""A first-order low-pass of the target pose in the coordinates of log R, tool down.

target = (1 - a) log R_new + a target, at 1 kHz, as is done in software that is in use; the same
filter along the geodesic from the target to R_new.
"""

import math
from collections.abc import Callable

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.laws.rotations import Array, angle_between, exp, log

FILTERS = (0.1, 0.9)
TILT = math.radians(1.0)
_RATE, _PERIOD, _STEPS = 1000.0, 1.0, 2000
DOWN = exp(math.pi * np.array([0.6, 0.8, 0.0]))  # tool z along -z of the base


def run() -> Result:
    """Return how far the filtered target is off what is asked, by both filters."""
    numbers, lines = {}, []
    t = np.arange(_STEPS) / _RATE
    tilts = TILT * np.sin(2 * np.pi * t / _PERIOD)
    targets = [DOWN @ exp(np.array([tilt, 0.0, 0.0])) for tilt in tilts]
    for a in FILTERS:
        by_log, geodesic = off(targets, a, _of_logs), off(targets, a, _along)
        numbers[f"log_{a:g}".replace(".", "_")] = Number(max(by_log), f"log, a = {a}", "deg")
        away = sum(o > 5.0 for o in by_log) / _RATE / (2 * t[-1] / _PERIOD)
        numbers[f"lost_{a:g}".replace(".", "_")] = Number(
            float(1e3 * away), f"log, a = {a}: more than 5 deg off for, per crossing", "ms"
        )
        numbers[f"geodesic_{a:g}".replace(".", "_")] = Number(
            max(geodesic), f"geodesic, a = {a}", "deg"
        )
        lines.append(Line(f"log, a = {a}", np.column_stack((t, by_log))[::2], markers=False))
    lines.append(Line("geodesic, a = 0.9", np.column_stack((t, geodesic))[::2], markers=False))
    return Result(numbers, Chart("time [s]", "target off what is asked [deg]", tuple(lines)))


def _of_logs(R: Array, R_new: Array, a: float) -> Array:
    filtered: Array = exp(a * log(R) + (1 - a) * log(R_new))
    return filtered


def _along(R: Array, R_new: Array, a: float) -> Array:
    filtered: Array = R @ exp((1 - a) * log(R.T @ R_new))
    return filtered


def off(targets: list[Array], a: float, step: "Filter") -> list[float]:
    """Return the angle [deg] of the filtered target off the newest, for each."""
    R, found = targets[0], []
    for R_new in targets:
        R = step(R, R_new, a)
        found.append(math.degrees(float(angle_between(R, R_new))))
    return found


type Filter = Callable[[Array, Array, float], Array]
