"""The sections of the page as HTML: what it begins with, its plots, its replay."""

import re
from collections.abc import Iterator, Sequence
from html import escape

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.figures import Panels
from eulerparams_control.analysis.labels import labels
from eulerparams_control.analysis.page_tables import (
    criteria,
    key,
    named_key,
    numbers,
    parameters,
    reports,
)
from eulerparams_control.analysis.plots import Panel, prediction_dash
from eulerparams_control.analysis.replay import Replay, replay_section
from eulerparams_control.analysis.table import Row
from eulerparams_control.analysis.verdict import Verdict

_UNITS = "deg|mm/s|mm|rad/s|Nm/rad|Nm|N/m|N|1/s|s"
_NUMBER = re.compile(rf"(\d\S*(?: (?:{_UNITS})\b)?)")
_OPEN = 3  # groups of plots that are open at first
_HEAD, _TAIL = 8, 22  # characters that a button shows of a long name

_HINT = (
    '<p class="note hint">Drag in a plot to zoom, double-click to return: all plots follow. '
    "Point at a plot to see that instant everywhere, click to keep it.</p>"
)
_POLE_KEY = (
    '<span class="shade pole"></span>within 5 deg of the pole of the Euler angles '
    "(representation singularity)"
)
_SINGULAR_KEY = (
    '<span class="shade singular"></span>near a kinematic singularity, of the arm itself'
)


def header(
    digests: Sequence[Digest], claim: str, sentence: str, verdicts: Sequence[Verdict]
) -> str:
    """Return the sentence, the claim, and what is not as usual."""
    warnings = "\n".join(_warnings(digests))
    heading = f"<h1>{_with_whole_numbers(sentence)}</h1>"
    return f"<header>\n{heading}\n{_claim(claim, verdicts)}\n{warnings}\n</header>"


def body(
    digests: Sequence[Digest],
    drawn: Panels,
    verdicts: Sequence[Verdict],
    rows: Sequence[Row],
    replay: Replay,
) -> str:
    """Return all that follows."""
    judged = criteria(verdicts)
    sections = {
        **({"Criteria": judged} if judged else {}),
        **{group: "".join(map(_panel, panels)) for group, panels in drawn.groups.items()},
        **({"Reports": said} if (said := reports(digests)) else {}),
        "Numbers": numbers(digests, rows),
        "Parameters": parameters(digests),
    }
    anchors = {title: f"section-{index}" for index, title in enumerate(sections)}
    closed = [*list(drawn.groups)[_OPEN:], "Reports"]
    parts = [
        _section(anchors[title], title, content, title not in closed)
        for title, content in sections.items()
    ]
    first = f'<div class="top">{_panel(drawn.first)}{replay_section(digests, replay)}</div>'
    return "\n".join(
        [_bar(digests, anchors), "<main>", first, _shades(digests), _HINT, *parts, "</main>"]
    )


def _with_whole_numbers(text: str) -> str:
    """Return the text, escaped, with numbers and units that are not broken over two lines."""
    words = map(escape, _NUMBER.split(text))  # every second one is a number
    return "".join(
        f'<span class="whole">{word}</span>' if index % 2 else word
        for index, word in enumerate(words)
    )


def _claim(claim: str, verdicts: Sequence[Verdict]) -> str:
    text = escape(" ".join(claim.split()))
    if verdicts:
        met = sum(verdict.met for verdict in verdicts)
        kind = "yes" if met == len(verdicts) else "no"
        text += f' <span class="{kind}">{met} of {len(verdicts)} criteria met.</span>'
    return f'<p class="claim">{text}</p>' if text else ""


def _warnings(digests: Sequence[Digest]) -> Iterator[str]:
    """Yield what is not as usual with a run."""
    for name, digest in zip(labels(digests), digests, strict=True):
        if digest.warning:
            yield _warning(f"{name}: {digest.warning}.")
        if digest.diverged is not None:
            t = f"{digest.diverged:.3f}"
            yield _warning(f"{name} diverged at {t} s: its curves and numbers end there.")
        if digest.why_no_wrench:
            yield _warning(f"{name}: {digest.why_no_wrench}.")


def _warning(text: str) -> str:
    return f'<p class="warning">{escape(text)}</p>'


def _bar(digests: Sequence[Digest], anchors: dict[str, str]) -> str:
    """Return what stays in sight: the runs, with buttons that hide them, and the sections."""
    buttons = "".join(
        f'<button type="button" data-run="{index}" aria-pressed="true" '
        f'title="{escape(name)}: hide or show">{named_key(index, _short(name))}</button>'
        for index, name in enumerate(labels(digests))
    )
    links = "".join(f'<a href="#{anchor}">{escape(title)}</a>' for title, anchor in anchors.items())
    theme = '<button type="button" id="theme" aria-label="Dark or light">◐</button>'
    return (
        f'<div class="bar"><div class="runs" role="group" aria-label="Runs">{buttons}</div>'
        f'<nav aria-label="Sections">{links}{theme}</nav></div>'
    )


def _short(name: str) -> str:
    """Return a name of bearable length: names that share a beginning differ in their end."""
    return name if len(name) <= _HEAD + _TAIL + 1 else f"{name[:_HEAD]}…{name[-_TAIL:]}"


def _shades(digests: Sequence[Digest]) -> str:
    """Return what the shades of the plots mean, those that there are."""
    keys = []
    if any(digest.near_pole for digest in digests):
        keys.append(_POLE_KEY)
    if any(digest.near_singular for digest in digests):
        keys.append(_SINGULAR_KEY)
    return f'<p class="note shades">Shaded: {"; ".join(keys)}.</p>' if keys else ""


def _section(anchor: str, title: str, content: str, is_open: bool) -> str:
    return (
        f'<details class="section" id="{anchor}"{" open" if is_open else ""}>'
        f'<summary><h2>{escape(title)}</h2></summary><div class="content">{content}</div></details>'
    )


def _panel(panel: Panel) -> str:
    several = len(panel.figures) > 1
    plots = "".join(
        '<div class="component">'
        + (f"<h4>{escape(figure.title)}</h4>" if several else "")
        + f'<div class="plot" style="height:{figure.height}px"></div></div>'
        for figure in panel.figures
    )
    return (
        f'<figure class="{"wide" if several else ""}" data-quantity="{escape(panel.name)}">'
        f"<h3>{escape(panel.title)}</h3>{_predictions(panel)}"
        f'<div class="components">{plots}</div>'
        f"<figcaption>{escape(panel.caption)}</figcaption></figure>"
    )


def _predictions(panel: Panel) -> str:
    """Return what the dashed lines of a plot are."""
    lines = (
        f"<li>{key('currentColor', prediction_dash(index))}{escape(text)}</li>"
        for index, text in enumerate(panel.predictions)
    )
    return f'<ul class="predictions">{"".join(lines)}</ul>' if panel.predictions else ""
