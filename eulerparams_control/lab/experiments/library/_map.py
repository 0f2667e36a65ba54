"""Maps: a function of a cell, many cells over the direction of the tool axis, and their picture.

A module ``map_NAME`` has its cells, ``MAP``, the function ``simulate`` and, of all its outcomes,
the numbers and the picture, ``result``.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property, partial

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.random import Generator, default_rng

from eulerparams_control.analysis.static import STYLE
from eulerparams_control.lab.experiments.library import Number
from eulerparams_control.laws.orientation import (
    EulerSequence,
    OrientationOptions,
    OrientationRepresentation,
    representation,
)
from eulerparams_control.laws.rotations import Array, cross, exp

_CENTRE = math.radians(60)  # longitude in the middle: +x left of it, -x right, both inside


@dataclass(frozen=True)
class Column:
    """A representation, with the label of its column in the picture, and its Euler angles."""

    key: str
    label: str
    orientation: str
    sequence: str = "XYZ"

    @cached_property
    def representation(self) -> OrientationRepresentation:
        """The representation."""
        sequence = EulerSequence(self.sequence)
        return representation(self.orientation, OrientationOptions(sequence=sequence))


COLUMNS = (
    Column("xyz", "Euler angles XYZ", "euler_angles"),
    Column("zyz", "Euler angles ZYZ", "euler_angles", "ZYZ"),
    Column("relative", "relative XYZ", "relative_euler_angles"),
    Column("angle_axis", "angle/axis", "angle_axis"),
    Column("vector", "rotation vector", "rotation_vector"),
    Column("parameters", "Euler parameters", "euler_parameters"),
)

type Outcome = Mapping[str, float]
type Simulate = Callable[[Column, float, Array, Generator], Outcome]
"""Gives the outcomes of a cell: of a representation, a task, R (3, 3) and random numbers."""


@dataclass(frozen=True)
class Map:
    """The cells of a map: tasks x columns x directions x trials.

    Attributes:
        columns: the representations.
        directions: of the tool axis, evenly over the sphere; the roll about it is random.
        seed: of the random numbers, the same for all columns and tasks.
        trials: at each direction.
        tasks: numbers that ``simulate`` gets.
    """

    columns: Sequence[Column]
    directions: int
    seed: int
    trials: int = 1
    tasks: Sequence[float] = (0.0,)

    @property
    def tool_axes(self) -> Array:
        """The directions (N, 3): Fibonacci's lattice."""
        index = np.arange(self.directions)
        z = 1 - (2 * index + 1) / self.directions
        r, phi = np.sqrt(1 - z**2), math.pi * (3 - math.sqrt(5)) * index
        return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)

    def sweep(self, simulate: Simulate, pool: Executor | None = None) -> dict[str, Array]:
        """Return outcomes (tasks, columns, directions, trials), simulated in a pool or here."""
        shape = len(self.tasks), len(self.columns), self.directions, self.trials
        batches = list(itertools.batched(np.ndindex(*shape), 50))
        found = (pool.map if pool else map)(partial(self._outcomes, simulate), batches)
        rows = [row for batch in found for row in batch]
        return {name: np.array([row[name] for row in rows]).reshape(shape) for name in rows[0]}

    def _outcomes(self, simulate: Simulate, cells: Iterable[Sequence[int]]) -> list[Outcome]:
        axes = self.tool_axes
        rows: list[Outcome] = []
        for task, column, direction, trial in cells:
            random = default_rng([self.seed, direction * self.trials + trial])
            R = _with_tool_axis(axes[direction], random.uniform(-math.pi, math.pi))
            rows.append(simulate(self.columns[column], self.tasks[task], R, random))
        return rows

    def numbers(self, name: str, values: Array, text: str, unit: str = "") -> dict[str, Number]:
        """Return a number of each column, ``KEY_NAME``."""
        return {
            f"{column.key}_{name}": Number(float(value), f"{column.label}: {text}", unit)
            for column, value in zip(self.columns, values, strict=True)
        }

    @mpl.rc_context(STYLE)
    def spheres(
        self,
        rows: Mapping[str, tuple[Array, Sequence[str]]],
        norm: Normalize,
        colours: str,
        label: str,
        ticks: Sequence[float],
        extend: str = "neither",
    ) -> Figure:
        """Return spheres of tool axes (Mollweide, equal areas) with one scale.

        Args:
            rows: by their name, values (columns, directions), NaN where it fails, and what is
                written below each sphere.
            norm, colours, label, ticks, extend: of the scale, as matplotlib has them.
        """
        shape = len(rows), len(self.columns)
        figure = Figure(figsize=(1.45 * shape[1] + 0.6, 1.0 * shape[0] + 0.85))
        grid = figure.subplots(*shape, squeeze=False, subplot_kw={"projection": "mollweide"})
        for row, (name, (values, below)) in zip(grid, rows.items(), strict=True):
            row[0].text(-0.06, 0.5, name, transform=row[0].transAxes, rotation=90,
                        ha="right", va="center")  # fmt: skip
            for axes, column, value, text in zip(row, self.columns, values, below, strict=True):
                axes.set(xticks=[], yticks=[])
                axes.grid(False)
                mesh = self._paint(axes, value, norm, colours)
                _mark_poles(axes, column)
                axes.set_xlabel(text, fontsize=7, labelpad=6)
        for axes, column in zip(grid[0], self.columns, strict=True):
            axes.set_title(column.label, fontsize=8, pad=9)
        height = figure.get_figheight()
        figure.subplots_adjust(0.05, 0.7 / height, 0.995, 1 - 0.3 / height, 0.05, 0.28)
        strip = figure.add_axes((0.3, 0.4 / height, 0.4, 0.09 / height))
        bar = figure.colorbar(mesh, cax=strip, orientation="horizontal", extend=extend)
        bar.set_ticks(ticks, labels=[f"1/{1 / x:g}" if x < 1 else f"{x:g}" for x in ticks])
        bar.minorticks_off()
        bar.set_label(label, fontsize=7, labelpad=1)
        return figure

    def _paint(self, axes: Axes, values: Array, norm: Normalize, colours: str) -> QuadMesh:
        """Colour each point of the sphere like the nearest tool axis."""
        longitude = np.linspace(-math.pi, math.pi, 241)
        latitude = np.linspace(-math.pi / 2, math.pi / 2, 121)
        lon, lat = np.meshgrid(
            (longitude[1:] + longitude[:-1]) / 2 + _CENTRE, (latitude[1:] + latitude[:-1]) / 2
        )
        points = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
        nearest = (points @ self.tool_axes.T).argmax(axis=-1)
        axes.set_facecolor("#d62700")  # where it fails: no colour of viridis is like it
        return axes.pcolormesh(
            longitude, latitude, values[nearest], norm=norm, cmap=colours, rasterized=True
        )


def random_axis(random: Generator) -> Array:
    """Return a unit vector (3,), uniform over the sphere."""
    v = random.normal(size=3)
    return v / math.sqrt(v @ v)


def _with_tool_axis(z: Array, roll: float) -> Array:
    """Return R (3, 3) with the unit tool axis z (3,) and a roll [rad] about it."""
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= math.sqrt(x @ x)
    R: Array = np.stack([x, cross(z, x), z], axis=1) @ exp(np.array([0.0, 0.0, roll]))
    return R


def _mark_poles(axes: Axes, column: Column) -> None:
    """Mark and name the tool axes at which Euler angles are singular, along x or z."""
    if column.orientation != "euler_angles":
        return
    axis = "XYZ".index(column.sequence[0])
    for sign in (1, -1):
        longitude = 0.0 if axis == 2 else -_CENTRE if sign > 0 else math.pi - _CENTRE
        latitude = sign * math.pi / 2 if axis == 2 else 0.0
        for colour, width in (("white", 2.2), ("black", 0.9)):
            axes.plot(longitude, latitude, "o", ms=7, mfc="none", mec=colour, mew=width,
                      clip_on=False)  # fmt: skip
        axes.annotate(
            f"{'+' if sign > 0 else '-'}{'xyz'[axis]}",
            (longitude, latitude),
            (0, -10 * sign if axis == 2 else -10),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=7,
            path_effects=[withStroke(linewidth=1.8, foreground="white")],
        )
