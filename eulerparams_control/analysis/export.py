"""All quantities of a run as a file, csv or parquet.

A file has the columns of all quantities, those that were not recorded empty, and the stamp of the
joint_states.
"""

import re
from pathlib import Path

import numpy as np

from eulerparams_control.analysis.quantities import EVERYTHING
from eulerparams_control.analysis.quantities.base import Quantity
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import ConfigurationError
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


FORMATS = ("csv", "parquet")


def write_table(path: Path, recording: Recording) -> None:
    """Write the columns of a run to a file; its suffix is the format.

    Raises:
        ConfigurationError: if it cannot be written.
    """
    import pyarrow.csv  # takes time and memory, and few ask for a table
    import pyarrow.parquet

    t = recording.measured.t
    found = columns(recording)
    stamps = recording.began + np.round(1e9 * t).astype(np.int64)
    nothing = pyarrow.nulls(len(t), pyarrow.float64())
    table = {"stamp [ns]": pyarrow.array(stamps)}
    for name in names(recording.robot):
        table[name] = pyarrow.array(found[name]) if name in found else nothing
    write = pyarrow.csv.write_csv if path.suffix == ".csv" else pyarrow.parquet.write_table
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(pyarrow.table(table), str(path))
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error}") from error


def file_name(label: str) -> str:
    """Return a name of a run as that of a file."""
    return re.sub(r"[^\w.-]+", "_", label).strip("._") or "run"
