"""The surroundings of the robot: named things, each of a kind that its key ``shape`` names."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from sim_bridge.environment.keys import Keyed, number, read

_KEYS_OF = "environment.NAME.KEY, of every NAME the key shape and those of that shape"


@dataclass(frozen=True, kw_only=True)
class Thing(Keyed):
    """One thing of the environment; a subclass with a ``shape`` is a kind of its own.

    Poses are in the frame of the world, which is that of the robot's root link; its axes are
    the base axes.

    Attributes:
        start, end: s; it is there in the steps from t_k on with start <= t_k < end, and comes and
            goes within one of them; an infinite end is none.

    Raises:
        ConfigurationError: if a value is impossible; names the key.
    """

    shape: ClassVar[str]
    kinds: ClassVar[dict[str, type["Thing"]]] = {}
    start: float = number("s", default=0.0, least=0.0)
    end: float = number("s", default=math.inf, least=0.0, endless=True)

    def __init_subclass__(cls, shape: str = "", **options: Any) -> None:
        super().__init_subclass__(**options)
        if shape:
            cls.shape = shape
            Thing.kinds[shape] = cls

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.end > self.start:
            raise ConfigurationError(
                f"end is {self.end:g} s; expected it after start {self.start:g} s"
            )

    def is_there(self, t: float) -> bool:
        """Return whether it is there in the step from ``t`` [s] on."""
        return self.start <= t < self.end

    @property
    def keys(self) -> dict[str, Any]:
        """All keys with their values, as YAML would give them."""
        return {"shape": self.shape, **dataclasses.asdict(self)}


Environment = dict[str, Thing]
"""The things by their names."""


def read_environment(given: Mapping[str, Thing | Mapping[str, Any]]) -> Environment:
    """Return the things that a mapping (of YAML, say) describes; those made already stay.

    Raises:
        ConfigurationError: if a thing is impossible; names ``environment.NAME.KEY``.
    """
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"environment is {given!r}; expected {_KEYS_OF}")
    return {str(name): _read(f"environment.{name}", value) for name, value in given.items()}


def nest(parameters: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the keys and values of each thing, of parameters that are called ``NAME.KEY``.

    Raises:
        ConfigurationError: if one is called otherwise.
    """
    things: dict[str, dict[str, Any]] = {}
    for path, value in parameters.items():
        name, _, key = path.rpartition(".")
        if not name:
            raise ConfigurationError(f"environment.{path} is {value!r}; expected {_KEYS_OF}")
        things.setdefault(name, {})[key] = value
    return things


def _read(name: str, given: Thing | Mapping[str, Any]) -> Thing:
    if isinstance(given, Thing):
        return given
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"{name} is {given!r}; expected {_KEYS_OF}")
    kind = _kind(name, given)
    keys = {key: value for key, value in given.items() if key != "shape"}
    return read(kind, f"the {kind.shape}", keys, f"{name}.")


def _kind(name: str, given: Mapping[str, Any]) -> type[Thing]:
    if "shape" not in given:
        raise ConfigurationError(
            f"{name}.shape is missing; expected one of {', '.join(sorted(Thing.kinds))}; "
            f"found {', '.join(given) or 'no keys'}"
        )
    shape = str(given["shape"])
    if shape not in Thing.kinds:
        raise UnknownNameError(f"value of {name}.shape:", shape, Thing.kinds)
    return Thing.kinds[shape]
