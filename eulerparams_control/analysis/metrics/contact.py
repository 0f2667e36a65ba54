"""Contact: force and moment at the tip, from wrench.

They are what the environment exerts on the tool, at the origin of the tip.  Options:

``axis``  three numbers: the component along them, with its sign; without it the length.
``frame``  whose axes ``axis`` refers to: ``base``, the default, or ``desired``.
``window``  [s] at the end over which the mean is taken; 0, the default, is the last sample.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from eulerparams_control.analysis.metrics.base import metric, within
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.wrenches import Wrenches
from eulerparams_control.errors import BagError, ConfigurationError, UnknownNameError
from eulerparams_control.laws.rotations import Array

type Axis = Sequence[float]
"""Three numbers, of any length but 0; none at all means no axis."""

FRAMES = ("base", "desired")


def along(vectors: Array, axis: Axis) -> Array:
    """Return the components (...) of vectors (..., 3) along an axis, or without one their lengths.

    Raises:
        ConfigurationError: if the axis is no direction.
    """
    if not len(axis):
        with np.errstate(over="ignore"):  # a run that diverged
            return np.linalg.norm(vectors, axis=-1)
    direction = np.array(axis, dtype=float)
    length = float(np.linalg.norm(direction)) if direction.shape == (3,) else math.nan
    if not 0 < length < math.inf:
        raise ConfigurationError(f"axis is {list(axis)}; expected three numbers, not all 0")
    return vectors @ (direction / length)


def known(t: Array, vectors: Array, after: float, before: float) -> tuple[Array, Array]:
    """Return instants and vectors (N, 3) of a window that are known; raises BagError if none is."""
    inside = within(t, after, before) & np.isfinite(vectors).all(axis=1)
    if not inside.any():
        raise BagError("no desired frame was recorded: nothing to compare the motion with")
    return t[inside], vectors[inside]


def mean_at_end(t: Array, vectors: Array, window: float, before: float) -> Array:
    """Return the mean (3,) of known vectors (N, 3) over the last ``window`` [s].

    The end is the last known one that is not after ``before``; a window of 0 is that alone.
    """
    t, vectors = known(t, vectors, 0.0, before)
    mean: Array = vectors[t >= t[-1] - window * (1 + 1e-9)].mean(axis=0)
    return mean


def contact(recording: Recording) -> Wrenches:
    """Return the wrench at the tip; raises BagError if there is none."""
    if recording.wrench is None:
        raise BagError(f"{recording.path}: {recording.why_no_wrench}")
    return recording.wrench


def desired_rotations(recording: Recording, t: Array) -> Array:
    """Return R_d (N, 3, 3) at instants t (N,) [s], the last before each; NaN where is none."""
    measured = recording.measured
    before = np.searchsorted(measured.t, t, side="right") - 1
    return measured.desired.take(before).R


def force(recording: Recording, frame: str = "base") -> tuple[Array, Array]:
    """Return instants (N,) [s] and f (N, 3) [N] in the axes of a frame."""
    wrench = contact(recording)
    return wrench.t, _in_frame(recording, wrench.t, wrench.f, frame)


def moment(recording: Recording, frame: str = "base") -> tuple[Array, Array]:
    """Return instants (N,) [s] and mu (N, 3) [Nm] in the axes of a frame."""
    wrench = contact(recording)
    return wrench.t, _in_frame(recording, wrench.t, wrench.mu, frame)


def _in_frame(recording: Recording, t: Array, vectors: Array, frame: str) -> Array:
    if frame not in FRAMES:
        raise UnknownNameError("frame", frame, FRAMES)
    if frame == "base":
        return vectors
    turned: Array = np.einsum("nji,nj->ni", desired_rotations(recording, t), vectors)  # R_d' v
    return turned


def _family(name: str, unit: str, of: Callable[[Recording, str], tuple[Array, Array]]) -> None:
    """Register the metrics that force and moment have in common."""

    @metric(unit, name=f"final_{name}", text=f"Contact {name} at the end")
    def _final(
        recording: Recording,
        axis: Axis = (),
        frame: str = "base",
        window: float = 0.0,
        before: float = math.inf,
    ) -> float:
        return float(along(mean_at_end(*of(recording, frame), window, before), axis))

    @metric(unit, name=f"peak_{name}", text=f"Largest contact {name}")
    def _peak(
        recording: Recording,
        axis: Axis = (),
        frame: str = "base",
        after: float = 0.0,
        before: float = math.inf,
    ) -> float:
        _, vectors = known(*of(recording, frame), after, before)
        return float(np.abs(along(vectors, axis)).max())


_family("force", "N", force)
_family("moment", "Nm", moment)


@metric("N")
def least_force(
    recording: Recording,
    axis: Axis = (),
    frame: str = "base",
    after: float = 0.0,
    before: float = math.inf,
) -> float:
    """Smallest contact force.

    Near 0 where the contact was lost.
    """
    _, f = known(*force(recording, frame), after, before)
    return float(along(f, axis).min())


@metric("N")
def force_ripple(recording: Recording, window: float, axis: Axis = ()) -> float:
    """Largest less smallest contact force over the last seconds.

    Of the component along an axis, else of that base component of which it is largest: chatter
    shows even where the length of the force stays.
    """
    t, f = force(recording)
    last = f[within(t, float(t[-1]) - window, math.inf)]
    components = along(last, axis)[:, None] if len(axis) else last
    return float(np.ptp(components, axis=0).max())
