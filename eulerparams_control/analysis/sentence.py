"""The sentence that a page begins with, its numbers taken from the recordings.

    "{peak_orientation_error.euler_angles} against {peak_orientation_error.euler_parameters}"

``{metric.variant}`` stands for the metric of that variant, with its unit;
``{metric.variant/other}`` for its ratio to that of another one.  A metric that needs options
has those of a criterion on it.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.labels import labels
from eulerparams_control.analysis.metrics import get_metric, measure, quotient
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.text import number, quantity
from eulerparams_control.errors import UnknownNameError

Options = Callable[[str, str], Mapping[str, Any]]
"""The options of a metric, by its name and a variant."""

_DESCRIBED = {"orientation_error": "peak_orientation_error", "joint_speed": "peak_joint_speed"}
"""The quantities that describe any run, with the metrics of their largest values."""

_MOST_NAMED = 4  # runs; of more the largest and the smallest stand for all

_NUMBER = re.compile(r"\{(\w+)\.(\w+)(?:/(\w+))?\}")


def placeholders(text: str) -> list[tuple[str, str, str]]:
    """Return metric, variant and the variant it is divided by ("" if none) of each number."""
    return _NUMBER.findall(text)


def _no_options(_metric: str, _variant: str) -> Mapping[str, Any]:
    return {}


def fill(text: str, recordings: Mapping[str, Recording], options: Options = _no_options) -> str:
    """Return the text with its numbers.

    Args:
        text: with placeholders.
        recordings: by variant.
        options: of the metrics.

    Raises:
        UnknownNameError: if there is no such metric or variant; lists those that exist.
    """

    def measured(metric: str, variant: str) -> float:
        if variant not in recordings:
            raise UnknownNameError("variant", variant, recordings)
        return measure(metric, recordings[variant], **options(metric, variant))

    def value(match: re.Match[str]) -> str:
        metric, variant, other = match.groups()
        if other:
            return number(quotient(measured(metric, variant), measured(metric, other)))
        return quantity(measured(metric, variant), get_metric(metric).unit)

    return _NUMBER.sub(value, text)


def describe(digests: Sequence[Digest]) -> str:
    """Return a sentence for any runs: their largest orientation error, else joint speed."""
    names = labels(digests)
    for name, metric in _DESCRIBED.items():
        pairs = [
            (d.highest[name], label)
            for label, d in zip(names, digests, strict=True)
            if name in d.highest
        ]
        if len(pairs) > _MOST_NAMED:
            pairs = [max(pairs), min(pairs)]
        unit = get_metric(metric).unit
        found = [f"{quantity(value, unit)} ({label})" for value, label in pairs]
        if found:
            text = " to ".join(found) if len(digests) > _MOST_NAMED else ", ".join(found)
            return f"{get_metric(metric).description}: {text}."
    return ""
