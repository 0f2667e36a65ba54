"""The executable ``experiment``: run experiments, record, analyse, judge."""

import argparse
import os
import re
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.text import Text

from eulerparams_control.command_line import make_console, say, whole_number
from eulerparams_control.errors import ConfigurationError, EulerParamsError
from eulerparams_control.events import ExitCode
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.experiments.evaluate import Outcome
from eulerparams_control.lab.experiments.model import Experiment, Task, Variant
from eulerparams_control.lab.experiments.paper import (
    COMPARISON,
    claims_of,
    headline,
    paper_experiments,
    paper_table,
    write_paper_page,
    write_paper_summary,
)
from eulerparams_control.lab.experiments.runner import check_names
from eulerparams_control.lab.experiments.schedule import Display, Schedule
from eulerparams_control.lab.run.run_cache import locked
from eulerparams_control.resources import config_names

_LEAST, _MOST = 20.0, 360000.0  # [s] that --duration may be


def main(args: list[str] | None = None) -> int:
    """Run ``experiment NAME [NAME ...] [--out DIR] [--variant V ...]``, or ``--paper``.

    Returns:
        the exit code: 0 if every criterion that was judged is met, 1 if one is not, 2 if one
        could not run or after an error, 130 after a signal.
    """
    options, console = _parse(args), make_console()
    is_list = options.list or not (options.names or options.paper or options.compare)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        outcomes = (_list if is_list else _run)(options, console)
    except EulerParamsError as error:
        say(console, f"error: {error}", "red")
        return 2
    except KeyboardInterrupt:
        say(console, "stopped; the nodes were ended; the same command goes on from here", "red")
        return ExitCode.INTERRUPTED
    if any(outcome.error for outcome in outcomes):
        return 2
    return 1 if any(outcome.missed for outcome in outcomes) else 0


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="experiment",
        description="Run experiments in lock-step simulation, those with faults in real time, and "
        "judge them. What was run before, with the same definition and the same code, is not run "
        "again.",
        epilog="Ends with 1 if a criterion is not met, and with 2 if an experiment could not run. "
        "With --variant the criteria that need other variants are not judged; if none was "
        'judged, that is said, summary.json has "met": null, and the end is with 0.',
    )
    parser.add_argument("names", nargs="*", help="of config/experiments, or paths of YAML files")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the results")
    parser.add_argument("--variant", action="append", default=[], help="run only this one")
    parser.add_argument("--list", action="store_true", help="list the experiments")
    parser.add_argument(
        "--paper",
        action="store_true",
        help="write one page of all of them; without names, the paper's claims and those beyond it",
    )
    parser.add_argument(
        "--compare", action="store_true", help="the same of the laws that packages ship"
    )
    cores = len(os.sched_getaffinity(0))  # nodes in lock-step take one core together
    parser.add_argument("--jobs", type=whole_number(1), default=cores, help="runs at the same time")
    parser.add_argument(
        "--scheduler", default="", help="of Dask, tcp://HOST:8786, for the cells of maps"
    )
    parser.add_argument(
        "--duration", type=_seconds, help="of an experiment in real time, such as 90s, 20m or 1h"
    )
    parser.add_argument("--again", action="store_true", help="run again what was run before")
    return parser.parse_args(args)


def _seconds(text: str) -> float:
    """Return a duration [s] that a person wrote: a number and its unit."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)([smh])", text)
    seconds = float(found[1]) * {"s": 1, "m": 60, "h": 3600}[found[2]] if found else 0.0
    if not _LEAST <= seconds <= _MOST:
        raise argparse.ArgumentTypeError(
            f"{text}; expected {_LEAST:g}s to {_MOST / 3600:g}h, such as 90s, 20m or 1h"
        )
    return seconds


def lasting(experiment: Experiment, seconds: float) -> Experiment:
    """Return an experiment in real time with another duration [s], and a circle as much slower.

    Raises:
        ConfigurationError: if it is not in real time, or has faults, which have times of their own.
    """

    def variant(given: Variant) -> Variant:
        factor = seconds / given.duration
        reference = {
            name: factor * value if name in ("circle_period", "circle_ramp") else value
            for name, value in given.nodes.get("reference", {}).items()
        }
        nodes = {**given.nodes, "reference": reference}
        return replace(given, nodes=nodes, duration=seconds)

    runs = experiment.variants.values()
    if not runs or not all(given.real_time and not given.faults for given in runs):
        raise ConfigurationError(
            f"--duration: {experiment.name} has a duration of its own; expected an experiment "
            "with real_time: true and without faults, such as soak"
        )
    variants = {name: variant(given) for name, given in experiment.variants.items()}
    return replace(experiment, variants=variants)


def _list(_options: argparse.Namespace, console: Console) -> list[Outcome]:
    for name in config_names("experiments"):
        experiment = load_experiment(name)
        say(console, Text.assemble((name, "bold"), f"  {experiment.claim}"))
    return []


def _run(options: argparse.Namespace, console: Console) -> list[Outcome]:
    """Run the experiments that were asked for; write the page of the paper if it was."""
    experiments = _chosen(options.names, options.paper, options.compare)
    if options.duration:
        experiments = [lasting(experiment, options.duration) for experiment in experiments]
    out = options.out
    one_page = options.paper or options.compare
    tasks = [Task(e, out / e.name, check_names(options.variant, e)) for e in experiments]
    with ExitStack() as stack:
        for task in tasks:
            stack.enter_context(locked(task.folder))
        display = stack.enter_context(Display(console, tasks, details=not one_page))
        schedule = Schedule(tasks, options.jobs, display, options.again, options.scheduler)
        outcomes = schedule.run()
    if one_page:
        _write_paper(out, outcomes, console, options.compare)
    return outcomes


def _chosen(names: Sequence[str], paper: bool, compare: bool) -> list[Experiment]:
    """Return the experiments of these names; with none, those of the paper or the comparison."""
    if paper and not names:
        return paper_experiments()
    if compare:
        names = names or COMPARISON
    experiments = [load_experiment(name) for name in names]
    twice = {e.name for e in experiments if sum(o.name == e.name for o in experiments) > 1}
    if twice:
        raise ConfigurationError(
            f"named twice: {', '.join(sorted(twice))}; their results have "
            "one folder: name each once"
        )
    return experiments


def _write_paper(
    out: Path, outcomes: Sequence[Outcome], console: Console, comparison: bool
) -> None:
    page = out / "index.html"
    write_paper_page(page, outcomes, comparison)
    write_paper_summary(out / "summary.json", outcomes, comparison)
    console.print(paper_table(outcomes, console.width))
    if claims_of(outcomes, comparison):
        say(console, headline(outcomes, comparison), "bold")
    say(console, f"The page: {page.resolve()}")


if __name__ == "__main__":
    sys.exit(main())
