"""Content of ``config/maps/NAME.yaml``: the kind of map, the representations, the options."""

from dataclasses import asdict, dataclass
from functools import cache, partial
from typing import Any

from eulerparams_control.lab.maps.base import MapKind, MapVariant, count, kinds
from eulerparams_control.lab.run.fingerprint import code_of_nodes, digest, version
from eulerparams_control.lab.run.yaml_checks import check_name, known, load, require
from sim_bridge.environment.keys import checked, read

_OWN = ("kind", "title", "question", "variants", "quick", "place")


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
    options |= told.get("quick") or {} if quick else {}
    options |= {"samples": samples} if samples else {}
    kind = read(cls, f"the kind '{cls.kind}'", options, variants=variants)
    title, question = str(told.get("title", name)), str(told.get("question", ""))
    place = checked("place", told.get("place", 99), count().metadata)
    return MapDefinition(name, title, question, kind, place)


def _variant(label: str, about: Any) -> MapVariant:
    require(isinstance(about, dict), f"variant '{label}': expected the key orientation")
    variant = read(MapVariant, "a variant", about, f"{label}.", label=label)
    _ = variant.representation  # raises if it is unknown
    return variant
