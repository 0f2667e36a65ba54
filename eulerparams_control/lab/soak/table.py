"""A soak in the terminal."""

from collections.abc import Sequence

from rich.console import Group
from rich.table import Table

from eulerparams_control.lab.soak.record import SoakRecord
from eulerparams_control.lab.soak.summary import causes, cpu_of, page_numbers
from eulerparams_control.lab.soak.verdict import SoakVerdict, growth, longest

_SHOWN = 24  # parts of the time that are shown of a controller at most


def tables(record: SoakRecord, verdicts: Sequence[SoakVerdict]) -> Group:
    """Return latency, processes, states without a command, and criteria."""
    return Group(_latency(record), _processes(record), _missed(record), criteria_table(verdicts))


def _latency(record: SoakRecord) -> Table:
    table = Table(title="Round trip from joint_states to command")
    for name in ("controller", "minutes", "states/s", "commands/s", "p50 ms", "p99 ms", "max ms"):
        table.add_column(name, justify="left" if name == "controller" else "right")
    for controller, pages in record.pages.items():
        for page in pages[:: -(-len(pages) // _SHOWN)]:
            found = page_numbers(page)
            times = [f"{found.get(name, float('nan')):.2f}" for name in _TIMES]
            when = f"{page.begin / 60:.1f} ... {page.end / 60:.1f}"
            rates = [f"{found[name]:.1f}" for name in ("states_per_s", "commands_per_s")]
            table.add_row(controller, when, *rates, *times)
    return table


_TIMES = ("p50_ms", "p99_ms", "max_ms")


def _processes(record: SoakRecord) -> Table:
    table = Table(title="Processes")
    for name in ("node", "RSS MiB", "USS MiB", "growth %", "CPU %"):
        table.add_column(name, justify="left" if name == "node" else "right")
    for life in longest(record):
        last, grown = life.samples[-1][1], growth(life, record.plan.warm_up)
        numbers = (f"{last.rss:.1f}", f"{last.uss:.1f}", f"{100 * grown:+.2f}")
        table.add_row(life.name, *numbers, f"{cpu_of(life):.1f}")
    return table


def _missed(record: SoakRecord) -> Table:
    table = Table(title="States without a command")
    table.add_column("why")
    table.add_column("states", justify="right")
    for cause, count in causes(record).most_common():
        table.add_row(cause, str(count))
    if not record.unanswered:
        table.add_row("there are none", "0")
    return table


def criteria_table(verdicts: Sequence[SoakVerdict]) -> Table:
    """Return the criteria with what was measured."""
    table = Table(title="What must hold")
    for name in ("criterion", "of", "measured", "bound", ""):
        table.add_column(name)
    for v in verdicts:
        mark = "[green]met[/]" if v.met else "[red]not met[/]"
        table.add_row(v.text, v.of, v.measured, v.bound, mark)
    return table
