"""Quantities and numbers of a run: the registry of metrics, and reductions of a quantity to one.

A quantity is a function of a Recording, with options, that returns instants t (N,) [s] and values
(N,) or (N, m); NaN where there is none.  What was not recorded raises BagError.  :func:`drawn`
gives it a plot, :func:`reduced` makes numbers of it, on which an experiment can put a criterion,
and :func:`row` puts one of them into the table.
"""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.controllers import recorded
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.series import Series
from eulerparams_control.errors import BagError, ConfigurationError, UnknownNameError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.robot.robot import Robot

XYZ: tuple[str, ...] = ("x", "y", "z")
"""The components of a vector."""

JOINTS: tuple[str, ...] = ("each joint",)
"""In place of components: one for each joint of the arm."""

type Axis = Sequence[float]
"""Three numbers, not all 0; empty: no axis."""

type Samples = tuple[Array, Array]
"""Instants (N,) [s] and values."""


@dataclass(frozen=True)
class Quantity:
    """A quantity of a run over time: values (N,), or (N, m) of components or joints.

    Attributes:
        name: by which an experiment can name it.
        title: of the plot.
        label: of its axis, with the unit; {sequence} stands for the Euler angles.
        caption: what it means, and the equation it belongs to.
        unit: for single values.
        floor: values below are rounding, not motion; 0 never makes the axis logarithmic.
        of: returns instants (N,) [s] and values; raises BagError if it was not recorded.
        limits: returns (n,) limits of the URDF to draw; None if there are none.
        components: the names of the m components, or ``JOINTS``; () is one line.
        group: its heading in the page.
        logarithmic: whether the axis is logarithmic in any case.
        beside: the name of the quantity with which it is drawn, dashed; "" if by itself.
        otherwise: the name of what is drawn of a run without it, beside one with it; "" if nothing.
    """

    name: str
    title: str
    label: str
    caption: str
    unit: str
    floor: float
    of: Callable[..., Samples]
    limits: Callable[[Robot], Array] | None = None
    components: tuple[str, ...] = ()
    group: str = "Over time"
    logarithmic: bool = False
    beside: str = ""
    otherwise: str = ""

    @property
    def is_of_joints(self) -> bool:
        """Whether its components are joints."""
        return self.components is JOINTS

    @property
    def is_vector(self) -> bool:
        """Whether its components are others."""
        return bool(self.components) and not self.is_of_joints

    def samples(self, recording: Recording) -> Samples:
        """Return instants (N,) [s] and values; both empty if it was not recorded."""
        try:
            return self.of(recording)
        except BagError:
            return np.zeros(0), np.zeros(0)


class Prediction(NamedTuple):
    """Prediction of theory for a quantity, drawn dashed.

    Attributes:
        quantity: its name.
        text: what it is, with its equation.
        t: (M,) [s] instants.
        y: (M,) values in the unit of the quantity.
        name: of the line.
    """

    quantity: str
    text: str
    t: Array
    y: Array
    name: str = "predicted"


class Metric(NamedTuple):
    """A number of a run.

    Attributes:
        compute: from a recording.
        unit: of the number; "" if it has none.
        description: in words.
    """

    compute: Callable[..., float]
    unit: str
    description: str


class TableNumber(NamedTuple):
    """A row of the table.

    ``needs`` names the attribute of the recording that it needs, "" if none.
    """

    title: str
    metric: str
    needs: str = ""
    options: Mapping[str, str] = MappingProxyType({})


PLOTS: dict[float, Quantity] = {}
"""By their places on the page."""

ROWS: dict[float, TableNumber] = {}
"""By their places in the table."""

METRICS: dict[str, Metric] = {}


def _put[T](places: dict[float, T], place: float, what: T) -> None:
    if place in places:
        raise ValueError(f"{what}: place {place:g} is that of {places[place]}")
    places[place] = what


def drawn(
    place: float,
    title: str,
    label: str,
    caption: str,
    unit: str = "",
    floor: float = 0.0,
    *,
    name: str = "",
    **look: Any,
) -> Callable[[Callable[..., Samples]], Callable[..., Samples]]:
    """Register a quantity to be drawn.

    Args:
        place: on the page.
        title, label, caption, unit, floor: see :class:`Quantity`.
        name: instead of that of the function.
        look: the other fields of :class:`Quantity`.
    """

    def register(of: Callable[..., Samples]) -> Callable[..., Samples]:
        called = name or of.__name__
        _put(PLOTS, place, Quantity(called, title, label, caption, unit, floor, of, **look))
        return of

    return register


def row(place: float, title: str, metric: str, needs: str = "", **options: str) -> None:
    """Register a row of the table: see :class:`TableNumber`."""
    _put(ROWS, place, TableNumber(title, metric, needs, options))


def metric(
    unit: str, *, name: str = "", text: str = ""
) -> Callable[[Callable[..., float]], Callable[..., float]]:
    """Register a function as a metric; its name and its first doc line are those of the metric.

    Args:
        unit: of the number.
        name, text: instead, of a function that has none.
    """

    def register(function: Callable[..., float]) -> Callable[..., float]:
        description = text or (function.__doc__ or "").split("\n")[0].rstrip(".")
        quiet = np.errstate(over="ignore", invalid="ignore")  # of a run that diverged
        if (called := name or function.__name__) in METRICS:
            raise ValueError(f"there is a metric {called} already")
        METRICS[called] = Metric(quiet(function), unit, description)
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


