"""A soak in numbers: for the table, the page and programs."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Group
from rich.table import Table

from eulerparams_control.lab.soak.record import Life, Page, SoakRecord
from eulerparams_control.lab.soak.verdict import SoakVerdict, growth, longest

_THIN = 600  # samples of memory of a process that are written at most

_SHOWN = 24  # parts of the time that are shown of a controller at most


def sentence(record: SoakRecord, verdicts: Sequence[SoakVerdict]) -> str:
    """Return what came of it in one sentence."""
    failed = [verdict for verdict in verdicts if not verdict.met]
    what = f"{', '.join(record.plan.controllers)} for {record.plan.seconds / 60:g} min"
    if failed:
        return f"{what}: {len(failed)} of {len(verdicts)} criteria are not met"
    return f"{what}: all {len(verdicts)} criteria are met"


def write_summary(path: Path, record: SoakRecord, verdicts: Sequence[SoakVerdict]) -> None:
    """Write all numbers as JSON."""
    content = {
        "sentence": sentence(record, verdicts),
        "met": all(verdict.met for verdict in verdicts),
        "plan": asdict(record.plan),
        "criteria": [asdict(verdict) for verdict in verdicts],
        "latency": {name: [page_numbers(p) for p in pages] for name, pages in record.pages.items()},
        "missed": [_missed(one) for one in record.unanswered],
        "processes": [_life(life) for life in record.lives],
        "events": [asdict(event) for event in record.events],
        "strays": record.strays,
        "clock_steps": record.clock_steps,
        "monitor_gap_s": record.monitor_gap,
        "bag_MB": record.bag_megabytes,
    }
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def page_numbers(page: Page) -> dict[str, float]:
    """Return the rates and latencies of a part of the time; a latency is null if there is none."""
    seconds, found = page.end - page.begin, page.latencies
    times = {
        "p50_ms": found.percentile(50),
        "p99_ms": found.percentile(99),
        "max_ms": found.largest,
    }
    return {
        "begin_s": page.begin,
        "end_s": page.end,
        "states_per_s": page.states / seconds,
        "commands_per_s": page.commands / seconds,
        **{name: 1e3 * value for name, value in times.items() if len(found)},
    }


def causes(record: SoakRecord) -> Counter[str]:
    """Return how many states were not answered for each cause."""
    return Counter(one.cause or "unexplained" for one in record.unanswered)


def cpu_of(life: Life) -> float:
    """Return the part of one core [%] that a process took after the warm-up."""
    later = [sample for sample in life.samples if sample[0] >= 0]
    if len(later) < 2:
        return 0.0
    (begin, first), (end, last) = later[0], later[-1]
    return 100 * (last.cpu - first.cpu) / (end - begin)


def _missed(one: Any) -> dict[str, Any]:
    return {"controller": one.controller, "cause": one.cause, **asdict(one.missed)}


def _life(life: Life) -> dict[str, Any]:
    step = -(-len(life.samples) // _THIN)
    samples = [(t, u.rss, u.uss, u.cpu) for t, u in life.samples[::step]]
    keys = ("t_s", "rss_MiB", "uss_MiB", "cpu_s")
    columns = dict(zip(keys, map(list, zip(*samples, strict=True)), strict=True))
    return {"name": life.name, "pid": life.pid, "cpu_percent": cpu_of(life), **columns}


def tables(record: SoakRecord, verdicts: Sequence[SoakVerdict]) -> Group:
    """Return latency, processes, states without a command, and criteria."""
    return Group(_latency(record), _processes(record), _causes(record), criteria_table(verdicts))


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


def _causes(record: SoakRecord) -> Table:
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
