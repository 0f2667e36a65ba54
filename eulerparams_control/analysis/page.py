"""One HTML page of runs: it opens offline, and needs nothing but a browser.

What comes from a bag is never trusted: text is escaped where it enters the page, and a
content security policy forbids the page to load anything.
"""

import re
from collections.abc import Iterator, Sequence
from html import escape
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from plotly.offline import get_plotlyjs

from eulerparams_control.analysis.figures import Panels, panels, picture
from eulerparams_control.analysis.labels import labels
from eulerparams_control.analysis.page_assets import SCRIPT, STYLE
from eulerparams_control.analysis.page_tables import criteria, numbers, parameters, run_names
from eulerparams_control.analysis.plots import Panel
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.sentence import describe
from eulerparams_control.errors import ConfigurationError

if TYPE_CHECKING:
    from eulerparams_control.experiments.criteria import Verdict

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
<header>
<h1>{sentence}</h1>
{claim}
{warnings}
</header>
{body}
<script type="application/json" id="figures">{figures}</script>
<script>{plotly}</script>
<script>{script}</script>
</body>
</html>
"""


_UNITS = "deg|mm/s|mm|rad/s|Nm/rad|Nm|N/m|N|1/s|s"
_NUMBER = re.compile(rf"(\d\S*(?: (?:{_UNITS})\b)?)")


def write_page(
    path: str | PathLike[str],
    recordings: Sequence[Recording],
    claim: str,
    sentence: str,
    verdicts: Sequence["Verdict"] = (),
    first: str = "orientation_error",
) -> None:
    """Write the page of some runs.

    Args:
        path: of the HTML file; its folder is made.
        recordings: the runs, at least one.
        claim: what they are to show; "" if nothing.
        sentence: what they show, with numbers; "" describes them.
        verdicts: on the criteria; () if there are none.
        first: name of the quantity whose picture matters most.

    Raises:
        UnknownNameError: if there is no such quantity.
        ConfigurationError: if the file cannot be written.
    """
    drawn = panels(recordings, picture(first))
    sentence = sentence or describe(recordings)
    text = _PAGE.format(
        policy=_POLICY,
        title=escape(sentence),
        style=STYLE,
        sentence=_with_whole_numbers(sentence),
        claim=_claim(claim, verdicts),
        warnings="\n".join(_warnings(recordings)),
        body=_body(drawn, recordings, verdicts),
        figures=figures_json(drawn.over_time + drawn.vectors + drawn.joints),
        plotly=get_plotlyjs(),
        script=SCRIPT,
    )
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"cannot write the page {path}: {error.strerror}") from error


def _with_whole_numbers(text: str) -> str:
    """Return the text, escaped, with numbers and units that are not broken over two lines."""
    words = map(escape, _NUMBER.split(text))  # every second one is a number
    return "".join(
        f'<span class="whole">{word}</span>' if index % 2 else word
        for index, word in enumerate(words)
    )


def _claim(claim: str, verdicts: Sequence["Verdict"]) -> str:
    text = escape(" ".join(claim.split()))
    if verdicts:
        met = sum(verdict.met for verdict in verdicts)
        kind = "yes" if met == len(verdicts) else "no"
        text += f' <span class="{kind}">{met} of {len(verdicts)} criteria met.</span>'
    return f'<p class="claim">{text}</p>' if text else ""


def _warnings(recordings: Sequence[Recording]) -> Iterator[str]:
    """Yield what is not as usual with a run."""
    for name, recording in zip(labels(recordings), recordings, strict=True):
        if recording.warning:
            yield _warning(f"Incomplete recording: {recording.warning}")
        if recording.diverged is not None:
            t = f"{recording.diverged:.3f}"
            yield _warning(f"{name} diverged at {t} s: its curves and numbers end there.")
        if recording.sensed is not None and recording.why_no_wrench:
            yield _warning(f"{name}: {recording.why_no_wrench}.")


def _warning(text: str) -> str:
    return f'<p class="warning">{escape(text)}</p>'


def _body(drawn: Panels, recordings: Sequence[Recording], verdicts: Sequence["Verdict"]) -> str:
    first, *others = drawn.over_time
    sections = [
        _figure(first),
        f'<p class="note">{_HINT}</p>',
        criteria(verdicts),
        "<h2>Over time</h2>",
        _key(recordings),
        f'<div class="plots">{"".join(map(_figure, others))}</div>',
        *map(_figure, drawn.vectors),
        "<h2>Numbers</h2>",
        numbers(recordings),
        *map(_figure, drawn.joints),
        "<h2>Parameters</h2>",
        parameters(recordings),
    ]
    return "\n".join(sections)


_HINT = (
    "Shaded: within 5 deg of the pole of the Euler angles. Drag to zoom, double-click to return; "
    "click a name to hide its run: all plots follow."
)


def _key(recordings: Sequence[Recording]) -> str:
    """Return the buttons that name the runs and hide them; they stay in sight."""
    buttons = "".join(
        f'<button type="button" data-run="{index}">{name}</button>'
        for index, name in enumerate(run_names(recordings))
    )
    return f'<nav class="runs">{buttons}</nav>'


def _figure(panel: Panel) -> str:
    return (
        f"<figure><h3>{escape(panel.title)}</h3>"
        f'<div class="plot" style="height:{panel.height}px"></div>'
        f"<figcaption>{escape(panel.caption)}</figcaption></figure>"
    )


def figures_json(drawn: Sequence[Panel]) -> str:
    """Return the plots as JSON that cannot end the script element that it stands in."""
    text = ",".join(panel.figure.to_json() for panel in drawn)
    return f"[{text}]".replace("<", "\\u003c")
