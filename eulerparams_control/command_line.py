"""The executables: where they are, the extras that they need, what their command lines share.

``python -m eulerparams_control.command_line NAME`` runs one where no scripts are installed.
"""

import argparse
import gc
import os
import sys
from collections.abc import Callable
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eulerparams_control.events import ExitCode

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

PROGRAMS = {
    "pybullet_bridge": "sim_bridge.bridge_node",
    "bag_recorder": "eulerparams_control.bags.recorder",
    "analyze": "eulerparams_control.analysis.main",
    "experiment": "eulerparams_control.lab.experiments.main",
    "live": "eulerparams_control.live.main",
}
"""The modules of the executables that are not named after their file."""

_ANALYSIS = ("plotly", "matplotlib", "pyarrow", "meshcat", "rich", "jinja2", "pycollada")
EXTRAS = {"analysis": _ANALYSIS, "live": ("viser", "pycollada")}
"""Packages that programs need, as extras of pip."""

_EXTRA_OF_ROOM = {"analysis": "analysis", "lab": "analysis", "live": "live"}

_SIMULATOR = ("pybullet", "pybullet_data")
_MODULES = {"pycollada": "collada"}  # of packages whose modules have another name
_PLAIN_WIDTH = 110  # characters of a table where there is no terminal


@cache
def executables() -> dict[str, str]:
    """Return the modules of all executables by name: ``NAME_node.py`` with a main is NAME."""
    root = Path(__file__).resolve().parents[1]
    nodes = {
        path.stem.removesuffix("_node"): ".".join(path.relative_to(root).with_suffix("").parts)
        for path in sorted(root.glob("eulerparams_control/**/*_node.py"))
        if "\ndef main(" in path.read_text(encoding="utf-8")
    }
    return nodes | PROGRAMS


def extra_of(name: str) -> str:
    """Return the extra that an executable needs; "" if none."""
    _package, _, path = PROGRAMS.get(name, "").partition(".")
    return _EXTRA_OF_ROOM.get(path.partition(".")[0], "")


def __getattr__(name: str) -> Any:
    if name in executables():
        return partial(_run, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _run(name: str, args: list[str] | None = None) -> int:
    """Run a program; return its exit code, 2 if a package of its extra or PyBullet is missing.

    Imports take seconds: who interrupts them with Ctrl-C gets 130 and no traceback.
    """
    try:
        return _imported(name, args)
    except KeyboardInterrupt:
        return ExitCode.INTERRUPTED
    except ModuleNotFoundError as error:
        if error.name not in _SIMULATOR:
            raise
        print(
            f"error: {name} needs PyBullet, the simulator, which is not installed; the computer of "
            "a robot does without it. To simulate: pip install pybullet-arm64 (Linux on x86_64), "
            "or pybullet, which is compiled",
            file=sys.stderr,
        )
        return 2


def _imported(name: str, args: list[str] | None) -> int:
    extra = extra_of(name)
    missing = [p for p in EXTRAS.get(extra, ()) if find_spec(_MODULES.get(p, p)) is None]
    if missing:
        print(
            f"error: {name} needs {', '.join(missing)}; install the extra '{extra}', in the folder "
            f"of the package: make setup, or pip install -e '.[{extra}]'",
            file=sys.stderr,
        )
        return 2
    collects = gc.isenabled()
    gc.disable()  # what is imported stays: to look for garbage in it takes more than 0.1 s
    try:
        program = import_module(executables()[name])
        gc.freeze()
    finally:
        if collects:
            gc.enable()
    return int(program.main(args))


def make_console() -> "Console":
    """Return a console; where nothing says how wide it is, it is wider than 80 characters."""
    from rich.console import Console  # of an extra

    is_known = sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit()
    return Console(width=None if is_known else _PLAIN_WIDTH)


def say(console: "Console", text: "str | Text", style: str = "") -> None:
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


if __name__ == "__main__":
    del sys.argv[0]  # the program is called by its name
    if not sys.argv or sys.argv[0] not in executables():
        sys.exit(f"error: expected the name of a program: {', '.join(sorted(executables()))}")
    sys.exit(_run(sys.argv[0]))
