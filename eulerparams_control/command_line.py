"""What the executables that are no nodes share: a console, and whole numbers as options."""

import argparse
import os
import sys
from collections.abc import Callable

from rich.console import Console
from rich.text import Text

_PLAIN_WIDTH = 110  # characters of a table where there is no terminal


def make_console() -> Console:
    """Return a console; where nothing says how wide it is, it is wider than 80 characters."""
    is_known = sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit()
    return Console(width=None if is_known else _PLAIN_WIDTH)


def say(console: Console, text: str | Text, style: str = "") -> None:
    """Print a line as it is: names, paths and what nodes say may look like markup."""
    console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)


def whole_number(least: int = 0) -> Callable[[str], int]:
    """Return a type for argparse: whole numbers that are not below ``least``."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least:
            raise argparse.ArgumentTypeError(f"{text}; expected a whole number, {least} or more")
        return value

    return parse
