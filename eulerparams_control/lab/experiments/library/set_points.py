"""Two set-points 2 deg apart, tool down, by component and by the shaper, which goes along SO(3)."""

import math
from collections.abc import Callable

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.analysis.stacks import angles_between, over
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.laws.orientation import EulerSequence
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    R_quaternion,
    exp,
    log,
    quaternion,
)
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.references import Goal
from eulerparams_control.motion.shaper import Shaper

LABELS = {
    "rotation_vector": "rotation vector",
    "euler_parameters": "quaternion",
    "euler_angles": "Euler angles XYZ",
}
STEP = math.radians(2.0)
LIMITS = MotionLimits(0.25, 1.0, 1.0, 4.0, 20.0, 80.0)
"""The defaults of the nodes."""
_RATE, _STEPS = 100, 50  # [Hz], from one set-point to the other
_AXIS = np.array([0.6, 0.8, 0.0])  # of the half turn that makes the tool point down
TWO = tuple(exp((math.pi + s * STEP) * _AXIS) for s in (-0.5, 0.5))
"""The set-points."""
_SHARES = np.linspace(0.0, 1.0, 41)[:, None]


def run() -> Result:
    """Return how far each stream leads off the nearer set-point, the shaper off and on."""
    R_1, R_2 = TWO
    share = np.linspace(0.0, 1.0, _STEPS + 1)
    numbers, lines = {}, []
    for name, label in LABELS.items():
        away = _away(between(name, R_1, R_2, share[:, None]), R_1)
        numbers[f"{name}_off"] = Number(max(away), f"{label}, shaper off", "deg")
        lines.append(Line(label, np.column_stack((share, away)), markers=False))
    ends = _away(shaped(np.array([R_1, R_2])), R_1)
    numbers["ends"] = Number(max(ends), "set-points as they are, shaper on", "deg")
    rotation_vectors = between("rotation_vector", R_1, R_2, share[:, None])
    through_shaper = shaped(rotation_vectors)
    text = "rotation vector, shaper on"
    numbers["rotation_vector_on"] = Number(max(_away(through_shaper, R_1)), text, "deg")
    for name, Rs in (("off", rotation_vectors), ("on", through_shaper)):
        speed = float(angles_between(Rs[:-1], Rs[1:]).max()) * _RATE
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
    angles: list[float] = np.degrees(angles_between(np.broadcast_to(R_1, Rs.shape), Rs)).tolist()
    return angles


def astray(name: str, R_1: Array, R_2: Array, sequence: str = "XYZ") -> float:
    """Return the largest angle [deg] of what is between R_1 and R_2 off the geodesic."""
    geodesic = R_1 @ over(exp, _SHARES * log(R_1.T @ R_2), shape=(3, 3))
    by_component = between(name, R_1, R_2, sequence=sequence)
    return math.degrees(float(angles_between(geodesic, by_component).max()))


def between(
    name: str, R_1: Array, R_2: Array, shares: Array = _SHARES, sequence: str = "XYZ"
) -> Array:
    """Return rotations (N, 3, 3) from R_1 to R_2 by component, at shares (N, 1) of the way.

    Components are those of R itself: theta r, 4 tan(theta/4) r, {eta, eps} with eta >= 0, or Euler
    angles, which are not wrapped.
    """
    if name == "euler_angles":
        phi = EulerSequence(sequence)
        return over(phi.R, _way(phi.extract(R_1), phi.extract(R_2), shares), shape=(3, 3))
    if name == "rotation_vector":
        return over(exp, _way(log(R_1), log(R_2), shares), shape=(3, 3))
    to, back = _OF_Q[name]
    Q = back(_way(to(quaternion(R_1)), to(quaternion(R_2)), shares))
    Q = Q / np.linalg.norm(Q, axis=1, keepdims=True)
    return over(R_quaternion, Q[:, 0], Q[:, 1:], shape=(3, 3))


def _way(x_1: Array, x_2: Array, shares: Array) -> Array:
    return x_1 + shares * (x_2 - x_1)


_OF_Q: dict[str, tuple[Callable[[EulerParameters], Array], Callable[[Array], Array]]] = {
    "euler_parameters": (lambda Q: np.array([Q.eta, *Q.eps]), lambda x: x),
    "modified_rodrigues": (
        lambda Q: Q.eps / (1 + Q.eta),
        lambda x: np.hstack([1 - (x * x).sum(axis=1, keepdims=True), 2 * x]),
    ),
}
"""From a quaternion to components, and from these to one, its norm left open."""
