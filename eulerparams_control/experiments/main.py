"""The executable ``experiment``: run experiments, record, analyse, judge."""

import argparse
import signal
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table

from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.sentence import describe, fill
from eulerparams_control.analysis.text import number
from eulerparams_control.errors import EulerParamsError
from eulerparams_control.experiments.criteria import Verdict, diverged, judge, write_summary
from eulerparams_control.experiments.definition import Experiment, load_experiment
from eulerparams_control.experiments.runner import Run, check_names, run_variant
from eulerparams_control.resources import config_names


def main(args: list[str] | None = None) -> int:
    """Run ``experiment NAME [NAME ...] [--out DIR] [--variant V ...]``.

    Returns:
        the exit code: 0 if every criterion is met, 1 if one is not, 2 after an error.
    """
    options = _parse(args)
    console = Console()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the nodes, as Ctrl-C does
    try:
        if options.list or not options.names:
            return _list(console)
        experiments = [load_experiment(name) for name in options.names]
        results = [_run(e, options.out / e.name, options.variant, console) for e in experiments]
    except EulerParamsError as error:
        console.print(f"error: {error}", style="red", markup=False, highlight=False)
        return 2
    except KeyboardInterrupt:
        console.print("stopped; the nodes were ended", style="red")
        return 130
    return 0 if all(results) else 1


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="experiment", description="Run experiments in lock-step simulation and judge them."
    )
    parser.add_argument("names", nargs="*", help="of config/experiments, or paths of YAML files")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the results")
    parser.add_argument("--variant", action="append", default=[], help="run only this one")
    parser.add_argument("--list", action="store_true", help="list the experiments")
    return parser.parse_args(args)


def _list(console: Console) -> int:
    for name in config_names("experiments"):
        experiment = load_experiment(name)
        console.print(f"[bold]{name}[/bold]  {experiment.claim}", highlight=False)
    return 0


def _run(experiment: Experiment, folder: Path, names: list[str], console: Console) -> bool:
    """Run one experiment; return whether all its criteria are met."""
    variants = check_names(names, experiment)
    console.print(f"[bold]{experiment.name}[/bold]: {experiment.claim}", highlight=False)
    runs = _run_variants(experiment, variants, folder, console)
    with console.status("analysing the bags"):
        recordings = {
            variant: replace(Recording.load(run.bag), diverged=run.diverged)
            for variant, run in runs.items()
        }
        verdicts = judge(experiment, recordings)
        write_summary(folder / "summary.json", experiment, recordings, verdicts)
        sentence = _sentence(experiment, recordings)
        page = folder / "report.html"
        shown, picture = list(recordings.values()), experiment.picture
        write_page(page, shown, experiment.claim, sentence, verdicts, picture)
    console.print(_table(verdicts))
    for variant, t in diverged(recordings):
        console.print(f"{variant} diverged at {t:.3f} s", style="yellow", highlight=False)
    console.print(sentence, highlight=False)
    console.print(f"The page: {page.resolve()}", highlight=False, soft_wrap=True)
    return all(verdict.met for verdict in verdicts)


def _run_variants(
    experiment: Experiment, variants: list[str], folder: Path, console: Console
) -> dict[str, Run]:
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f} of {task.total:g} s simulated"),
        TimeElapsedColumn(),
    )
    runs = {}
    with Progress(*columns, console=console) as progress:
        for variant in variants:
            task = progress.add_task(variant, total=experiment.variants[variant].duration)
            started = time.monotonic()
            show = partial(_show, progress, task)
            run = runs[variant] = run_variant(experiment, variant, folder, show)
            _show(progress, task, run.duration)
            if not console.is_terminal:
                console.print(f"  {variant}: {time.monotonic() - started:.1f} s", highlight=False)
    return runs


def _show(progress: Progress, task: TaskID, t: float) -> None:
    progress.update(task, completed=t)


def _sentence(experiment: Experiment, recordings: dict[str, Recording]) -> str:
    """Return the summary of the experiment with its numbers; if only some variants ran, theirs."""
    if experiment.summary and recordings.keys() == experiment.variants.keys():
        return fill(experiment.summary, recordings, experiment.options)
    return describe(list(recordings.values()))


def _table(verdicts: list[Verdict]) -> Table:
    table = Table(title=None)
    for name in ("criterion", "variant", "predicted", "measured", "bound", "met"):
        numeric = name in ("predicted", "measured")
        table.add_column(name, justify="right" if numeric else "left", overflow="fold")
    for verdict in verdicts:
        table.add_row(
            verdict.text,
            verdict.variant,
            verdict.predicted,
            f"{number(verdict.measured)} {verdict.unit}",
            verdict.bound,
            "[green]yes[/green]" if verdict.met else "[red]no[/red]",
        )
    return table


if __name__ == "__main__":
    sys.exit(main())
