"""All quantities of a run as one table: a row for each joint_states, a column a component.

What has stamps of its own, such as wrench, has in each row its last sample up to then: the one that
a controller would take.  It is NaN before the first.  What is not named ``measured`` is of the
commanded motion where there is one, joint_reference, but for q and dq, which are those of the arm.
"""

import numpy as np

from eulerparams_control.analysis.quantities import EVERYTHING
from eulerparams_control.analysis.quantity import Quantity
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import Robot

_STATES = (("q", "rad", "m"), ("dq", "rad/s", "m/s"), ("tau", "Nm", "N"))
_QUANTITIES = [each for each in EVERYTHING if not each.is_of_joints]


def columns(recording: Recording) -> dict[str, Array]:
    """Return the columns (N,) of a run by name and unit, at its N joint_states."""
    measured = recording.measured
    values = [measured.t, *measured.q.T, *measured.dq.T]
    if recording.effort is not None:
        values += [*_held(measured.t, recording.effort.t, recording.effort.tau).T]
    found = dict(zip(_names_of_states(recording.robot), values, strict=False))
    for quantity in _QUANTITIES:
        t, y = quantity.samples(recording)
        if len(t):
            held = _held(measured.t, t, y.reshape(len(t), -1))
            found |= dict(zip(_names(quantity), held.T, strict=True))
    return found


def names(robot: Robot) -> list[str]:
    """Return the names of all columns that a run of an arm may have."""
    quantities = [name for quantity in _QUANTITIES for name in _names(quantity)]
    return [*_names_of_states(robot), *quantities]


def _names_of_states(robot: Robot) -> list[str]:
    joints = list(zip(robot.joints, robot.is_prismatic.tolist(), strict=True))
    states = [f"{x}.{name} [{units[slides]}]" for x, *units in _STATES for name, slides in joints]
    return ["t [s]", *states]


def _held(t: Array, own: Array, y: Array) -> Array:
    """Return the last row of y (M, k) at own (M,) up to each of t (N,); NaN before the first."""
    index = np.searchsorted(own, t, side="right") - 1
    held = y[np.maximum(index, 0)].astype(float)
    held[index < 0] = np.nan
    return held


def _names(quantity: Quantity) -> list[str]:
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    parts = [f".{part.replace(' ', '_')}" for part in quantity.components] or [""]
    return [f"{quantity.name}{part}{unit}" for part in parts]
