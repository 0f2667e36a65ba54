"""The look and the behaviour of the page: its style sheet, its scripts, the 3D library."""

from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

SCRIPTS = (
    "data.js",
    "theme.js",
    "cursor.js",
    "plots.js",
    "plot_cursor.js",
    "tables.js",
    "mesh.js",
    "robot.js",
    "frames.js",
    "orbit.js",
    "scene.js",
    "run.js",
    "replay.js",
    "player.js",
    "print.js",
    "start.js",
)
"""In the order in which they are read: one function holds them all."""

_ASSETS = files(__package__) / "assets"
_VIEWER = Path("viewer", "dist")


@cache
def style(name: str = "page.css") -> str:
    """Return a style sheet: of the page, or ``plain.css`` of pages without plots and replay."""
    return (_ASSETS / name).read_text(encoding="utf-8")


@cache
def script() -> str:
    """Return the script."""
    parts = [(_ASSETS / name).read_text(encoding="utf-8") for name in SCRIPTS]
    return '"use strict";\n(() => {\n' + "\n".join(parts) + "\n})();\n"


@cache
def viewer() -> str:
    """Return the library that draws in 3D, with its licences; "" if it is not installed."""
    spec = find_spec("meshcat")  # found, not imported: importing it starts a server's libraries
    if spec is None or not spec.submodule_search_locations:
        return ""
    folder = Path(spec.submodule_search_locations[0]) / _VIEWER
    names = ("main.min.js.LICENSE.txt", "main.min.js")
    parts = [(folder / name).read_text(encoding="utf-8") for name in names]
    return "\n".join(parts).replace("</script", "<\\/script")
