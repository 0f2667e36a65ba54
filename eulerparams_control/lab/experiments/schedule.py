"""Run experiments: their variants side by side as the machine has cores, judged as they end.

Runs are processes of nodes, which threads watch.  Looking at bags takes a core for itself, so one
more process does that, while the next runs go on.  What was run before with the same definition
and the same code is not run again.  A run whose recorder starved is run once more, by itself.
"""

import threading
from collections.abc import Sequence
from concurrent.futures import Future, wait
from contextlib import ExitStack
from functools import partial

from eulerparams_control.errors import text_of
from eulerparams_control.lab.experiments.display import Display
from eulerparams_control.lab.experiments.evaluate import look
from eulerparams_control.lab.experiments.model import Task
from eulerparams_control.lab.experiments.result import Outcome
from eulerparams_control.lab.experiments.runner import IncompleteBagError, known_run, run_variant
from eulerparams_control.lab.run.jobs import Processes, Threads, results
from eulerparams_control.lab.run.run_cache import Run

_Pair = tuple[Task, str]


class Schedule:
    """Runs tasks.

    Args:
        tasks: the experiments, in the order in which they begin.
        jobs: how many variants run at the same time.
        display: is told of it.
        again: whether to run also what was run before.
    """

    def __init__(
        self, tasks: Sequence[Task], jobs: int, display: Display, again: bool = False
    ) -> None:
        self._tasks, self._jobs, self._display, self._again = tasks, jobs, display, again
        self._stop = threading.Event()
        self._looks: dict[str, Future[Outcome]] = {}
        self._whys: dict[tuple[str, str], str] = {}  # runs are made again

    def run(self) -> list[Outcome]:
        """Return what came of each experiment, in their order."""
        pairs = [(task, variant) for task in self._tasks for variant in task.variants]
        with ExitStack() as stack:
            lookers, looker = stack.enter_context(Threads(1)), stack.enter_context(Processes(1))
            threads = stack.enter_context(Threads(self._jobs))
            stack.callback(self._stop.set)  # ends all runs with their nodes

            def end(task: Task) -> None:
                looking = lookers.submit(self._look, looker, task)
                self._looks[task.experiment.name] = looking

            for task in self._tasks:
                if not task.variants:
                    end(task)
            runs = results(threads, self._run, pairs, IncompleteBagError, self._incomplete)
            for (task, variant), future in runs:
                task.runs[variant] = None
                try:
                    task.runs[variant] = future.result()
                except IncompleteBagError as error:
                    task.error = task.error or f"{variant}: {error}, run by itself, too"
                except Exception as error:  # of any kind: the others go on
                    task.error = task.error or f"{variant}: {text_of(error)}"
                if len(task.runs) == len(task.variants):
                    end(task)
            return [self._looks[task.experiment.name].result() for task in self._tasks]

    def _run(self, pair: _Pair) -> Run | None:
        """Run a variant, unless it was run before; None if its experiment has failed."""
        (task, variant), experiment = pair, pair[0].experiment
        key, duration = (experiment.name, variant), experiment.variants[variant].duration
        if task.error or self._stop.is_set():
            return None
        known, why = known_run(experiment, variant, task.folder)
        if known is not None and not self._again:
            self._display.ended(*key, "was run before", duration)
            return known
        if key in self._whys:  # by itself: nobody looks at a bag, either
            wait(self._looks.values())
        why = self._whys.setdefault(key, why)  # a run that is repeated knows no more
        self._display.started(*key, duration)
        show = partial(self._display.simulated, *key)
        run = run_variant(experiment, variant, task.folder, show, self._stop)
        again = f", again: {why}" if why else ""
        self._display.ended(*key, f"{run.seconds:.1f} s{again}", duration)
        return run

    def _incomplete(self, pair: _Pair, why: Exception) -> None:
        """Say that a run whose recorder starved is run once more, when no other goes on."""
        self._display.repeated(pair[0].experiment.name, pair[1], str(why))

    def _look(self, looker: Processes, task: Task) -> Outcome:
        """Return what came of an experiment, after all its runs."""
        outcome = Outcome(task.experiment, task.folder, error=task.error)
        try:
            if not (task.error or self._stop.is_set()):
                runs = {name: run for name in task.variants if (run := task.runs[name])}
                outcome = looker.submit(look, task.experiment, task.folder, runs).result()
        except Exception as error:  # of any kind: the others go on
            outcome = Outcome(task.experiment, task.folder, error=text_of(error))
        if not self._stop.is_set():
            self._display.finished(outcome)
        return outcome
