"""A map: cells that are simulated one by one, and pictures of all of them.

A new kind of map is a subclass of :class:`MapKind` in a file ``*_map.py``; a new map of a kind is
one YAML file in ``config/maps``.
"""

import importlib
import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eulerparams_control.laws.orientation import (
    EulerSequence,
    OrientationOptions,
    OrientationRepresentation,
    representation,
)
from sim_bridge.environment.keys import Keyed, any_word, number

count = partial(number, least=1, whole=True)
"""A field for a count."""

type Row = dict[str, float | str]
"""A cell, or a cell with its outcomes: every cell of a map has the same keys."""

type Table = Mapping[str, NDArray[Any]]
"""The rows of a map as columns."""


@dataclass(frozen=True)
class MapVariant(Keyed):
    """A representation of the orientation displacement, with its fair gain.

    Attributes:
        label: by which the pictures name it.
        orientation: name of the representation.
        sequence: of its Euler angles.
        k_factor: by which k_Po is multiplied: 2 for Euler parameters, eps being theta / 2.
    """

    label: str
    orientation: str = any_word()
    sequence: str = any_word(default="XYZ")
    k_factor: float = number(default=1.0, least=0.0)

    @cached_property
    def representation(self) -> OrientationRepresentation:
        """The representation."""
        options = OrientationOptions(sequence=EulerSequence(self.sequence))
        return representation(self.orientation, options)

    @property
    def pole_axis(self) -> int | None:
        """The base axis (0, 1, 2) to which the tool axis z is parallel at the poles.

        Where the pole is a matter of the tool axis, else None.
        """
        if self.orientation != "euler_angles" or self.sequence[2] != "Z":
            return None
        return "XYZ".index(self.sequence[0])


class Picture(NamedTuple):
    """A picture of a map.

    Attributes:
        name: of its files.
        title: the finding, with a number.
        caption: what is shown.
        figure: the picture.
    """

    name: str
    title: str
    caption: str
    figure: Figure


@dataclass(frozen=True, kw_only=True)
class MapKind(Keyed, ABC):
    """A kind of map; its fields are the options of ``config/maps/NAME.yaml``.

    Attributes:
        variants: the representations that are compared.
        samples: how fine the map is; what it counts depends on the kind.
        batch: cells of one task: about half a second of work.
        seed: of all random numbers.
    """

    kind: ClassVar[str]
    registry: ClassVar[dict[str, type["MapKind"]]] = {}

    variants: tuple[MapVariant, ...]
    samples: int = count(default=100)
    batch: int = count(default=20)
    seed: int = count(default=1)

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "kind" in cls.__dict__:  # else it is a base of some
            cls.registry[cls.kind] = cls

    @abstractmethod
    def cells(self) -> list[Row]:
        """Return the cells, always the same in the same order.

        Each has the key "variant", an index of ``variants``, and "place", which seeds the random
        numbers: the same for all variants, so that these meet the same errors and noise.
        """

    @abstractmethod
    def simulate(self, cell: Row) -> dict[str, float]:
        """Return the outcomes of a cell; a function of the cell alone, wherever it runs."""

    @abstractmethod
    def pictures(self, table: Table) -> list[Picture]:
        """Return the pictures of all cells, in the style of matplotlib that is set."""

    def besides(self) -> Any:
        """Return what the outcomes depend on besides options and code, as JSON can hold it."""
        return None

    def variant(self, cell: Row) -> MapVariant:
        """Return the representation of a cell."""
        return self.variants[int(cell["variant"])]

    def parts(self, table: Table) -> list[tuple[MapVariant, Table]]:
        """Return the representations, each with its rows."""
        return [(variant, of_variant(table, i)) for i, variant in enumerate(self.variants)]

    def random(self, cell: Row) -> np.random.Generator:
        """Return the random numbers of a cell."""
        return np.random.default_rng([self.seed, int(cell["place"])])


@cache
def kinds() -> Mapping[str, type[MapKind]]:
    """Return all kinds of map by name; a file ``*_map.py`` here is found by being there."""
    for module in pkgutil.iter_modules([str(Path(__file__).parent)], f"{__package__}."):
        if module.name.endswith("_map"):
            importlib.import_module(module.name)
    return MappingProxyType(MapKind.registry)


def multiples(
    kind: MapKind, size: tuple[float, float], margin: float, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes for each representation, side by side.

    Args:
        kind: of the map.
        size: [in] of each.
        margin: [in] beside all.
        options: of the axes.
    """
    count = len(kind.variants)
    figure = Figure(figsize=(size[0] * count + margin, size[1]), layout="constrained")
    grid = figure.subplots(1, count, squeeze=False, **options)
    for axes, variant in zip(grid.flat, kind.variants, strict=True):
        axes.set_title(variant.label, fontsize=8, pad=3)
    return figure, list(grid.flat)


def of_variant(table: Table, variant: int, **equal: float) -> Table:
    """Return the rows of a variant, and of these values of other columns."""
    chosen = table["variant"] == variant
    for name, value in equal.items():
        chosen = chosen & (table[name] == value)
    return {name: column[chosen] for name, column in table.items()}
