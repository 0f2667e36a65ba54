"""All quantities of a run as a file, csv or parquet: see ``wide`` for its columns.

A file has the columns of all quantities, those that were not recorded empty, and the stamp of the
joint_states.
"""

import re
from pathlib import Path
from typing import Any

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


class Export:
    """A table that grows with the parts of a run.

    Args:
        path: of the file; its suffix is the format.

    Raises:
        ConfigurationError: if it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        import pyarrow.csv  # takes time and memory, and few ask for a table
        import pyarrow.parquet

        self._arrow: Any = pyarrow
        self.path = path
        self._writer: Any = None
        self._schema: Any = None
        self._until = -np.inf

    def close(self) -> None:
        """End the file."""
        if self._writer is not None:
            self._writer.close()

    def add(self, part: Recording) -> None:
        """Write the rows of a part; those of before are not written again."""
        pa, new = self._arrow, part.measured.t > self._until
        self._until = float(part.measured.t[-1])
        found = {name: pa.array(values[new]) for name, values in columns(part).items()}
        stamps = part.began + np.round(1e9 * part.measured.t[new]).astype(np.int64)
        found["stamp [ns]"] = pa.array(stamps)
        nothing = pa.nulls(int(new.sum()), pa.float64())
        try:
            if self._writer is None:
                self._open(names(part.robot))
            arrays = [found.get(name, nothing) for name in self._schema.names]
            self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
        except OSError as error:
            raise ConfigurationError(f"cannot write {self.path}: {error}") from error

    def _open(self, columns: list[str]) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        pa = self._arrow
        stamp = pa.field("stamp [ns]", pa.int64())
        self._schema = pa.schema([stamp, *((name, pa.float64()) for name in columns)])
        of = pa.csv.CSVWriter if self.path.suffix == ".csv" else pa.parquet.ParquetWriter
        self._writer = of(str(self.path), self._schema)


def file_name(label: str) -> str:
    """Return a name of a run as that of a file."""
    return re.sub(r"[^\w.-]+", "_", label).strip("._") or "run"
