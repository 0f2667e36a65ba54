"""Run experiments: their variants side by side as the machine has cores, judged as they end.

Runs are processes of nodes, which threads watch.  Looking at bags takes a core for itself, so one
more process does that, while the next runs go on.  The cells of a map are for processes of
their own, or for the workers of a Dask scheduler.  What was run before with the same definition
and the same code is not run again.  A run whose recorder starved is run once more, by itself.
"""

import threading
from collections.abc import Sequence
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ThreadPoolExecutor,
    as_completed,
    wait,
)
from contextlib import ExitStack
from functools import partial
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

from eulerparams_control.analysis.verdict import Verdict, groups, shown
from eulerparams_control.command_line import say
from eulerparams_control.errors import text_of
from eulerparams_control.lab.experiments.evaluate import REPORT, Outcome, look, why_nothing
from eulerparams_control.lab.experiments.library import is_map
from eulerparams_control.lab.experiments.model import Task
from eulerparams_control.lab.experiments.runner import IncompleteBagError, known_run, run_variant
from eulerparams_control.lab.run.jobs import cluster, processes
from eulerparams_control.lab.run.run_cache import Run


class Display:
    """Shows the progress of the runs, and the outcome of each experiment.

    Args:
        console: where.
        tasks: all that is to be run.
        details: whether each experiment gets its table, or one line only.
    """

    def __init__(self, console: Console, tasks: Sequence[Task], details: bool) -> None:
        self._console = console
        self._details = details
        self._lock = threading.Lock()
        self._runs: dict[tuple[str, str], TaskID] = {}
        self._times: dict[tuple[str, str], float] = {}
        runs = [task.experiment.variants[name] for task in tasks for name in task.variants]
        self._count, self._done = len(runs), 0
        self._tasks, self._finished = len(tasks), 0
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("s simulated"),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self._all = self._progress.add_task(
            self._overall(), total=sum(run.duration for run in runs)
        )

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._progress.stop()

    def _overall(self) -> str:
        experiments = f"{self._finished} of {self._tasks} experiments"
        runs = f"{self._done} of {self._count} runs, " if self._count else ""
        return f"[bold]{runs}{experiments}[/bold]"

    def started(self, experiment: str, variant: str, duration: float) -> None:
        """Show a run that begins and lasts ``duration`` [s] of simulated time."""
        with self._lock:
            task = self._progress.add_task(f"{experiment} {variant}", total=duration)
            self._runs[experiment, variant] = task

    def simulated(self, experiment: str, variant: str, t: float) -> None:
        """Show the time [s] that a run has reached."""
        with self._lock:
            key = experiment, variant
            self._times[key] = max(self._times.get(key, 0.0), t)
            if key in self._runs:
                self._progress.update(self._runs[key], completed=t)
            self._show_all()

    def _show_all(self) -> None:
        text = self._overall()
        self._progress.update(self._all, completed=sum(self._times.values()), description=text)

    def _remove(self, key: tuple[str, str]) -> None:
        if key in self._runs:
            self._progress.remove_task(self._runs.pop(key))

    def ended(self, experiment: str, variant: str, how: str, duration: float) -> None:
        """Remove the bar of a run; without a terminal print how it ended."""
        with self._lock:
            self._done += 1
            self._times[experiment, variant] = duration
            self._remove((experiment, variant))
            self._show_all()
            if not self._console.is_terminal:
                say(self._console, f"  {experiment} {variant}: {how}")

    def repeated(self, experiment: str, variant: str, why: str) -> None:
        """Remove the bar of a run that has to be repeated, and print why."""
        with self._lock:
            self._times.pop((experiment, variant), None)
            self._remove((experiment, variant))
            text = f"  {experiment} {variant}: incomplete, to be run once more by itself: {why}"
            say(self._console, Text(text, style="yellow"))

    def finished(self, outcome: Outcome) -> None:
        """Print the outcome of an experiment."""
        with self._lock:
            self._finished += 1
            self._show_all()
            for key in [key for key in self._runs if key[0] == outcome.experiment.name]:
                self._remove(key)
            if self._details:
                self._say_details(outcome)
            else:
                say(self._console, _line(outcome))

    def _say_details(self, outcome: Outcome) -> None:
        name = outcome.experiment.name
        say(self._console, Text.assemble((name, "bold"), f": {outcome.experiment.claim}"))
        if outcome.error:
            say(self._console, Text(f"error: {name}: {outcome.error}", style="red"))
            return
        if outcome.verdicts:
            self._console.print(verdict_table(outcome.verdicts))
        else:
            say(self._console, Text(why_nothing(outcome.experiment), style="yellow"))
        for variant, t in outcome.diverged.items():
            say(self._console, Text(f"{variant} diverged at {t:.3f} s", style="yellow"))
        say(self._console, outcome.sentence)
        say(self._console, f"The page: {(outcome.folder / REPORT).resolve()}")


