"""The sweep of a map: its cells in batches, those that are not finished yet simulated."""

from collections.abc import Callable
from pathlib import Path

from eulerparams_control.lab.maps.base import MapKind, Row, Table
from eulerparams_control.lab.maps.definition import MapDefinition
from eulerparams_control.lab.maps.engine import Engine
from eulerparams_control.lab.maps.store import Store

type Show = Callable[[int, int], None]
"""Takes how many simulations are finished, of how many."""


def batches_of(kind: MapKind) -> list[list[Row]]:
    """Return the cells in tasks.

    Neighbours go to different tasks: those of slow variants do not come last, all at once.
    """
    cells = kind.cells()
    count = -(-len(cells) // kind.batch)
    return [cells[i::count] for i in range(count)]


def sweep(definition: MapDefinition, folder: Path, engine: Engine, show: Show) -> Table:
    """Return all rows of a map; what an earlier sweep finished is not simulated again.

    Args:
        definition: of the map.
        folder: of the map.
        engine: where the simulations run.
        show: called after each batch.
    """
    batches = batches_of(definition.kind)
    store = Store(folder, definition.fingerprint)
    finished = store.finished(batches)
    total = sum(map(len, batches))
    done = sum(len(batch) for number, batch in enumerate(batches) if number in finished)
    show(done, total)
    missing = {n: batch for n, batch in enumerate(batches) if n not in finished}
    if missing:
        for number, rows in engine(definition.kind, missing):
            store.keep(number, rows)
            done += len(rows)
            show(done, total)
    return store.gather(len(batches))
