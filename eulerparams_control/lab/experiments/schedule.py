"""Run experiments: their variants side by side as the machine has cores, judged as they end.

Runs are processes of nodes, which threads watch.  Looking at bags takes a core for itself, so one
more process does that, while the next runs go on.  What was run before with the same definition
and the same code is not run again.  A run whose recorder starved is run once more, by itself.
"""

import multiprocessing
import signal
import threading
from collections.abc import Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from eulerparams_control.errors import EulerParamsError
from eulerparams_control.lab.experiments.evaluate import look
from eulerparams_control.lab.experiments.model import Experiment
from eulerparams_control.lab.experiments.result import Outcome
from eulerparams_control.lab.experiments.run_cache import Run
from eulerparams_control.lab.experiments.runner import IncompleteBagError, known_run, run_variant


class Watcher(Protocol):
    """What is told of what goes on; from any thread."""

    def started(self, experiment: str, variant: str, duration: float) -> None:
        """Note that a run begins, of ``duration`` [s] of simulated time."""

    def simulated(self, experiment: str, variant: str, t: float) -> None:
        """Note how far it is [s]."""

    def ended(self, experiment: str, variant: str, how: str, duration: float) -> None:
        """Note that a run ended, or was there already, in words."""

    def repeated(self, experiment: str, variant: str, why: str) -> None:
        """Note that a run counts for nothing, and will be run once more."""

    def finished(self, outcome: Outcome) -> None:
        """Note what came of an experiment."""


@dataclass
class Task:
    """An experiment that is to be run.

    Attributes:
        experiment: which.
        folder: where its results go.
        variants: those to run.
        runs: those that have ended.
        error: why one could not; "" if all could.
    """

    experiment: Experiment
    folder: Path
    variants: Sequence[str]
    runs: dict[str, Run] = field(default_factory=dict)
    error: str = ""

    def look(self) -> Outcome:
        """Return what came of it."""
        runs = {name: self.runs[name] for name in self.variants}
        return look(self.experiment, self.folder, runs)


class Schedule:
    """Runs tasks.

    Args:
        tasks: the experiments, in the order in which they begin.
        jobs: how many variants run at the same time.
        watcher: is told of it.
        again: whether to run also what was run before.
    """

    def __init__(
        self, tasks: Sequence[Task], jobs: int, watcher: Watcher, again: bool = False
    ) -> None:
        self._tasks = tasks
        self._watcher = watcher
        self._again = again
        self._stop = threading.Event()
        self._threads = ThreadPoolExecutor(jobs)
        self._looker = _looker()
        self._running: dict[Future[Run | None], tuple[Task, str]] = {}
        self._looking: dict[Future[Outcome], Task] = {}
        self._starved: list[tuple[Task, str]] = []  # to be run once more
        self._repeated: set[tuple[str, str]] = set()
        self._whys: dict[tuple[str, str], str] = {}  # runs are made again
        self._outcomes: dict[str, Outcome] = {}

    def run(self) -> list[Outcome]:
        """Return what came of each experiment, in their order."""
        try:
            for task in self._tasks:
                for variant in task.variants:
                    self._submit(task, variant)
                if not task.variants:
                    self._look(task)
            while self._running or self._looking or self._starved:
                if not self._running and not self._looking:
                    self._submit(*self._starved.pop(0))
                self._advance()
        finally:
            self._end()
        return [self._outcomes[task.experiment.name] for task in self._tasks]

    def _submit(self, task: Task, variant: str) -> None:
        self._running[self._threads.submit(self._run, task, variant)] = task, variant

    def _end(self) -> None:
        """End what still goes on: all runs with their nodes, and the process that looks."""
        self._stop.set()
        self._threads.shutdown(cancel_futures=True)
        for child in multiprocessing.active_children():
            child.terminate()
        self._looker.shutdown(cancel_futures=True)

    def _run(self, task: Task, variant: str) -> Run | None:
        """Run a variant, unless it was run before; None if its experiment has failed."""
        experiment, name = task.experiment, task.experiment.name
        duration = experiment.variants[variant].duration
        if task.error or self._stop.is_set():
            return None
        known, why = known_run(experiment, variant, task.folder)
        if known is not None and not self._again:
            self._watcher.ended(name, variant, "was run before", duration)
            return known
        why = self._whys.setdefault((name, variant), why)  # a run that is repeated knows no more
        self._watcher.started(name, variant, duration)
        show = partial(self._watcher.simulated, name, variant)
        run = run_variant(experiment, variant, task.folder, show, self._stop)
        again = f", again: {why}" if why else ""
        self._watcher.ended(name, variant, f"{run.seconds:.1f} s{again}", duration)
        return run

    def _advance(self) -> None:
        """Wait for what ends next, and go on from there."""
        pending: list[Future[Any]] = [*self._running, *self._looking]
        done, _ = wait(pending, timeout=0.5, return_when=FIRST_COMPLETED)
        for future in done:
            if future in self._running:
                self._ran(*self._running.pop(future), future)
            else:
                self._looked(self._looking.pop(future), future)

    def _ran(self, task: Task, variant: str, future: "Future[Run | None]") -> None:
        try:
            run = future.result()
            if run is not None:
                task.runs[variant] = run
        except IncompleteBagError as error:
            self._incomplete(task, variant, str(error))
        except Exception as error:  # of any kind: the others go on
            task.error = task.error or f"{variant}: {_said(error)}"
        if task.error:
            self._starved = [pair for pair in self._starved if pair[0] is not task]
        if any(other is task for other, _ in (*self._running.values(), *self._starved)):
            return
        if task.error:
            self._finish(task, Outcome(task.experiment, task.folder, error=task.error))
        else:
            self._look(task)

    def _incomplete(self, task: Task, variant: str, why: str) -> None:
        """Let a run whose recorder starved be run once more, when no other goes on."""
        name = task.experiment.name
        if (name, variant) in self._repeated:
            task.error = task.error or f"{variant}: {why}, run by itself, too"
            return
        self._repeated.add((name, variant))
        self._starved.append((task, variant))
        self._watcher.repeated(name, variant, why)

    def _look(self, task: Task) -> None:
        try:
            future = self._looker.submit(task.look)
        except BrokenProcessPool:  # it was killed while it looked at another
            self._looker = _looker()
            future = self._looker.submit(task.look)
        self._looking[future] = task

    def _looked(self, task: Task, future: "Future[Outcome]") -> None:
        try:
            outcome = future.result()
        except Exception as error:  # of any kind: the others go on
            outcome = Outcome(task.experiment, task.folder, error=_said(error))
        self._finish(task, outcome)

    def _finish(self, task: Task, outcome: Outcome) -> None:
        self._outcomes[task.experiment.name] = outcome
        self._watcher.finished(outcome)


def _said(error: Exception) -> str:
    """Return what an error says; of one that is not ours its type, too."""
    return str(error) if isinstance(error, EulerParamsError) else repr(error)


def _looker() -> ProcessPoolExecutor:
    """Return the process that looks at bags; a Ctrl-C in the terminal is ours to pass on."""
    return ProcessPoolExecutor(
        1,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    )
