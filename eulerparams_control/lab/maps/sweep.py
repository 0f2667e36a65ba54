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
    """Return all rows of a map, and write them to map.parquet.

    What an earlier sweep of the same definition finished is not simulated again.

    Args:
        definition: of the map.
        folder: of the map.
        pool: where the simulations run.
        show: called after each batch.

    Raises:
        ConfigurationError: if it cannot write there.
    """
    batches = batches_of(definition.kind)
    of_this = folder / "parts" / definition.fingerprint  # parts of another are not its parts
    try:
        of_this.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"cannot make the folder {of_this}: {error}") from error
    parts = [of_this / f"{number:06d}.parquet" for number in range(len(batches))]
    missing = [(n, batch) for n, batch in enumerate(batches) if not _holds(parts[n], batch)]
    total = sum(map(len, batches))
    done = total - sum(len(batch) for _, batch in missing)
    show(done, total)
    for (number, batch), future in results(pool, partial(simulate, definition.kind), missing):
        _write(pa.Table.from_pylist(future.result()), parts[number])
        done += len(batch)
        show(done, total)
    table = pa.concat_tables(pq.read_table(part) for part in parts)
    _write(table, folder / "map.parquet")
    return {name: np.asarray(table[name]) for name in table.column_names}


def _holds(part: Path, batch: Sequence[Row]) -> bool:
    """Return whether a file can be read, and has the rows of a batch, with outcomes."""
    if not part.is_file():
        return False
    try:
        table = pq.ParquetFile(part).read()
        cells: list[Row] = table.select(list(batch[0])).to_pylist()
    except (OSError, pa.ArrowException, KeyError):  # truncated, or of something else
        return False
    return table.num_columns > len(batch[0]) and cells == list(batch)


def _write(table: pa.Table, path: Path) -> None:
    """Write a table: whole or not at all."""
    beside = path.with_suffix(".writing")
    try:
        pq.write_table(table, beside)
        beside.replace(path)
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error}") from error
