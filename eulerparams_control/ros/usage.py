"""What a node says of itself with ``--help``: what it does, and its parameters."""

import inspect
import shutil
import textwrap
from pathlib import Path
from typing import Any

from eulerparams_control.parameters.fields import allowed, default_text, fields_of

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
    about = inspect.cleandoc(inspect.getmodule(node).__doc__ or "").replace("``", "")
    lines = [
        f"usage: {Path(program).name.removesuffix('_node.py')} "
        "[--ros-args --params-file FILE] [--ros-args -p NAME:=VALUE] ...",
        *("", about, "", "Parameters, with their defaults; those with * may change while it runs:"),
    ]
    fields = fields_of(node.parameters_type)
    kinds = node.parameters_type.__mro__  # what is special comes first
    for name in dict.fromkeys(name for kind in kinds for name in inspect.get_annotations(kind)):
        if name in fields:
            meta, words = fields[name].metadata, allowed(fields[name])
            star, unit = "*" if meta["live"] else "", f" {meta['unit']}" if meta["unit"] else ""
            text = meta["description"] + (f" ({' | '.join(words)})" if words else "")
            lines += ["", f"  {name}{star}: {default_text(fields[name])}{unit}"]
            wrapped = textwrap.wrap(text, width - len(_INDENT), break_on_hyphens=False)
            lines += [_INDENT + line for line in wrapped]
    return "\n".join(lines)
