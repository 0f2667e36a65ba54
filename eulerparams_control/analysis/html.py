"""HTML pages from the templates beside this file.

A page opens offline and needs nothing but a browser.  What comes from a bag or a file is never
trusted: every text is escaped where it enters a page, and a content security policy forbids the
page to load anything.

    write_html("out/index.html", "paper.html", outcomes=outcomes)
"""

import math
import re
from functools import cache
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup, escape

from eulerparams_control.analysis.labels import colour, dash, number, quantity
from eulerparams_control.analysis.verdict import groups, shown
from eulerparams_control.errors import ConfigurationError

SCRIPTS = (
    *("data.js", "theme.js", "cursor.js", "plots.js", "plot_cursor.js", "tables.js", "mesh.js"),
    *("robot.js", "frames.js", "orbit.js", "scene.js", "run.js", "replay.js", "player.js"),
    *("print.js", "start.js"),
)
"""In the order in which they are read: one function holds them all."""

MISSING = "-"
"""Where a number was not recorded."""

_HERE = Path(__file__).parent
_VIEWER = Path("viewer", "dist")
_SUBSCRIPT = re.compile(r"_([A-Za-z0-9]+)")
_NUMBER = re.compile(r"(\d\S*(?: (?:deg|mm/s|mm|rad/s|Nm/rad|Nm|N/m|N|1/s|s)\b)?)")


def write_html(path: str | PathLike[str], template: str, **content: Any) -> None:
    """Write a page and its folder.

    Args:
        path: of the file.
        template: the name of its template.
        content: what the template names.

    Raises:
        ConfigurationError: if the file cannot be written.
    """
    text = _ENVIRONMENT.get_template(template).render(content)
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"cannot write the page {path}: {error.strerror}") from error


@cache
def style() -> Markup:
    """Return the style sheet of all pages."""
    return Markup((_HERE / "assets/page.css").read_text(encoding="utf-8"))


@cache
def script() -> Markup:
    """Return the script of the page of runs."""
    parts = [(_HERE / "assets" / name).read_text(encoding="utf-8") for name in SCRIPTS]
    return Markup('"use strict";\n(() => {\n' + "\n".join(parts) + "\n})();\n")


@cache
def plotly() -> Markup:
    """Return the library that draws plots."""
    from plotly.offline import get_plotlyjs  # takes a while, and few pages have plots

    return Markup(get_plotlyjs())


@cache
def viewer() -> Markup:
    """Return the library that draws in 3D, with its licences; "" if it is not installed."""
    spec = find_spec("meshcat")  # found, not imported: importing it starts a server's libraries
    if spec is None or not spec.submodule_search_locations:
        return Markup()
    folder = Path(spec.submodule_search_locations[0]) / _VIEWER
    names = ("main.min.js.LICENSE.txt", "main.min.js")
    parts = [(folder / name).read_text(encoding="utf-8") for name in names]
    return Markup("\n".join(parts).replace("</script", "<\\/script"))


def as_json(value: Any) -> Markup:
    """Return JSON that cannot end the script element that it stands in."""
    return htmlsafe_json_dumps(value, allow_nan=False, separators=(",", ":"))


def breakable(name: str) -> Markup:
    """Return a name that may break after its underscores."""
    return escape(name).replace("_", Markup("_<wbr>"))


def mathematics(text: str) -> Markup:
    """Return an equation with its subscripts."""
    return Markup(_SUBSCRIPT.sub(r"<sub>\1</sub>", str(escape(text))))


def with_whole_numbers(text: str) -> Markup:
    """Return a text with numbers and units that are not broken over two lines."""
    words = _NUMBER.split(text)  # every second one is a number
    span = Markup('<span class="whole">{}</span>')
    return Markup().join(span.format(w) if i % 2 else w for i, w in enumerate(words))


def exact(value: float | None, unit: str = "") -> str | None:
    """Return a number with all its digits; None if it is not known."""
    if value is None or not math.isfinite(value):
        return None
    return f"{value:.10g} {unit}".rstrip()


_ENVIRONMENT = Environment(
    loader=FileSystemLoader(_HERE / "templates"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_ENVIRONMENT.filters |= {
    **{"json": as_json, "breakable": breakable, "mathematics": mathematics, "exact": exact},
    **{"whole": with_whole_numbers, "number": number, "quantity": quantity, "groups": groups},
    **{"shown": shown, "svg": Markup},
}
_ENVIRONMENT.globals |= {
    **{"style": style, "script": script, "viewer": viewer, "MISSING": MISSING},
    **{"plotly": plotly, "colour": colour, "dash": dash},
}
