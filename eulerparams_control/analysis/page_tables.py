"""The tables of the page: criteria, numbers, parameters."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import Any

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.labels import colour, dash, labels, quantity
from eulerparams_control.analysis.table import MISSING, Row
from eulerparams_control.analysis.verdict import Verdict, groups
from eulerparams_control.messages.keys import REMEDY

_DIGITS = '<button type="button" class="digits" aria-pressed="false">all digits</button>'
_REPORTS = '<p class="note">What the nodes said on /diagnostics, each time that it changed.</p>'
_NO_NODE = ""  # of a parameter in a run without its node
_DASHES = {"solid": "none", "dash": "7 4", "dot": "3 3", "dashdot": "8 3 3 3"}
_LONGEST = 160  # longest parameter shown [characters]: a URDF may be one
_DULL = ("qos_overrides", "robot_description", "start_type_description_service")


def criteria(verdicts: Sequence[Verdict]) -> str:
    """Return each criterion with its verdicts; "" if there are none."""
    if not verdicts:
        return ""
    head = _head(["criterion", "run", "predicted", "measured", "bound", "met"], numbers=(3,))
    body = "".join(_criterion(group.verdicts) for group in groups(verdicts))
    return _with_digits(_table(head, body))


def _criterion(verdicts: Sequence[Verdict]) -> str:
    span = f' rowspan="{len(verdicts)}"'
    lines = []
    for index, verdict in enumerate(verdicts):
        shared = [
            f'<td{span} class="{kind}">{escape(text)}</td>' if index == 0 else ""
            for text, kind in (
                (verdict.text, ""),
                (verdict.predicted or MISSING, ""),
                (verdict.bound, "whole"),
            )
        ]
        measured = escape(quantity(verdict.measured, verdict.unit))
        met = '<td class="yes">✓ yes</td>' if verdict.met else '<td class="no">✗ no</td>'
        cells = (
            f"{shared[0]}<td>{_breakable(verdict.variant)}</td>{shared[1]}"
            f'<td class="number"{_exact(verdict.measured, verdict.unit)}>{measured}</td>'
            f"{shared[2]}{met}"
        )
        lines.append(_row(cells, "group" if index == 0 else ""))
    return "".join(lines)


def numbers(digests: Sequence[Digest], rows: Sequence[Row]) -> str:
    """Return the numbers of each run."""
    head = _run_head("", digests, "number")
    body = "".join(
        _row(f"<th>{escape(row.title)}</th>" + "".join(_number_cells(row))) for row in rows
    )
    return _with_digits(_table(head, body, "named"))


def reports(digests: Sequence[Digest]) -> str:
    """Return what the nodes of each run said, when it changed; "" if nothing was recorded."""
    parts = [
        f'<h3 class="run">{name}</h3>{_reports(digest)}'
        for name, digest in zip(run_names(digests), digests, strict=True)
        if digest.reports
    ]
    return "".join([_REPORTS, *parts]) if parts else ""


def _reports(digest: Digest) -> str:
    head = _head(["time [s]", "node", "state", "message", REMEDY], numbers=(0,))
    body = "".join(
        _row(
            f'<td class="number">{report.t:.3f}</td>'
            f'<td class="node">{escape(report.node)}</td><td class="whole">{report.level}</td>'
            + _cells((report.message, report.remedy), "value"),
            f"said-{report.level}" if report.level in ("ok", "warning") else "said-error",
        )
        for report in digest.reports
    )
    left = digest.reports_left_out
    rest = f'<p class="note">{left} more are left out: a node said very much.</p>' if left else ""
    return _table(head, body, "reports") + rest


def _number_cells(row: Row) -> Iterator[str]:
    """Yield the numbers of a row, with all their digits where they are known."""
    for text, number in zip(row.values, row.numbers, strict=True):
        yield f'<td class="number"{_exact(number)}>{escape(text)}</td>'


def _with_digits(table: str) -> str:
    """Return a table below the button that shows all its digits, if they are known."""
    return (_DIGITS if "data-exact" in table else "") + table


def _exact(value: float | None, unit: str = "") -> str:
    """Return the attribute that holds all digits of a number."""
    if value is None or not math.isfinite(value):
        return ""
    return f' data-exact="{escape(f"{value:.10g} {unit}".rstrip())}"'


def parameters(digests: Sequence[Digest]) -> str:
    """Return the parameters of each run: those that differ first, the others folded.

    Those of a node are compared between the runs that have it.
    """
    found = _parameters(digests)
    known = {name: set(values) - {_NO_NODE} for name, values in found.items()}
    differ = {name: values for name, values in found.items() if len(known[name]) > 1}
    same = {name: list(known[name]) for name in found if len(known[name]) == 1}
    nodes = _nodes(digests)
    if len(set(nodes)) > 1:
        differ = {"nodes": nodes, **differ}
    text = '<p class="note">None differ.</p>' if found else '<p class="note">None recorded.</p>'
    if differ:
        body = "".join(_parameter(name, values, "differs") for name, values in differ.items())
        text = _table(_run_head("they differ in", digests, ""), body, "named")
    if same:
        body = "".join(_parameter(name, values, "") for name, values in same.items())
        common = _table(_head(["parameter", "value"]), body)
        text += f"<details><summary>{len(same)} in which all agree</summary>{common}</details>"
    return text


def _nodes(digests: Sequence[Digest]) -> list[str]:
    """Return the nodes of each run, without those that all runs have."""
    everywhere = set.intersection(*(set(digest.parameters) for digest in digests))
    return [", ".join(sorted(set(r.parameters) - everywhere)) or MISSING for r in digests]


def _parameters(digests: Sequence[Digest]) -> dict[str, list[str]]:
    """Return the value of each parameter in each run as text, by node and name."""
    found = [
        {node: dict(_flat(values)) for node, values in digest.parameters.items()}
        for digest in digests
    ]
    names = {(node, name) for run in found for node, values in run.items() for name in values}
    return {
        f"{node} {name}": [
            _shown(run[node].get(name)) if node in run else _NO_NODE for run in found
        ]
        for node, name in sorted(names, key=str)
    }


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the parameters of a node by their full names, but for those that say nothing."""
    for name, value in values.items():
        if not prefix and name in _DULL:
            continue
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _shown(value: Any) -> str:
    """Return a value of YAML as text of bearable length."""
    if isinstance(value, list):
        return f"[{', '.join(map(_shown, value))}]"
    text = MISSING if value is None else f"{value:.10g}" if isinstance(value, float) else str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ..."


