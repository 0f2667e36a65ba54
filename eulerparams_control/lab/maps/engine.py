"""Where the simulations of a map run: in this process, in processes of its own, on a cluster.

The same tasks go everywhere, and a row depends on its cell alone: the numbers do not depend on
the number of workers, nor on the order in which they answer.  Workers share no files with the
client; of them it needs only that this package is installed.
"""

import contextlib
import logging
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.maps.base import MapKind, Row, run_batch

THREADS = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR")}
"""Environment of a worker: small matrices gain nothing from threads, which take its neighbours'
cores."""

type Batches = Mapping[int, Sequence[Row]]
type Engine = Callable[[MapKind, Batches], Iterator[tuple[int, list[Row]]]]
"""Yields the rows of each batch with its number, in any order."""


@contextlib.contextmanager
def engine(workers: int, scheduler: str = "") -> Iterator[Engine]:
    """Give an engine, and end what it started.

    Args:
        workers: processes on this machine; 0 simulates in this process, without Dask.
        scheduler: address of a Dask scheduler, say tcp://10.0.0.1:8786, in place of them.

    Raises:
        ConfigurationError: if Dask is not installed, or there is no scheduler.
    """
    if workers == 0 and not scheduler:
        yield _here
        return
    with _client(workers, scheduler) as client:
        yield lambda kind, batches: _distributed(client, kind, batches)


def _here(kind: MapKind, batches: Batches) -> Iterator[tuple[int, list[Row]]]:
    for number, cells in batches.items():
        yield number, run_batch(kind, cells)


def _distributed(client: Any, kind: MapKind, batches: Batches) -> Iterator[tuple[int, list[Row]]]:
    from distributed import as_completed

    shared = client.scatter(kind, broadcast=True, hash=False)
    futures = {
        client.submit(run_batch, shared, cells, pure=False): number
        for number, cells in batches.items()
    }
    try:
        for future, rows in as_completed(list(futures), with_results=True):
            yield futures[future], rows
    finally:
        client.cancel([f for f in futures if not f.done()])


@contextlib.contextmanager
def _client(workers: int, scheduler: str) -> Iterator[Any]:
    try:
        import dask
        from distributed import Client
    except ImportError as error:
        raise ConfigurationError(
            f"Dask is not installed ({error}): pip install 'dask[distributed]', or --workers 0"
        ) from error
    with contextlib.ExitStack() as stack:
        if not scheduler:
            stack.enter_context(dask.config.set({"distributed.nanny.pre-spawn-environ": THREADS}))
            yield stack.enter_context(Client(stack.enter_context(_cluster(workers))))
            return
        try:
            client = stack.enter_context(Client(scheduler, timeout="10s"))
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"no Dask scheduler at {scheduler}: {error}") from error
        yield client


def _cluster(workers: int) -> Any:
    from distributed import LocalCluster

    with _deaf_children():
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # None would ask for port 8787
            silence_logs=logging.CRITICAL,
        )


@contextlib.contextmanager
def _deaf_children() -> Iterator[None]:
    """Let processes that are started here not hear Ctrl-C: the client hears it, and ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