def reduced(
    names: str | Mapping[str, str], unit: str, words: str, *takes: str, vectors: bool = False
) -> Callable[[Callable[..., Samples]], Callable[..., Samples]]:
    """Register reductions of a quantity as metrics, such as ``peak_force``.

    They take the options of the quantity, and their own.

    Args:
        names: of the quantity, before which the reduction is put; or of each reduction.
        unit: of the numbers.
        words: the quantity in words.
        takes: names of reductions, if ``names`` is that of the quantity.
        vectors: whether it has three components; their length is taken, or one along an ``axis``.
    """
    named = {take: f"{take}_{names}" for take in takes} if isinstance(names, str) else names

    def register(samples: Callable[..., Samples]) -> Callable[..., Samples]:
        for take, name in named.items():
            text, reduction = _REDUCTIONS[take]
            said = text.format(words)
            said = said[0].upper() + said[1:]
            metric(unit, name=name, text=said)(_number(samples, reduction, vectors))
        return samples

    return register


def _number(
    samples: Callable[..., Samples], reduction: Callable[..., float], vectors: bool
) -> Callable[..., float]:
    """Return a reduction of samples, with the options of both as its signature."""
    _, *given = inspect.signature(samples).parameters.values()
    own = dict(list(inspect.signature(reduction).parameters.items())[2 if vectors else 3 :])

    def number(recording: Recording, **options: Any) -> float:
        chosen = {name: options.pop(name) for name in own.keys() & options}
        return reduction(*samples(recording, **options), **chosen)

    run = inspect.Parameter("recording", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    number.__signature__ = inspect.Signature([run, *given, *own.values()])  # type: ignore[attr-defined]
    return number


def _over(of: Callable[[Array], float]) -> Callable[..., float]:
    """Return a reduction of what is known in a window."""

    def reduction(
        t: Array, y: Array, axis: Axis = (), after: float = 0.0, before: float = math.inf
    ) -> float:
        return float(of(_scalars(known(t, y, after, before)[1], axis)))

    return reduction


def _final(
    t: Array, y: Array, axis: Axis = (), window: float = 0.0, before: float = math.inf
) -> float:
    return float(_scalars(mean_at_end(t, y, window, before)[None], axis)[0])


def _scalars(y: Array, axis: Axis) -> Array:
    """Return values (N,), or of vectors (N, 3) the components along an axis, or their lengths."""
    return along(y, axis) if y.ndim > 1 else y


_REDUCTIONS: Mapping[str, tuple[str, Callable[..., float]]] = {
    "peak": ("largest {}", _over(lambda y: np.abs(y).max())),
    "least": ("smallest {}", _over(np.min)),
    "rms": ("root mean square of the {}", _over(lambda y: math.sqrt(np.mean(y**2)))),
    "final": ("{} at the end", _final),
}


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
    command: Series = needed(recording, "command")
    return command


_TOPICS = {
    **{"command": "joint_reference", "effort": "joint_effort"},
    **{"compliant": "compliant_frame", "impedance": "compliant_frame", "acting": "~/impedance"},
}


def needed(recording: Recording, name: str) -> Any:
    """Return an attribute of a recording; raises BagError that says why there is none."""
    value = getattr(recording, name)
    if value is None and name in _TOPICS:
        raise BagError(f"{recording.path} has no {_TOPICS[name]}")
    if value is None:
        raise BagError(f"{recording.path}: {getattr(recording, f'why_no_{name}')}")
    return value


def controller_parameters[P: ControlParameters](recording: Recording, kind: type[P]) -> P:
    """Return the parameters of the controller; raises BagError if none of that kind ran."""
    found = recorded(recording.parameters, kind)
    if found is None:
        name = kind.scheme.name
        raise BagError(f"{recording.path}: no parameters of {name} were recorded")
    return found


def within(t: Array, after: float, before: float) -> NDArray[np.bool_]:
    """Return which instants t (N,) [s] are in a window; raises BagError if none is."""
    inside: NDArray[np.bool_] = (t >= after) & (t <= before)
    if not inside.any():
        last = f"the last is at {t[-1]:g} s" if len(t) else "there is none at all"
        raise BagError(f"no sample from {after:g} to {before:g} s; {last}")
    return inside


def compared(t: Array, y: Array) -> Samples:
    """Return samples of an error; raises BagError if nothing was desired."""
    if np.isnan(y).all():
        raise BagError("no desired frame was recorded: nothing to compare the motion with")
    return t, y


def known(t: Array, y: Array, after: float, before: float) -> Samples:
    """Return what is known in a window of samples (N,) or (N, m); raises BagError if nothing is."""
    inside = within(t, after, before) & ~np.isnan(y.reshape(len(t), -1)).any(axis=1)
    if not inside.any():
        raise BagError(f"no value from {after:g} to {before:g} s")
    return t[inside], y[inside]


def mean_at_end(t: Array, y: Array, window: float, before: float) -> Array:
    """Return the mean of known samples (N,) or (N, m) over the last ``window`` [s].

    The end is the last known one that is not after ``before``; a window of 0 is that alone.
    """
    t, y = known(t, y, 0.0, before)
    mean: Array = y[t >= t[-1] - window * (1 + 1e-9)].mean(axis=0)
    return mean


def along(values: Array, axis: Axis) -> Array:
    """Return the components (...) of vectors (..., 3) along an axis, or without one their lengths.

    Raises:
        ConfigurationError: if the axis is no direction.
    """
    if not len(axis):
        with np.errstate(over="ignore"):  # a run that diverged
            return np.linalg.norm(values, axis=-1)
    direction = np.array(axis, dtype=float)
    length = float(np.linalg.norm(direction)) if direction.shape == (3,) else math.nan
    if not 0 < length < math.inf:
        raise ConfigurationError(f"axis is {list(axis)}; expected three numbers, not all 0")
    return values @ (direction / length)
