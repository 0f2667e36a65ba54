"""Two set-points 2 deg apart, tool down, by component and by the shaper, which goes along SO(3)."""

import math

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.maps.base import MapVariant
from eulerparams_control.lab.maps.set_points_map import between
from eulerparams_control.laws.rotations import Array, angle_between, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.references import Goal
from eulerparams_control.motion.shaper import Shaper

VARIANTS = (
    MapVariant("rotation vector", "rotation_vector"),
    MapVariant("quaternion", "euler_parameters"),
    MapVariant("Euler angles XYZ", "euler_angles"),
)
STEP = math.radians(2.0)
LIMITS = MotionLimits(0.25, 1.0, 1.0, 4.0, 20.0, 80.0)
"""The defaults of the nodes."""
_RATE, _STEPS = 100, 50  # [Hz], from one set-point to the other
_AXIS = np.array([0.6, 0.8, 0.0])  # of the half turn that makes the tool point down
TWO = tuple(exp((math.pi + s * STEP) * _AXIS) for s in (-0.5, 0.5))
"""The set-points."""


def run() -> Result:
    """Return how far each stream leads off the nearer set-point, the shaper off and on."""
    R_1, R_2 = TWO
    share = np.linspace(0.0, 1.0, _STEPS + 1)
    numbers, lines = {}, []
    for variant in VARIANTS:
        stream = between(variant, R_1, R_2, share[:, None])
        away = _away(stream, R_1)
        text = f"{variant.label}, shaper off"
        numbers[f"{variant.orientation}_off"] = Number(max(away), text, "deg")
        lines.append(Line(variant.label, np.column_stack((share, away)), markers=False))
    ends = _away(shaped(np.array([R_1, R_2])), R_1)
    numbers["ends"] = Number(max(ends), "set-points as they are, shaper on", "deg")
    rotation_vectors = between(VARIANTS[0], R_1, R_2, share[:, None])
    through_shaper = shaped(rotation_vectors)
    text = "rotation vector, shaper on"
    numbers["rotation_vector_on"] = Number(max(_away(through_shaper, R_1)), text, "deg")
    for name, Rs in (("off", rotation_vectors), ("on", through_shaper)):
        speed = float(angle_between(Rs[:-1], Rs[1:]).max()) * _RATE
        text = f"rotation vector, shaper {name}: peak speed"
        numbers[f"speed_{name}"] = Number(speed, text, "rad/s")
    return Result(numbers, Chart("share of the way", "away from the first [deg]", tuple(lines)))


def shaped(stream: Array) -> Array:
    """Return what the shaper makes of poses (N, 3, 3) that come at 100 Hz, and of 1 s after."""
    shaper = Shaper(DesiredFrame(np.zeros(3), stream[0]), LIMITS)
    found = []
    for k in range(len(stream) + _RATE):
        if k < len(stream):
            shaper.follow(Goal(DesiredFrame(np.zeros(3), stream[k])), None)
        found.append(shaper.sample(round(k * 1e9 / _RATE)).R_d)
    return np.array(found)


def _away(Rs: Array, R_1: Array) -> list[float]:
    """Return the angle [deg] between each rotation and the first set-point."""
    angles: list[float] = np.degrees(angle_between(np.broadcast_to(R_1, Rs.shape), Rs)).tolist()
    return angles
