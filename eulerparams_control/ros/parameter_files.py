"""Parameters on the command line of a node: sections of parameter files, and single ones.

rcl leaves out the sections of other nodes without a word.  So a name that is misspelt would mean
that all its parameters are the defaults.  Nor does it say that a word is dropped where another
source gives the same parameter as a number: that would count.
"""

import sys
from collections.abc import Iterable, Iterator
from itertools import pairwise
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


def given_words(name: str, arguments: Iterable[str] | None = None) -> Iterator[tuple[str, str]]:
    """Yield names and values of the parameters of the node ``name`` that are given as words."""
    arguments = list(sys.argv if arguments is None else arguments)
    for flag, argument in pairwise(arguments):
        if flag in ("-p", "--param"):
            node, _, key = argument.partition(":=")[0].rpartition(":")
            if node in ("", name):
                yield from _words({key: _loaded(argument.partition(":=")[2])})
    for path in _files(arguments):
        for section, values in _sections(path):
            part = section.rpartition("/")[2]
            if part == name or "*" in part:
                yield from _words(values)


def _words(values: Any) -> Iterator[tuple[str, str]]:
    if isinstance(values, dict):
        yield from ((str(key), word) for key, word in values.items() if isinstance(word, str))


def _loaded(text: str) -> Any:
    try:
        return yaml.safe_load(text)
    except (ValueError, RecursionError, yaml.YAMLError):
        return None  # rcl has read it in its own way, or has refused it


def _files(arguments: Iterable[str]) -> Iterator[str]:
    before = ""
    for argument in arguments:
        if before == "--params-file":
            yield argument
        before = argument


def _sections(path: str) -> Iterator[tuple[str, Any]]:
    """Yield the full names of the nodes that a file is for, with what it gives them."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return  # rcl has read it in its own way, or has refused it
    yield from named_sections(_loaded(text))


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
