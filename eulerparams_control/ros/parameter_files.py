"""Parameter files on the command line of a node, and their sections.

rcl leaves out the sections of other nodes without a word.  So a name that is misspelt would mean
that all its parameters are the defaults.
"""

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import yaml

from eulerparams_control.errors import ConfigurationError, did_you_mean

_PARAMETERS = "ros__parameters"


def refuse_misspelt_sections(name: str, arguments: Iterable[str] | None = None) -> None:
    """Check the parameter files of a command line for the node ``name``.

    A file may be for other nodes only, but not for one whose name is nearly that of this one.

    Args:
        name: of the node, without its namespace.
        arguments: of the command line; None is that of the process.

    Raises:
        ConfigurationError: if no section of a file is for the node, but one is probably meant so.
    """
    for path in _files(sys.argv if arguments is None else arguments):
        sections = [section for section, _ in _sections(path)]
        last_parts = [section.rpartition("/")[2] for section in sections]
        if name in last_parts or any("*" in part for part in last_parts):
            continue
        for section, part in zip(sections, last_parts, strict=True):
            if did_you_mean(part, [name]):
                raise ConfigurationError(
                    f"{path} has parameters for the node '{section}'; did you mean '{name}'? "
                    f"It has none for '{name}'"
                )


def _files(arguments: Iterable[str]) -> Iterator[str]:
    before = ""
    for argument in arguments:
        if before == "--params-file":
            yield argument
        before = argument


def _sections(path: str) -> Iterator[tuple[str, Any]]:
    """Yield the full names of the nodes that a file is for, with what it gives them."""
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return  # rcl has read it in its own way, or has refused it
    yield from named_sections(content)


def named_sections(content: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the full names of the nodes that a parameter file is for, with what it gives them."""
    if not isinstance(content, dict):
        return
    for key, value in content.items():
        name = f"{above}/{str(key).strip('/')}"
        if isinstance(value, dict) and _PARAMETERS in value:
            yield name, value[_PARAMETERS]
        else:
            yield from named_sections(value, name)
