"""What a node says of itself with ``--help``: what it does, and its parameters."""

import dataclasses
import inspect
import shutil
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eulerparams_control.parameters.fields import allowed, default_text

OPTIONS = "-h", "--help"

# Widest and narrowest text [characters], however wide the terminal is, and how far it is indented.
_WIDEST, _NARROWEST, _INDENT = 100, 20, 6 * " "


def usage(program: str, node: type[Any]) -> str:
    """Return the help of a node, whose class has ``parameters_type``, for the terminal.

    Args:
        program: how it was called; its name counts.
        node: its class, in a module that says what it does.
    """
    width = max(_NARROWEST, min(shutil.get_terminal_size().columns, _WIDEST))
    name = Path(program).name.removesuffix("_node.py")
    about = inspect.cleandoc(inspect.getmodule(node).__doc__ or "").replace("``", "")
    lines = [
        f"usage: {name} [--ros-args --params-file FILE] [--ros-args -p NAME:=VALUE] ...",
        *("", about, "", "Parameters, with their defaults; those with * may change while it runs:"),
    ]
    parameters = node.parameters_type
    fields = {field.name: field for field in dataclasses.fields(parameters)}
    for kind in parameters.__mro__:  # what is special comes first
        for own in inspect.get_annotations(kind):
            if own in fields:
                lines += ["", *_described(fields.pop(own), width)]
    return "\n".join(lines)


def _described(field: dataclasses.Field[Any], width: int) -> Iterator[str]:
    """Yield the lines of a parameter."""
    meta = field.metadata
    star, unit = "*" if meta["live"] else "", f" {meta['unit']}" if meta["unit"] else ""
    yield f"  {field.name}{star}: {default_text(field)}{unit}"
    among = f" ({' | '.join(allowed(field))})" if allowed(field) else ""
    lines = textwrap.wrap(meta["description"] + among, width - len(_INDENT), break_on_hyphens=False)
    yield from (_INDENT + line for line in lines)
