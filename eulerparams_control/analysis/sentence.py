"""The sentence that a page begins with, its numbers taken from the recordings.

    "{peak_orientation_error.euler_angles} against {peak_orientation_error.euler_parameters}"

``{metric.variant}`` stands for the metric of that variant, with its unit;
``{metric.variant/other}`` for its ratio to that of another one.
"""

import re
from collections.abc import Mapping, Sequence

from eulerparams_control.analysis.labels import labels
from eulerparams_control.analysis.metrics import get_metric
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.text import number, quantity
from eulerparams_control.errors import BagError, UnknownNameError

_NUMBER = re.compile(r"\{(\w+)\.(\w+)(?:/(\w+))?\}")


def placeholders(text: str) -> list[tuple[str, str, str]]:
    """Return metric, variant and the variant it is divided by ("" if none) of each number."""
    return _NUMBER.findall(text)


def fill(text: str, recordings: Mapping[str, Recording]) -> str:
    """Return the text with its numbers.

    Args:
        text: with placeholders.
        recordings: by variant.

    Raises:
        UnknownNameError: if there is no such metric or variant; lists those that exist.
    """

    def measure(metric: str, variant: str) -> float:
        if variant not in recordings:
            raise UnknownNameError("variant", variant, recordings)
        return get_metric(metric).compute(recordings[variant])

    def value(match: re.Match[str]) -> str:
        metric, variant, other = match.groups()
        measured = measure(metric, variant)
        if other:
            return number(measured / measure(metric, other))
        return quantity(measured, get_metric(metric).unit)

    return _NUMBER.sub(value, text)


def describe(recordings: Sequence[Recording]) -> str:
    """Return a sentence for any runs: their largest orientation error, else joint speed."""
    names = labels(recordings)
    for metric in ("peak_orientation_error", "peak_joint_speed"):
        found = [
            f"{text} ({name})"
            for name, recording in zip(names, recordings, strict=True)
            if (text := _leading(metric, recording))
        ]
        if found:
            return f"{get_metric(metric).description}: {', '.join(found)}."
    return ""


def _leading(metric: str, recording: Recording) -> str:
    """Return a metric of the command, else of the measured motion; "" if it has none."""
    try:
        measured = get_metric(metric).compute(recording, of="leading")
        return quantity(measured, get_metric(metric).unit)
    except BagError:
        return ""
