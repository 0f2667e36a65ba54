"""Jobs side by side: in threads, in processes that end with us, or in workers of Dask.

A job gives the same wherever it runs; workers of Dask share no files with us, and need only that
this package is installed.
"""

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from eulerparams_control.command_line import make_console, say
from eulerparams_control.errors import ConfigurationError, EulerParamsError

# Environment of a worker: small matrices gain nothing from threads, which take its neighbours'
# cores.
_THREADS = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR")}

# Dask looks into its threads every 10 ms, and wakes up every 20 ms, unless told otherwise.
_DASK = {
    "distributed.nanny.pre-spawn-environ": _THREADS,
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
}


def results[J, R](
    pool: Executor,
    function: Callable[[J], R],
    jobs: Iterable[J],
    again: type[Exception] = BrokenExecutor,
    repeats: Callable[[J, Exception], None] = lambda _job, _error: None,
) -> Iterator[tuple[J, Future[R]]]:
    """Yield each job with its future, as the jobs end.

    Args:
        pool: where they run.
        function: of a job.
        jobs: all of them.
        again: the error after which a job is done once more by itself, when no other goes on: by
            default that its worker died.
        repeats: told of each that is to be done once more, and why.
    """
    running = {pool.submit(function, job): job for job in jobs}
    lost = []
    for future in as_completed(running):
        error = future.exception()
        if isinstance(error, again):
            lost.append(running[future])
            repeats(running[future], error)
        else:
            yield running[future], future
    for job in lost:
        for alone in as_completed([pool.submit(function, job)]):
            yield job, alone


class Threads(ThreadPoolExecutor):
    """Threads; at the end of ``with`` pending jobs are cancelled."""

    def __exit__(self, *_error: object) -> None:
        self.shutdown(cancel_futures=True)


class Processes(Executor):
    """Silent worker processes; if one dies, all are replaced.

    A Ctrl-C in the terminal is ours to pass on: at the end of ``with`` they are ended.

    Args:
        count: how many.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._pool, self._ended, self._lock = self._new(), False, threading.Lock()
        self._starter = ThreadPoolExecutor(1)  # a signal interrupts no thread but the main one

    def _new(self) -> ProcessPoolExecutor:
        spawn = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._count, mp_context=spawn, initializer=_be_quiet)

    def submit[**P, R](
        self, function: Callable[P, R], /, *args: P.args, **keywords: P.kwargs
    ) -> Future[R]:
        """See Executor."""
        job = partial(function, *args, **keywords)
        return self._starter.submit(self._submit, job).result()

    def _submit[R](self, job: Callable[[], R]) -> Future[R]:
        with self._lock:
            try:
                return self._pool.submit(job)
            except BrokenExecutor:
                if self._ended:
                    raise
                self._pool = self._new()
                return self._pool.submit(job)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Terminate the processes, whatever they do."""
        with self._lock:
            self._ended = True
            workers = list((self._pool._processes or {}).values())
            manager: Any = self._pool._executor_manager_thread
            self._pool.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.terminate()
        if manager is not None and wait:
            manager.join()  # else it may close the pipe to which the interpreter writes at its end


def _be_quiet() -> None:
    """Ignore Ctrl-C, and silence the libraries."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    silence = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(silence, stream)


@contextmanager
def workers(count: int, scheduler: str = "") -> Iterator[Executor]:
    """Yield an executor of Dask workers, and end those that were started.

    Args:
        count: processes on this machine; 0 is a thread of this one, without Dask.
        scheduler: address of a Dask scheduler, say tcp://10.0.0.1:8786, in place of them.

    Raises:
        ConfigurationError: if Dask is not installed, or there is no scheduler.
    """
    if not (count or scheduler):
        with Threads(1) as here:
            yield here
        return
    try:
        import dask
        from distributed import Client
    except ImportError as error:
        raise ConfigurationError(
            f"Dask is not installed ({error}): pip install 'dask[distributed]', or --workers 0"
        ) from error
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(_DASK))
        try:
            at = scheduler or stack.enter_context(_cluster(count))
            client = stack.enter_context(Client(at, timeout="10s" if scheduler else "30s"))
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"no Dask scheduler at {scheduler}: {error}") from error
        yield client.get_executor(pure=False)


def _cluster(count: int) -> Any:
    """Return a scheduler with workers that ignore Ctrl-C: the client gets it, and ends them."""
    from distributed import LocalCluster

    is_main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if is_main else None
    try:
        return LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # None would ask for port 8787
            silence_logs=logging.CRITICAL,
        )
    finally:
        if is_main:
            signal.signal(signal.SIGINT, before)


def progress(console: Console, unit: str) -> Progress:
    """Return bars that count jobs; shown while entered, and only in a terminal.

    Args:
        console: where.
        unit: what is counted.
    """
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeElapsedColumn(),
        console=console,
        disable=not console.is_terminal,
        transient=True,
    )


def carry_out(run: Callable[[Console], int], stopped: str) -> int:
    """Return the exit code of a program: that of ``run``, 2 after an error, 130 if interrupted.

    Args:
        run: what it does.
        stopped: what is said after an interrupt; SIGTERM is one, too.
    """
    console = make_console()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return run(console)
    except EulerParamsError as error:
        say(console, f"error: {error}", "red")
        return 2
    except KeyboardInterrupt:
        say(console, f"stopped; {stopped}", "red")
        return 130