def _parameter(name: str, values: list[str], kind: str) -> str:
    return _row(f"<th>{escape(name)}</th>" + _cells(values, "value"), kind)


def _run_head(first: str, digests: Sequence[Digest], kind: str) -> str:
    """Return a head with a column for each run, in its colour."""
    cells = "".join(f'<th class="{kind}">{name}</th>' for name in run_names(digests))
    return f"<th>{escape(first)}</th>{cells}"


def run_names(digests: Sequence[Digest]) -> list[str]:
    """Return the name of each run with its colour."""
    return [named_key(index, name) for index, name in enumerate(labels(digests))]


def named_key(index: int, name: str) -> str:
    """Return a name of a run with a sample of its line."""
    return f'{key(colour(index), dash(index))}<span class="name">{_breakable(name)}</span>'


def key(shown: str, dashes: str) -> str:
    """Return a sample of a line of this colour and dash."""
    return (
        '<svg class="key" width="24" height="10" aria-hidden="true"><line x1="0" x2="24" y1="5" '
        f'y2="5" stroke="{shown}" stroke-width="3" stroke-dasharray="{_DASHES[dashes]}"/></svg>'
    )


def _breakable(name: str) -> str:
    """Return a name, escaped, that may break after its underscores."""
    return escape(name).replace("_", "_<wbr>")


def _head(names: Sequence[str], numbers: Sequence[int] = ()) -> str:
    return "".join(
        f'<th class="{"number" if index in numbers else ""}">{escape(name)}</th>'
        for index, name in enumerate(names)
    )


def _cells(values: Iterable[str], kind: str) -> str:
    return "".join(f'<td class="{kind}">{escape(value)}</td>' for value in values)


def _row(cells: str, kind: str = "") -> str:
    return f'<tr class="{kind}">{cells}</tr>'


def _table(head: str, body: str, kind: str = "") -> str:
    return (
        f'<div class="scroll"><table class="{kind}"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )
