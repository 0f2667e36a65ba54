"""Progress of experiments: bars in a terminal, plain lines elsewhere."""

import threading
from collections.abc import Sequence
from typing import Self

from rich.console import Console
from rich.progress import TaskID
from rich.table import Table
from rich.text import Text

from eulerparams_control.analysis.verdict import Verdict, groups, shown
from eulerparams_control.command_line import say
from eulerparams_control.lab.experiments.model import Task
from eulerparams_control.lab.experiments.result import REPORT, Outcome, why_nothing
from eulerparams_control.lab.run.jobs import progress


class Display:
    """Shows how far the runs are, and what came of each experiment.

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
        self._progress = progress(console, "s simulated")
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
        """Show a run that begins, of ``duration`` [s] of simulated time."""
        with self._lock:
            task = self._progress.add_task(f"{experiment} {variant}", total=duration)
            self._runs[experiment, variant] = task

    def simulated(self, experiment: str, variant: str, t: float) -> None:
        """Show how far a run is [s]."""
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
        """Take a run off the screen; where there is no terminal, say how it ended in a line."""
        with self._lock:
            self._done += 1
            self._times[experiment, variant] = duration
            self._remove((experiment, variant))
            self._show_all()
            if not self._console.is_terminal:
                say(self._console, f"  {experiment} {variant}: {how}")

    def repeated(self, experiment: str, variant: str, why: str) -> None:
        """Take a run that counts for nothing off the screen, and say why."""
        with self._lock:
            self._times.pop((experiment, variant), None)
            self._remove((experiment, variant))
            text = f"  {experiment} {variant}: incomplete, to be run once more by itself: {why}"
            say(self._console, Text(text, style="yellow"))

    def finished(self, outcome: Outcome) -> None:
        """Say what came of an experiment."""
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
