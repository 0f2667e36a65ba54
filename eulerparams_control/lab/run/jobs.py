"""Workers of the lab: processes on this machine, or those of a Dask scheduler."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.run.processes import end_with_parent


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """Yield silent processes, started as they are needed; at the end they are terminated."""
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, mp_context=spawn, initializer=_be_quiet)
    started = pool._processes  # filled by submit, forgotten by shutdown
    try:
        yield pool
    finally:
        manager: threading.Thread | None = pool._executor_manager_thread  # type: ignore[assignment]
        pool.shutdown(wait=False, cancel_futures=True)  # waits for a submit that goes on
        for process in list(started.values()):
            process.terminate()
            process.join()
        if manager is not None:
            manager.join()  # else it may close the pipe to which the interpreter writes at its end


def _be_quiet() -> None:
    """End with who started us, and not by Ctrl-C, which it passes on; silence the libraries."""
    end_with_parent(signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    silence = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(silence, stream)


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Yield the workers of a Dask scheduler, say tcp://10.0.0.1:8786, which have this package.

    Raises:
        ConfigurationError: if Dask is not installed, or there is no scheduler.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ConfigurationError(
            f"--scheduler needs Dask ({error}): pip install distributed"
        ) from error
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"no Dask scheduler at {address}: {error}") from error
    with client:
        yield client.get_executor(pure=False)