def _line(outcome: Outcome) -> Text:
    style = "green" if outcome.met else "red" if outcome.missed or outcome.error else "yellow"
    parts: list[tuple[str, str]] = [
        (f"{outcome.experiment.name:<18}", "bold"),
        (outcome.count, style),
    ]
    text = Text.assemble(*parts, f"  {outcome.sentence}")
    return text.append(f"\n{outcome.error}", "red") if outcome.error else text


def verdict_table(verdicts: Sequence[Verdict]) -> Table:
    """Return the table of criteria; what those of several variants have in common once."""
    table = Table(title=None)
    for name in ("criterion", "variant", "predicted", "measured", "bound", "met"):
        numeric = name in ("predicted", "measured")
        table.add_column(name, justify="right" if numeric else "left", overflow="fold")
    for group in groups(list(verdicts)):
        for index, verdict in enumerate(group.verdicts):
            first = index == 0
            table.add_row(
                verdict.text if first else "",
                verdict.variant,
                verdict.predicted if first else "",
                shown(verdict),
                verdict.bound if first else "",
                "[green]yes[/green]" if verdict.met else "[red]no[/red]",
            )
        table.add_section()
    return table


_Pair = tuple[Task, str]


class Schedule:
    """Runs tasks.

    Args:
        tasks: the experiments, in the order in which they begin.
        jobs: how many variants run at the same time.
        display: is told of it.
        again: whether to run also what was run before.
        scheduler: address of a Dask scheduler, for the cells of maps; "": processes of our own.
    """

    def __init__(
        self,
        tasks: Sequence[Task],
        jobs: int,
        display: Display,
        again: bool = False,
        scheduler: str = "",
    ) -> None:
        self._tasks, self._jobs, self._display, self._again = tasks, jobs, display, again
        self._scheduler = scheduler
        self._stop = threading.Event()
        self._looker: Executor
        self._looks: dict[str, Future[Outcome]] = {}
        self._whys: dict[tuple[str, str], str] = {}  # runs are made again

    def run(self) -> list[Outcome]:
        """Return the outcomes of the experiments, in their order."""
        pairs = [(task, variant) for task in self._tasks for variant in task.variants]
        with ExitStack() as stack:
            # Ended from the last one up; a signal interrupts no thread but this one.
            lookers = ThreadPoolExecutor(1)
            stack.callback(lookers.shutdown, cancel_futures=True)
            self._looker = stack.enter_context(processes(1))
            workers = cluster(self._scheduler) if self._scheduler else processes(self._jobs)
            cells = stack.enter_context(workers)
            threads = ThreadPoolExecutor(self._jobs)
            stack.callback(threads.shutdown, cancel_futures=True)
            stack.callback(self._stop.set)  # ends all runs with their nodes

            def end(task: Task) -> None:
                looking = lookers.submit(self._look, stack, cells, task)
                self._looks[task.experiment.name] = looking

            for task in self._tasks:
                if not task.variants:
                    end(task)
            starved = []
            running = {threads.submit(self._run, pair): pair for pair in pairs}
            for future in as_completed(running):
                (task, variant), error = running[future], future.exception()
                if isinstance(error, IncompleteBagError):
                    self._display.repeated(task.experiment.name, variant, str(error))
                    starved.append((task, variant))
                elif self._keep(task, variant, future):
                    end(task)
            for task, variant in starved:  # no other goes on
                if self._keep(task, variant, threads.submit(self._run, (task, variant))):
                    end(task)
            return [self._looks[task.experiment.name].result() for task in self._tasks]

    def _keep(self, task: Task, variant: str, future: Future[Run | None]) -> bool:
        """Wait for a run, keep what came of it, return whether it was the last of its task."""
        task.runs[variant] = None
        try:
            task.runs[variant] = future.result()
        except IncompleteBagError as error:
            task.error = task.error or f"{variant}: {error}, run by itself, too"
        except Exception as error:  # of any kind: the others go on
            task.error = task.error or f"{variant}: {text_of(error)}"
        return len(task.runs) == len(task.variants)

    def _run(self, pair: _Pair) -> Run | None:
        """Run a variant, unless it was run before; return None if its experiment has failed."""
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

    def _look(self, stack: ExitStack, cells: Executor, task: Task) -> Outcome:
        """Return the outcome of an experiment, after all its runs."""
        outcome = Outcome(task.experiment, task.folder, error=task.error)
        try:
            if not (task.error or self._stop.is_set()):
                runs = {name: run for name in task.variants if (run := task.runs[name])}
                if is_map(task.experiment.library):
                    outcome = look(task.experiment, task.folder, runs, cells)
                else:
                    outcome = self._looker.submit(look, task.experiment, task.folder, runs).result()
        except Exception as error:  # of any kind: the others go on
            if isinstance(error, BrokenExecutor):  # the process has died
                self._looker = stack.enter_context(processes(1))
            outcome = Outcome(task.experiment, task.folder, error=text_of(error))
        if not self._stop.is_set():
            self._display.finished(outcome)
        return outcome
