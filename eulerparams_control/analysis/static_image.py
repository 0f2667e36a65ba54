"""A static figure as a file of a paper: its look, its bytes."""

import hashlib
import io
import re
import warnings
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from eulerparams_control.errors import ConfigurationError

WIDTH = 3.5
"""[in] of a column of a paper."""

FORMATS = ("svg", "png", "pdf")

STYLE: dict[Any, Any] = {
    "font.family": ["STIXGeneral", "DejaVu Sans"],  # both come with matplotlib: same everywhere
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "axes.linewidth": 0.5,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.linewidth": 0.3,
    "grid.color": "0.85",
    "hatch.linewidth": 0.4,
    "legend.frameon": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "eulerparams_control",
    "pdf.fonttype": 42,
}
"""Of every static figure."""

_LONGEST = 46  # characters of a name in the legend
_REFERENCE = re.compile(r'(id="|href="#|url\(#)')


def svg(figure: Figure) -> str:
    """Return a figure as SVG: the same text each time; it can be a file or stand in a page.

    Its ids, and so its style, are its own: they are made from its content.
    """
    text = _image(figure, "svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    own = f"f{hashlib.sha1(text, usedforsecurity=False).hexdigest()[:10]}-"
    whole = _REFERENCE.sub(rf"\g<1>{own}", text.decode("utf-8"))
    return whole[whole.index("<svg") :].replace(">*{", f">#{own}figure_1 *{{", 1)


def image(figure: Figure, name: str) -> bytes:
    """Return a figure in a format: the same bytes each time."""
    if name == "svg":
        return svg(figure).encode("utf-8")
    if name == "pdf":
        return _image(figure, name, metadata=dict.fromkeys(("Creator", "Producer", "CreationDate")))
    return _image(figure, name, metadata={"Software": None}, dpi=300)


def write(path: Path, content: bytes) -> None:
    """Write a file and its folders; raises ConfigurationError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error}") from error


def plain(text: str, longest: int = _LONGEST) -> str:
    """Return a text from outside as one printable line, its middle left out if it is long."""
    text = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    half = longest // 2
    return text if len(text) <= longest else f"{text[: half - 1]}…{text[-half:]}"


def _image(figure: Figure, name: str, **how: Any) -> bytes:
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # of a name: a box stands for it
        figure.savefig(buffer, format=name, **how)
    return buffer.getvalue()
