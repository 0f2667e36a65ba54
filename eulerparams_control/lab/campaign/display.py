"""What the terminal shows of a campaign: a bar in a terminal, plain lines elsewhere."""

from collections.abc import Sequence
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from eulerparams_control.command_line import say
from eulerparams_control.lab.campaign.oracles import Oracle
from eulerparams_control.lab.campaign.outcome import SequenceOutcome, count_by_oracle

_EVERY = 25  # sequences for a line, where there is no terminal


class CampaignDisplay:
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

    def __enter__(self) -> "CampaignDisplay":
        self._progress.start()
        return self

    def __exit__(
        self,
        _type: type[BaseException] | None,
        _error: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        self._progress.stop()

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


def headline(outcomes: Sequence[SequenceOutcome]) -> str:
    """Return what came of a campaign in a sentence."""
    failed = [o for o in outcomes if o.violations]
    lost = sum(bool(o.error) for o in outcomes)
    commands = sum(o.commands for o in outcomes)
    faults = sum(len(o.faults) for o in outcomes)
    text = (
        f"{len(outcomes)} random fault sequences with {faults} faults and {commands:,} commands: "
        f"{sum(len(o.violations) for o in failed)} violations in {len(failed)} sequences"
    )
    unjudged = sum(bool(o.unjudged) for o in outcomes)
    if unjudged:
        text += f"; of {unjudged} in real time not all could be judged, the machine starved"
    return text + (f"; {lost} could not be run" if lost else "")
