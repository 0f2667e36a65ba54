"""Stability: what the Lyapunov function does, how fast an error grows, whether a run diverged."""

import math

import numpy as np

from eulerparams_control.analysis.quantities.base import (
    Samples,
    drawn,
    known,
    metric,
    needed,
    quotient,
    row,
)
from eulerparams_control.analysis.quantities.errors import orientation_error
from eulerparams_control.analysis.recording import LyapunovSeries, Recording
from eulerparams_control.errors import BagError
from eulerparams_control.laws.rotations import Array


@metric("")
def lyapunov_start(recording: Recording) -> float:
    """V at the start."""
    return float(needed(recording, "lyapunov").V[0])


@metric("")
def lyapunov_increase(recording: Recording) -> float:
    """Largest rise of V above its lowest value before, over V at the start.

    0 if V never increases, as (31), (43) say.
    """
    V = needed(recording, "lyapunov").V
    with np.errstate(invalid="ignore"):  # a run that diverged
        rise = float(np.nanmax(V - np.minimum.accumulate(V)))
    return quotient(rise, float(V[0]))


@metric("")
def energy_balance(recording: Recording) -> float:
    """Decrease of V by the paper over its measured decrease.

    The integral of -dV of (31), (43) by the trapezoidal rule over V at the start minus V at
    the end: 1 if the closed loop is that of the paper.
    """
    t, V, dV, _ = needed(recording, "lyapunov")
    with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
        decrease = float(-((dV[1:] + dV[:-1]) / 2 * np.diff(t)).sum())
        return quotient(decrease, float(V[0] - V[-1]))


@metric("1/s")
def growth_rate(recording: Recording, low: float, high: float, of: str = "leading") -> float:
    """Rate at which the orientation error grows.

    Where it first passes from ``low`` to ``high`` [deg].
    """
    t, angle = known(*orientation_error(recording, of), 0.0, math.inf)
    try:
        return growth(t, angle, low, high)
    except BagError as error:
        raise BagError(f"{recording.path}: the orientation error {error}") from error


def growth(t: Array, angle: Array, low: float, high: float) -> float:
    """Return the rate [1/s] at which an angle (N,) grows where it first passes a range.

    The slope of its logarithm by least squares.  ``low`` and ``high`` are in its unit.

    Raises:
        BagError: if it has fewer than two samples on a way from one to the other.
    """
    below, above = np.flatnonzero(angle <= low), np.flatnonzero(angle >= high)
    ends = above[above > below[0]] if len(below) else below
    passing = slice(below[below < ends[0]][-1] + 1, ends[0]) if len(ends) else slice(0, 0)
    if len(t[passing]) < 2:
        raise BagError(f"has fewer than two samples on a way from {low:g} to {high:g} deg")
    return float(np.polyfit(t[passing], np.log(angle[passing]), 1)[0])


@metric("s")
def divergence_time(recording: Recording) -> float:
    """Time at which the run diverged.

    Infinite if it did not.
    """
    return math.inf if recording.diverged is None else recording.diverged


@drawn(
    12, "Lyapunov function", "V",
    "V_1 of (30) in kinematic control, V_2 of (42) in dynamic control, with the sign that the "
    "controller gave the mutual quaternion, V_3 of (68) of the impedance; of Euler parameters "
    "only. By (31), (43), (69) it never increases from an error on without a contact moment; what "
    "sampling, noise and limits leave of one while moving comes on top.",
    floor=1e-16, logarithmic=True,
)  # fmt: skip
def lyapunov(recording: Recording) -> Samples:
    """Return V of the controller that ran."""
    found: LyapunovSeries = needed(recording, "lyapunov")
    return found.t, found.V


@drawn(
    23, "Rate of the Lyapunov function", "dV",
    "Derivative of V: by the paper, (31), (43) or (69), and as it was measured, by differences "
    "of V. They agree where the closed loop is that of the paper. V_1 has no unit, V_2 is in "
    "1/s^2, V_3 in J.",
    floor=1e-9, components=("by the paper", "as measured"), group="Lyapunov function",
)  # fmt: skip
def lyapunov_rate(recording: Recording) -> Samples:
    """Return the derivative of V (N, 2), by the paper and as measured."""
    found: LyapunovSeries = needed(recording, "lyapunov")
    return found.t, np.column_stack([found.dV, found.dV_measured])


row(1, "diverged at", "divergence_time", "diverged")
