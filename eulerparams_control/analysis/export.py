"""All quantities of a run as a table, csv or parquet: a row for each joint_states.

What has stamps of its own, such as wrench, has in each row its last sample up to then: the one that
a controller would take.  It is empty before the first.
"""

import re
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from eulerparams_control.analysis.quantities import EVERYTHING
from eulerparams_control.analysis.quantity import AnyQuantity, JointQuantity, VectorQuantity
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import ConfigurationError
from eulerparams_control.rotations import Array

FORMATS = ("csv", "parquet")


class Export:
    """A table that grows with the parts of a run.

    Args:
        path: of the file; its suffix is the format.

    Raises:
        ConfigurationError: if it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._writer: Any = None
        self._schema: Any = None
        self._until = -np.inf

    def __enter__(self) -> "Export":
        return self

    def __exit__(
        self,
        _type: type[BaseException] | None,
        _error: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        if self._writer is not None:
            self._writer.close()

    def add(self, part: Recording) -> None:
        """Write the rows of a part; those of before are not written again."""
        new = part.measured.t > self._until
        self._until = float(part.measured.t[-1])
        columns = {name: values[new] for name, values in table(part).items()}
        try:
            if self._writer is None:
                self._open(list(columns))
            nothing = np.full(int(new.sum()), np.nan)
            arrays = [pa.array(columns.get(name, nothing)) for name in self._schema.names]
            self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
        except OSError as error:
            raise ConfigurationError(f"cannot write {self.path}: {error}") from error

    def _open(self, names: list[str]) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._schema = pa.schema([(name, pa.float64()) for name in names])
        of = pyarrow.csv.CSVWriter if self.path.suffix == ".csv" else pyarrow.parquet.ParquetWriter
        self._writer = of(str(self.path), self._schema)


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


def file_name(label: str) -> str:
    """Return a name of a run as that of a file."""
    return re.sub(r"[^\w.-]+", "_", label).strip("._") or "run"
