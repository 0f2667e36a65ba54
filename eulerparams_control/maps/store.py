"""The rows of a map on disk: a part for each batch that is finished, then all in one file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.maps.base import Row, Table


class Store:
    """The folder of a map.

    Args:
        folder: of the map.
        fingerprint: of its definition: parts of another one are not its parts.

    Raises:
        ConfigurationError: if the folder cannot be made.
    """

    def __init__(self, folder: Path, fingerprint: str) -> None:
        self.folder = folder
        self._parts = folder / "parts" / fingerprint
        try:
            self._parts.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigurationError(f"cannot make the folder {self._parts}: {error}") from error

    def finished(self) -> set[int]:
        """Return the numbers of the batches that are finished."""
        return {int(path.stem) for path in self._parts.glob("*.parquet")}

    def keep(self, number: int, rows: Sequence[Row]) -> None:
        """Keep the rows of a batch: whole or not at all."""
        path = self._parts / f"{number:06d}.parquet"
        self._write(pa.Table.from_pylist(list(rows)), path)

    def gather(self, batches: int) -> Table:
        """Return the rows of all batches, in their order, and write them to map.parquet."""
        parts = [pq.read_table(self._parts / f"{n:06d}.parquet") for n in range(batches)]
        table = pa.concat_tables(parts)
        self._write(table, self.folder / "map.parquet")
        return {name: np.asarray(table[name]) for name in table.column_names}

    def _write(self, table: pa.Table, path: Path) -> None:
        beside = path.with_suffix(".writing")
        try:
            pq.write_table(table, beside)
            beside.replace(path)
        except OSError as error:
            raise ConfigurationError(f"cannot write {path}: {error}") from error
