"""The executable ``fault_campaign``: random faults by the hundred, and what came of them."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from eulerparams_control.command_line import make_console, say, whole_number
from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.campaign.oracles import Oracle
from eulerparams_control.lab.campaign.plan import (
    CONTROLLERS,
    FAULTY,
    KINDS,
    SequencePlan,
)
from eulerparams_control.lab.campaign.report import (
    SequenceOutcome,
    count_by_oracle,
    headline,
    write_page,
    write_summary,
)
from eulerparams_control.lab.campaign.schedule import plans, run_all

_EVERY = 25  # sequences for a line, where there is no terminal

SEQUENCES = 300


def oracle_table(outcomes: Sequence[SequenceOutcome]) -> Table:
    """Return the table of the oracles, and in how many sequences each found something."""
    found = count_by_oracle(outcomes)
    table = Table()
    for name in ("oracle", "what must hold", "sequences with a violation"):
        table.add_column(name, overflow="fold")
    for name, kind in Oracle.registry.items():
        style = "red" if found[name] else "green"
        table.add_row(name, kind.claim, f"[{style}]{found[name]}[/{style}]")
    return table


def main(args: list[str] | None = None) -> int:
    """Run ``fault_campaign [--sequences N] [--seed S] [--controller C] [--out DIR]``.

    Returns:
        the exit code: 0 if nothing was found, 1 if something was, 2 if a sequence could not be
        run.
    """
    return _main(_parse(args), make_console())


def _main(options: argparse.Namespace, console: Console) -> int:
    one, controllers = options.seed is not None, CONTROLLERS
    if options.controller:
        controllers = (options.controller,)
    count = options.sequences or (len(controllers) if one else SEQUENCES)
    todo = plans(count, options.seed or 0, controllers, options.kind)
    outcomes = _run(todo, options.jobs, console)
    page = _write(outcomes, options.out)
    console.print(oracle_table(outcomes))
    say(console, headline(outcomes), "bold")
    say(console, f"The page: {page.resolve()}")
    if any(outcome.violations for outcome in outcomes):
        return 1
    return 2 if any(outcome.error for outcome in outcomes) else 0


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="fault_campaign",
        description="Random faults on the topics and nodes of each controller: does "
        "what they command stay safe, and do they recover? A sequence is made of its seed and its "
        "controller, and repeats to the bit.",
        epilog="Ends with 1 if something was found, and with 2 if a sequence could not be run.",
    )
    parser.add_argument(
        "--sequences",
        type=whole_number(1),
        help=f"how many; default {SEQUENCES}, with --seed one each",
    )
    parser.add_argument("--seed", type=whole_number(), help="the first one; default 0")
    parser.add_argument("--controller", choices=CONTROLLERS, help="only this one")
    parser.add_argument(
        "--kind",
        choices=KINDS,
        default=FAULTY,
        help=f"{FAULTY} around one robot (default), or robots and users of all kinds, whose "
        "commands have to be smooth",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/faults"), help="folder of the results"
    )
    cores = len(os.sched_getaffinity(0))
    parser.add_argument(
        "--jobs", type=whole_number(1), default=cores, help="sequences at the same time"
    )
    return parser.parse_args(args)


def _run(todo: Sequence[SequencePlan], jobs: int, console: Console) -> list[SequenceOutcome]:
    """Run the sequences; show the progress, and each sequence that failed."""
    outcomes: list[SequenceOutcome] = []
    with Progress(console=console, disable=not console.is_terminal, transient=True) as bars:
        task = bars.add_task("no violation", total=len(todo))
        for outcome in run_all(todo, jobs):
            outcomes.append(outcome)
            done, bad = len(outcomes), sum(not one.is_good for one in outcomes)
            words = f"[red]{bad} failed[/red]" if bad else "no violation"
            bars.update(task, completed=done, description=words)
            if not outcome.is_good:
                say(console, f"{outcome.plan.name}: failed", "red")
                errors = [f"could not be run: {outcome.error}"] if outcome.error else []
                for line in (*outcome.violations, *errors):
                    say(console, f"  {line}")
                say(console, f"  repeat it: {outcome.plan.repeat}")
            if not console.is_terminal and (done % _EVERY == 0 or done == len(todo)):
                say(console, f"{done} of {len(todo)} sequences, {bad} failed")
    return sorted(outcomes, key=lambda o: todo.index(o.plan))


def _write(outcomes: Sequence[SequenceOutcome], out: Path) -> Path:
    """Write the page and the summary; return the page."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_page(out / "index.html", outcomes)
        write_summary(out / "summary.json", outcomes)
    except OSError as error:
        raise ConfigurationError(f"cannot write to {out}: {error.strerror}") from error
    return out / "index.html"


if __name__ == "__main__":
    sys.exit(main())
