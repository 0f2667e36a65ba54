"""Parameters on the command line of a node: sections of parameter files, and single ones.

rcl leaves out the sections of other nodes without a word.  So a name that is misspelt would mean
that all its parameters are the defaults.  Nor does it say that a word is dropped where another
source gives the same parameter as a number: that would count.
"""

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from eulerparams_control.errors import ConfigurationError, did_you_mean
from eulerparams_control.parameters.fields import checked

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


def refuse_misread(
    name: str, fields: Mapping[str, Field[Any]], arguments: Sequence[str] | None = None
) -> None:
    """Check what a command line, that of the process for None, gives the node ``name``.

    Raises ConfigurationError if no section of a file is for the node, but one has nearly its name;
    if a word is given for a parameter, of its ``fields``, that is no text.
    """
    given = []
    for flag, argument in pairwise(sys.argv if arguments is None else arguments):
        if flag in ("-p", "--param"):
            key, _, text = argument.partition(":=")
            node, _, key = key.rpartition(":")
            if node in ("", name):
                given.append({key: _loaded(text)})
        elif flag == "--params-file":
            sections = list(named_sections(_loaded(Path(argument))))
            own = [values for section, values in sections if _is_for(name, section)]
            for section, _ in [] if own else sections:
                if did_you_mean(section.rpartition("/")[2], [name]):
                    raise ConfigurationError(
                        f"{argument} has parameters for the node '{section}'; did you mean "
                        f"'{name}'? It has none for '{name}'"
                    )
            given += own
    for values in given:
        for key, value in values.items() if isinstance(values, dict) else ():
            is_text = key not in fields or isinstance(fields[key].default, str)
            if isinstance(value, str) and not is_text:
                checked(fields[key], value)


def _is_for(name: str, section: str) -> bool:
    part = section.rpartition("/")[2]
    return part == name or "*" in part


def _loaded(source: str | Path) -> Any:
    try:
        return load_yaml(source)
    except ConfigurationError:
        return None  # rcl has read it in its own way, or has refused it
