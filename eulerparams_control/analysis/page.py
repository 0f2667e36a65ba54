"""The page of runs: plots laid over each other, a replay, criteria, numbers, parameters."""

from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Any

from eulerparams_control.analysis.charts import panels, picture, time_range
from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.headline import describe
from eulerparams_control.analysis.html import MISSING, write_html
from eulerparams_control.analysis.interactive import figures
from eulerparams_control.analysis.labels import PREDICTION_DASHES, labels
from eulerparams_control.analysis.quantities.base import Prediction
from eulerparams_control.analysis.replay import ARROW, replay
from eulerparams_control.analysis.table import rows
from eulerparams_control.analysis.verdict import Verdict
from eulerparams_control.messages.keys import REMEDY

_OPEN = 3  # groups of plots that are open at first
_HEAD, _TAIL = 8, 22  # characters that a button shows of a long name
_LONGEST = 160  # longest parameter shown [characters]: a URDF may be one
_NO_NODE = ""  # of a parameter in a run without its node
_DULL = ("qos_overrides", "robot_description", "start_type_description_service")


def write_page(
    path: str | PathLike[str],
    digests: Sequence[Digest],
    claim: str,
    sentence: str,
    verdicts: Sequence[Verdict] = (),
    first: str = "orientation_error",
    predictions: Sequence[Prediction] = (),
) -> None:
    """Write the page of some runs.

    Args:
        path: of the HTML file; its folder is made.
        digests: the runs, at least one.
        claim: what they are to show; "" if nothing.
        sentence: what they show, with numbers; "" describes them.
        verdicts: on the criteria; () if there are none.
        first: name of the quantity whose picture matters most.
        predictions: of theory, drawn dashed in the plots of their quantities.

    Raises:
        UnknownNameError: if there is no such quantity.
        ConfigurationError: if the file cannot be written.
    """
    drawn = panels(digests, picture(first), predictions)
    replayed = replay(digests)
    differ, same = _compared(digests)
    titles = ["Criteria"] if verdicts else []
    titles += [*drawn.groups]
    titles += ["Reports"] if any(digest.reports for digest in digests) else []
    write_html(
        path,
        "report.html",
        sentence=sentence or describe(digests),
        claim=" ".join(claim.split()),
        verdicts=verdicts,
        digests=digests,
        runs=list(zip(labels(digests), digests, strict=True)),
        short=_short,
        titles=[*titles, "Numbers", "Parameters"],
        closed=[*list(drawn.groups)[_OPEN:], "Reports"],
        first=drawn.first,
        groups=drawn.groups,
        dashes=PREDICTION_DASHES,
        figures=figures(drawn.charts),
        replay=replayed._replace(data={**replayed.data, "range": time_range(digests)}),
        arrow=ARROW,
        remedy=REMEDY,
        rows=rows(digests),
        differ=differ,
        same=same,
    )


def _short(name: str) -> str:
    """Return a name of bearable length: names that share a beginning differ in their end."""
    return name if len(name) <= _HEAD + _TAIL + 1 else f"{name[:_HEAD]}…{name[-_TAIL:]}"


def _compared(digests: Sequence[Digest]) -> tuple[dict[str, list[str]], dict[str, list[str]]]:
    """Return the parameters in which runs differ, a value a run, and those in which they agree.

    Those of a node are compared between the runs that have it.
    """
    found = _parameters(digests)
    known = {name: set(values) - {_NO_NODE} for name, values in found.items()}
    differ = {name: values for name, values in found.items() if len(known[name]) > 1}
    same = {name: list(known[name]) for name in found if len(known[name]) == 1}
    everywhere = set.intersection(*(set(digest.parameters) for digest in digests))
    nodes = [", ".join(sorted(set(r.parameters) - everywhere)) or MISSING for r in digests]
    return {"nodes": nodes, **differ} if len(set(nodes)) > 1 else differ, same


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
