"""Definition and registry of metrics, and their shared functions."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.series import Series
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.laws.rotations import Array


class Metric(NamedTuple):
    """A number of a run.

    Attributes:
        compute: from a recording.
        unit: of the number; "" if it has none.
        description: in words.
        raw: whether it reads the bag itself, whatever part of the run is in memory.
    """

    compute: Callable[..., float]
    unit: str
    description: str
    raw: bool = False


METRICS: dict[str, Metric] = {}


def metric(
    unit: str, raw: bool = False, *, name: str = "", text: str = ""
) -> Callable[[Callable[..., float]], Callable[..., float]]:
    """Register a function as a metric; its name and its first doc line are those of the metric.

    Args:
        unit: of the number.
        raw: see :class:`Metric`.
        name, text: instead, of a function that is one of a family.
    """

    def register(function: Callable[..., float]) -> Callable[..., float]:
        description = text or (function.__doc__ or "").split("\n")[0].rstrip(".")
        quiet = np.errstate(over="ignore", invalid="ignore")  # of a run that diverged
        METRICS[name or function.__name__] = Metric(quiet(function), unit, description, raw)
        return function

    return register


def get_metric(name: str) -> Metric:
    """Return the metric of that name; raises UnknownNameError."""
    if name not in METRICS:
        raise UnknownNameError("metric", name, METRICS)
    return METRICS[name]


def measure(name: str, recording: Recording, **options: Any) -> float:
    """Return a number of a run; infinite where a run had diverged before it could have one.

    Raises:
        UnknownNameError: if there is no such metric.
        BagError: if what it needs was not recorded.
    """
    try:
        return get_metric(name).compute(recording, **options)
    except BagError:
        if recording.diverged is None:
            raise
        return math.inf


def quotient(numerator: float, denominator: float) -> float:
    """Return the quotient; infinite, or NaN for 0 / 0, where the denominator is 0."""
    if denominator == 0:
        return math.nan if numerator == 0 else math.copysign(math.inf, numerator)
    return numerator / denominator


def series_of(recording: Recording, of: str) -> Series:
    """Return the ``command``, the ``measured`` motion or the ``leading`` of them.

    Raises:
        UnknownNameError: if ``of`` is none of these.
        BagError: if there is no command.
    """
    if of not in ("command", "measured", "leading"):
        raise UnknownNameError("series", of, ("command", "measured", "leading"))
    if of == "measured":
        return recording.measured
    if of == "leading":
        return recording.leading
    if recording.command is None:
        raise BagError(f"{recording.path} has no joint_reference")
    return recording.command


def within(t: Array, after: float, before: float) -> NDArray[np.bool_]:
    """Return which instants t (N,) [s] are in a window; raises BagError if none is."""
    inside: NDArray[np.bool_] = (t >= after) & (t <= before)
    if not inside.any():
        raise BagError(f"no sample from {after:g} to {before:g} s; the last is at {t[-1]:g} s")
    return inside
