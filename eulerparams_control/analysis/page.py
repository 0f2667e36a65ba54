"""One HTML page of runs: it opens offline, and needs nothing but a browser.

What comes from a bag is never trusted: text is escaped where it enters the page, and a
content security policy forbids the page to load anything.
"""

import json
from collections.abc import Mapping, Sequence
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

from plotly.offline import get_plotlyjs

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.figures import panels, picture
from eulerparams_control.analysis.headline import describe
from eulerparams_control.analysis.page_assets import script, style, viewer
from eulerparams_control.analysis.page_sections import body, header
from eulerparams_control.analysis.plots import Figure, time_range
from eulerparams_control.analysis.quantity import Prediction
from eulerparams_control.analysis.replay import replay
from eulerparams_control.analysis.table import rows
from eulerparams_control.analysis.verdict import Verdict
from eulerparams_control.errors import ConfigurationError

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
{header}
{body}
<script type="application/json" id="figures">{figures}</script>
<script type="application/json" id="replay-data">{replay}</script>
<script>{plotly}</script>
<script>{viewer}</script>
<script>{script}</script>
</body>
</html>
"""


def write_page(
    path: str | PathLike[str],
    digests: Sequence[Digest],
    claim: str,
    sentence: str,
    verdicts: Sequence[Verdict] = (),
    first: str = "orientation_error",
    predictions: Sequence[Prediction] = (),
) -> None:
    """Write the page of some runs.

    Args:
        path: of the HTML file; its folder is made.
        digests: the runs, at least one.
        claim: what they are to show; "" if nothing.
        sentence: what they show, with numbers; "" describes them.
        verdicts: on the criteria; () if there are none.
        first: name of the quantity whose picture matters most.
        predictions: of theory, drawn dashed in the plots of their quantities.

    Raises:
        UnknownNameError: if there is no such quantity.
        ConfigurationError: if the file cannot be written.
    """
    drawn = panels(digests, picture(first), predictions)
    replayed = replay(digests)
    sentence = sentence or describe(digests)
    text = _PAGE.format(
        policy=_POLICY,
        title=escape(sentence),
        style=style(),
        header=header(digests, claim, sentence, verdicts),
        body=body(digests, drawn, verdicts, rows(digests), replayed),
        figures=figures_json(drawn.figures),
        replay=as_json({**replayed.data, "range": time_range(digests)}),
        plotly=get_plotlyjs(),
        viewer=viewer(),
        script=script(),
    )
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"cannot write the page {path}: {error.strerror}") from error


def figures_json(figures: Sequence[Figure]) -> str:
    """Return the plots as JSON."""
    return as_json([{"data": figure.data, "layout": figure.layout} for figure in figures])


def as_json(value: Sequence[Any] | Mapping[str, Any]) -> str:
    """Return JSON that cannot end the script element that it stands in."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
