"""The sentence that a page begins with, its numbers taken from the recordings.

    "{peak_orientation_error.euler_angles} against {peak_orientation_error.euler_parameters}"

``{metric.variant}`` is the metric of that variant, with its unit;
``{metric.variant/other}`` for its ratio to that of another one.  A metric that needs options
has those of a criterion on it.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.labels import labels, number, quantity
from eulerparams_control.analysis.quantities import get_metric, measure, quotient
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import UnknownNameError

Options = Callable[[str, str], Mapping[str, Any]]
"""The options of a metric, by its name and a variant."""

_DESCRIBED = {
    "force": "peak_force",
    "measured_orientation_error": "peak_orientation_error",
    "orientation_error": "peak_orientation_error",
    "joint_speed": "peak_joint_speed",
}
"""The quantities that describe any run, with the metrics of their largest values."""

_MOST_NAMED = 4  # runs; of more the largest and the smallest are shown

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
    """Return a sentence for any runs: their contact force, orientation error, or joint speed.

    Quantities that all runs have come first; beside a command the error is that of the arm itself.
    """
    for has in (all, any):
        for name, metric in _DESCRIBED.items():
            if digests and has(name in digest.highest for digest in digests):
                return f"{get_metric(metric).description}: {_values(name, metric, digests)}."
    return ""


def _values(name: str, metric: str, digests: Sequence[Digest]) -> str:
    """Return the highest values of a quantity with the names of their runs."""
    pairs = [
        (digest.highest[name], label)
        for label, digest in zip(labels(digests), digests, strict=True)
        if name in digest.highest
    ]
    several = len(pairs) > _MOST_NAMED
    pairs = [max(pairs), min(pairs)] if several else pairs
    found = [f"{quantity(value, get_metric(metric).unit)} ({label})" for value, label in pairs]
    return (" to " if several else ", ").join(found)
