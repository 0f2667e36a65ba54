"""Parameters on the command line of a node: sections of parameter files, and single ones.

rcl leaves out the sections of other nodes without a word.  So a name that is misspelt would mean
that all its parameters are the defaults.  Nor does it say that a word is dropped where another
source gives the same parameter as a number: that would count.
"""

import re
import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from eulerparams_control.errors import ConfigurationError, did_you_mean

_PARAMETERS = "ros__parameters"


class _Loader(yaml.SafeLoader):
    """YAML as rcl reads it: 1e-3 is a number."""


_NUMBER = re.compile(r"[-+]?((\d+\.?\d*|\.\d+)e[-+]?\d+|nan|inf)$", re.IGNORECASE)
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _NUMBER, [*"-+.0123456789nNiI"])


def load_yaml(source: str | Path) -> Any:
    """Return what YAML, or a file of it, holds; raises ConfigurationError."""
    try:
        text = source.read_text(encoding="utf-8") if isinstance(source, Path) else source
        return _Loader(text).get_single_data()
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise ConfigurationError(str(error)) from error


def named_sections(content: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the full names of the nodes that a parameter file is for, with what it gives them."""
    for key, value in content.items() if isinstance(content, dict) else ():
        name = f"{above}/{str(key).strip('/')}"
        if isinstance(value, dict) and _PARAMETERS in value:
            yield name, value[_PARAMETERS]
        else:
            yield from named_sections(value, name)


def refuse_misspelt_sections(name: str, arguments: Sequence[str] | None = None) -> None:
    """Check the parameter files of a command line for the node ``name``.

    A file may be for other nodes only, but not for one whose name is nearly that of this one.

    Args:
        name: of the node, without its namespace.
        arguments: of the command line; None is that of the process.

    Raises:
        ConfigurationError: if no section of a file is for the node, but one is probably meant so.
    """
    for path in _values(("--params-file",), arguments):
        sections = [section for section, _ in named_sections(_loaded(Path(path)))]
        if any(_is_for(name, section) for section in sections):
            continue
        for section in sections:
            if did_you_mean(section.rpartition("/")[2], [name]):
                raise ConfigurationError(
                    f"{path} has parameters for the node '{section}'; did you mean '{name}'? "
                    f"It has none for '{name}'"
                )


def given_words(name: str, arguments: Sequence[str] | None = None) -> Iterator[tuple[str, str]]:
    """Yield names and values of the parameters of the node ``name`` that are given as words."""
    given = []
    for rule in _values(("-p", "--param"), arguments):
        key, _, text = rule.partition(":=")
        node, _, key = key.rpartition(":")
        if node in ("", name):
            given.append({key: _loaded(text)})
    for path in _values(("--params-file",), arguments):
        sections = named_sections(_loaded(Path(path)))
        given += [values for section, values in sections if _is_for(name, section)]
    for values in given:
        for key, word in values.items() if isinstance(values, dict) else ():
            if isinstance(word, str):
                yield str(key), word


def _values(flags: Sequence[str], arguments: Sequence[str] | None) -> list[str]:
    """Return what follows on flags."""
    return [
        value
        for flag, value in pairwise(sys.argv if arguments is None else arguments)
        if flag in flags
    ]


def _is_for(name: str, section: str) -> bool:
    part = section.rpartition("/")[2]
    return part == name or "*" in part


def _loaded(source: str | Path) -> Any:
    try:
        return load_yaml(source)
    except ConfigurationError:
        return None  # rcl has read it in its own way, or has refused it
