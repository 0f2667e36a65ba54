"""The sweep of a map: its cells in batches, those that are not finished yet simulated.

The rows are on disk: a part for each batch that is finished, then all in one file.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.maps.base import MapKind, Row, Table
from eulerparams_control.lab.maps.definition import MapDefinition
from eulerparams_control.lab.run.jobs import results

type Batch = tuple[int, Sequence[Row]]
"""Some cells, with the number of their part."""

type Show = Callable[[int, int], None]
"""Takes how many simulations are finished, of how many."""


def batches_of(kind: MapKind) -> list[list[Row]]:
    """Return the cells in tasks.

    Neighbours go to different tasks: those of slow variants do not come last, all at once.
    """
    cells = kind.cells()
    count = -(-len(cells) // kind.batch)
    return [cells[i::count] for i in range(count)]


def simulate(kind: MapKind, batch: Batch) -> list[Row]:
    """Return the rows of some cells: what a worker does; all outcomes are of type float."""
    return [
        {**cell, **{name: float(value) for name, value in kind.simulate(cell).items()}}
        for cell in batch[1]
    ]


def sweep(definition: MapDefinition, folder: Path, pool: Executor, show: Show) -> Table:
    """Return all rows of a map; what an earlier sweep finished is not simulated again.

    Args:
        definition: of the map.
        folder: of the map.
        pool: where the simulations run.
        show: called after each batch.
    """
    batches = batches_of(definition.kind)
    store = Store(folder, definition.fingerprint)
    finished = store.finished(batches)
    missing = [(n, batch) for n, batch in enumerate(batches) if n not in finished]
    total = sum(map(len, batches))
    done = total - sum(len(batch) for _, batch in missing)
    show(done, total)
    for (number, batch), future in results(pool, partial(simulate, definition.kind), missing):
        store.keep(number, future.result())
        done += len(batch)
        show(done, total)
    return store.gather(len(batches))


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

    def finished(self, batches: Sequence[Sequence[Row]]) -> set[int]:
        """Return the numbers of those of these batches that are finished.

        A part that cannot be read, or has not the rows of its batch, is as if it were not there.
        """
        return {n for n, batch in enumerate(batches) if self._holds(self._part(n), batch)}

    def _part(self, number: int) -> Path:
        return self._parts / f"{number:06d}.parquet"

    def _holds(self, path: Path, batch: Sequence[Row]) -> bool:
        """Return whether a file has the rows of a batch, with outcomes."""
        if not path.is_file():
            return False
        try:
            table = pq.ParquetFile(path).read()
            cells: list[Row] = table.select(list(batch[0])).to_pylist()
        except (OSError, pa.ArrowException, KeyError):  # truncated, or of something else
            return False
        return table.num_columns > len(batch[0]) and cells == list(batch)

    def keep(self, number: int, rows: Sequence[Row]) -> None:
        """Keep the rows of a batch: whole or not at all."""
        self._write(pa.Table.from_pylist(list(rows)), self._part(number))

    def gather(self, batches: int) -> Table:
        """Return the rows of all batches, in their order, and write them to map.parquet."""
        parts = [pq.read_table(self._part(n)) for n in range(batches)]
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
