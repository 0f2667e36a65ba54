"""The executable ``fault_campaign``: random faults by the hundred, and what came of them."""

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from eulerparams_control.command_line import make_console, say, whole_number
from eulerparams_control.errors import ConfigurationError, EulerParamsError
from eulerparams_control.lab.campaign.oracles import Oracle
from eulerparams_control.lab.campaign.outcome import SequenceOutcome, count_by_oracle, headline
from eulerparams_control.lab.campaign.page import write_page, write_summary
from eulerparams_control.lab.campaign.plan import (
    CONTROLLERS,
    FAULTY,
    KINDS,
    LOCKSTEP,
    MODES,
    SequencePlan,
)
from eulerparams_control.lab.campaign.schedule import plans, plans_of_both, run_all
from eulerparams_control.lab.experiments.display import ProgressDisplay

_EVERY = 25  # sequences for a line, where there is no terminal

BOTH = "both"
SEQUENCES = 300


class CampaignDisplay(ProgressDisplay):
    """Shows how far a campaign is, and each sequence in which something was found.

    Args:
        console: where.
        total: of the sequences.
    """

    def __init__(self, console: Console, total: int) -> None:
        self._console, self._total = console, total
        self._done = self._bad = 0
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("sequences"),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self._task = self._progress.add_task("no violation", total=total)

    def ended(self, outcome: SequenceOutcome) -> None:
        """Show that a sequence has ended."""
        self._done += 1
        self._bad += not outcome.is_good
        words = f"[red]{self._bad} failed[/red]" if self._bad else "no violation"
        self._progress.update(self._task, completed=self._done, description=words)
        if not outcome.is_good:
            self._failed(outcome)
        is_plain = not self._console.is_terminal
        if is_plain and (self._done % _EVERY == 0 or self._done == self._total):
            say(self._console, f"{self._done} of {self._total} sequences, {self._bad} failed")

    def _failed(self, outcome: SequenceOutcome) -> None:
        say(self._console, f"{outcome.plan.name}: failed", "red")
        for violation in outcome.violations:
            say(self._console, f"  {violation}")
        if outcome.error:
            say(self._console, f"  could not be run: {outcome.error}")
        say(self._console, f"  repeat it: {outcome.plan.repeat}")


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
    """Run ``fault_campaign [--sequences N] [--seed S] [--controller C] [--mode M] [--out DIR]``.

    Returns:
        the exit code: 0 if nothing was found, 1 if something was, 2 if a sequence could not be
        run or after an error, 130 after an interrupt.
    """
    options = _parse(args)
    console = make_console()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the workers, as Ctrl-C does
    try:
        outcomes = _run(_plans(options), options.jobs, console)
        page = _write(outcomes, options.out)
    except EulerParamsError as error:
        say(console, f"error: {error}", "red")
        return 2
    except KeyboardInterrupt:
        say(console, "stopped; nothing was written", "red")
        return 130
    console.print(oracle_table(outcomes))
    say(console, headline(outcomes), "bold")
    say(console, f"The page: {page.resolve()}")
    if any(outcome.violations for outcome in outcomes):
        return 1
    return 2 if any(outcome.error for outcome in outcomes) else 0


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="fault_campaign",
        description="Random faults on the topics and nodes around the three controllers: does "
        "what they command stay safe, and do they recover? A sequence is made of its seed and its "
        "controller; in lock-step it repeats to the bit.",
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
        "--mode",
        choices=(*MODES, BOTH),
        help=f"default {BOTH}, most of them in {LOCKSTEP}; with --seed {LOCKSTEP}",
    )
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


def _plans(options: argparse.Namespace) -> list[SequencePlan]:
    """Return the sequences that were asked for."""
    one = options.seed is not None
    controllers = (options.controller,) if options.controller else CONTROLLERS
    count = options.sequences or (len(controllers) if one else SEQUENCES)
    mode = options.mode or (LOCKSTEP if one else BOTH)
    if mode == BOTH:
        return plans_of_both(count, options.seed or 0, controllers, options.kind)
    return plans(count, options.seed or 0, controllers, mode, options.kind)


def _run(todo: Sequence[SequencePlan], jobs: int, console: Console) -> list[SequenceOutcome]:
    outcomes = []
    with CampaignDisplay(console, len(todo)) as display:
        for outcome in run_all(todo, jobs):
            outcomes.append(outcome)
            display.ended(outcome)
    return sorted(outcomes, key=lambda o: todo.index(o.plan))


def _write(outcomes: Sequence[SequenceOutcome], out: Path) -> Path:
    """Write the page and the summary; return the page."""
    page = out / "index.html"
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_page(page, outcomes)
        write_summary(out / "summary.json", outcomes)
    except OSError as error:
        raise ConfigurationError(f"cannot write to {out}: {error.strerror}") from error
    return page


if __name__ == "__main__":
    sys.exit(main())
