"""Content of ``config/maps/NAME.yaml``: the kind of map, the representations, the options."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cache, partial
from typing import Any

from eulerparams_control.lab.maps.base import MapKind, MapVariant, kinds
from eulerparams_control.lab.run.fingerprint import code_of_nodes, digest, version
from eulerparams_control.lab.run.yaml_checks import check_name, known, load, require
from sim_bridge.environment.keys import checked, number

_OWN = ("kind", "title", "question", "variants", "quick", "place")
_ANY, _NOT_NEGATIVE = number().metadata, number(least=0.0).metadata
_COUNT = number(least=1, whole=True).metadata
_OF_VARIANT = ("orientation", "sequence", "k_factor")


@dataclass(frozen=True)
class MapDefinition:
    """A map that can be made.

    Attributes:
        name: of its file.
        title: of its part of the page.
        question: that it answers.
        kind: what is simulated, with its options.
        place: of its part in the page.
    """

    name: str
    title: str
    question: str
    kind: MapKind
    place: int = 99

    @property
    def fingerprint(self) -> str:
        """A name of the numbers that it leads to: other options or code, another name.

        The captions are code of the kind, so another caption is another name, too.
        """
        options = {"kind": self.kind.kind, **asdict(self.kind)}
        return digest([options, self.kind.besides(), _code(type(self.kind).__module__)])


@cache
def _code(module: str) -> str:
    """Return the version of the code of a kind in this module, without those of other kinds."""
    own = f"{module.rpartition('.')[2]}.py"
    files = (path for path in code_of_nodes("lab/maps") if path.name != "main.py")
    return version(path for path in files if path.name == own or "_map" not in path.stem)


def load_map(name_or_path: str, quick: bool = False, samples: int = 0) -> MapDefinition:
    """Return the map of ``config/maps/<name>.yaml``, or of a path ending in ``.yaml``.

    Args:
        name_or_path: which.
        quick: whether its coarse options, under the key "quick", are to be taken.
        samples: in place of its own number of samples, unless 0.

    Raises:
        UnknownNameError: for an unknown map, kind, option, orientation or sequence.
        ConfigurationError: if the file is broken or a value impossible.
    """
    return load("maps", name_or_path, partial(_definition, quick, samples))


def _definition(quick: bool, samples: int, name: str, told: Any) -> MapDefinition:
    check_name("map", name)  # of the folder of its results
    is_whole = isinstance(told, dict) and isinstance(told.get("variants"), dict)
    require(is_whole, "expected the keys kind, title, variants, and options")
    known("kind of map", told.get("kind"), kinds())
    cls = kinds()[told["kind"]]
    variants = tuple(_variant(str(label), about) for label, about in told["variants"].items())
    options = {key: value for key, value in told.items() if key not in _OWN}
    kind = cls(variants=variants, **_options(cls, options))
    for more in (told.get("quick") or {} if quick else {}, {"samples": samples} if samples else {}):
        kind = replace(kind, **_options(cls, more))
    title, question = str(told.get("title", name)), str(told.get("question", ""))
    return MapDefinition(name, title, question, kind, _like(99, "place", told.get("place", 99)))


def _variant(label: str, about: Any) -> MapVariant:
    require(isinstance(about, dict), f"variant '{label}': expected the key orientation")
    for key in about:
        known("key of a variant", key, _OF_VARIANT)
    variant = MapVariant(label, **{"orientation": "", **about})
    _ = variant.representation  # raises if it is unknown
    return replace(variant, k_factor=_like(1.0, "k_factor", variant.k_factor))


def _options(cls: type[MapKind], told: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a kind, each of the type of its default."""
    defaults = {field.name: field.default for field in fields(cls) if field.name != "variants"}
    for key in told:
        known(f"option of the kind '{cls.kind}'", key, defaults)
    return {key: _like(defaults[key], key, value) for key, value in told.items()}


def _like(default: Any, key: str, value: Any) -> Any:
    """Return a value of the type of the default: a name, a count, a number, or some numbers."""
    if isinstance(default, str):
        require(isinstance(value, str), f"{key} is {value!r}; expected a word like {default!r}")
        return value
    if isinstance(default, tuple):
        require(isinstance(value, list), f"{key} is {value!r}; expected a list of numbers")
        return tuple(checked(key, each, _ANY) for each in value)
    return checked(key, value, _COUNT if isinstance(default, int) else _NOT_NEGATIVE)
