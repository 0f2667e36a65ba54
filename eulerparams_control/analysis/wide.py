"""All quantities of a run as one table: a row for each joint_states, a column a component.

What has stamps of its own, such as wrench, has in each row its last sample up to then: the one that
a controller would take.  It is NaN before the first.
"""

import numpy as np

from eulerparams_control.analysis.quantities import EVERYTHING
from eulerparams_control.analysis.quantity import AnyQuantity, JointQuantity, VectorQuantity
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.rotations import Array


def table(recording: Recording) -> dict[str, Array]:
    """Return the columns (N,) of a run by name and unit, at its N joint_states."""
    measured = recording.measured
    columns = {"t [s]": measured.t}
    for joint, name in enumerate(recording.robot.joints):
        columns[f"q.{name} [rad]"] = measured.q[:, joint]
        columns[f"dq.{name} [rad/s]"] = measured.dq[:, joint]
    for quantity in EVERYTHING:
        t, y = quantity.of(recording)
        if len(t):
            held = _held(measured.t, t, y.reshape(len(t), -1))
            names = _names(quantity, recording, held.shape[1])
            columns |= dict(zip(names, held.T, strict=True))
    return columns


def _held(t: Array, own: Array, y: Array) -> Array:
    """Return the last row of y (M, k) at own (M,) up to each of t (N,); NaN before the first."""
    index = np.searchsorted(own, t, side="right") - 1
    held = y[np.maximum(index, 0)].astype(float)
    held[index < 0] = np.nan
    return held


def _names(quantity: AnyQuantity, recording: Recording, count: int) -> list[str]:
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    if isinstance(quantity, JointQuantity):
        return [f"{quantity.name}.{joint}{unit}" for joint in recording.robot.joints]
    if isinstance(quantity, VectorQuantity):
        parts = [part.replace(" ", "_") for part in quantity.components[:count]]
        return [f"{quantity.name}.{part}{unit}" for part in parts]
    return [f"{quantity.name}{unit}"]
