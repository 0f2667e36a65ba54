"""The replay of the page as HTML: its canvas, its controls, what its parts mean."""

from collections.abc import Sequence
from html import escape

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.page_tables import run_names
from eulerparams_control.analysis.replay import ARROW, Replay

_SHOWN = 2  # runs that the replay shows at first
_SPEEDS = (0.1, 0.25, 0.5, 1, 2, 4)

_VIEW = """<div class="view">
<canvas tabindex="0" role="img" aria-label="The robot at the instant of the cursor"></canvas>
<img class="printed" alt="The robot at the instant of the cursor">
<p class="message" hidden></p>
<div class="tools">
<button type="button" id="fit" title="Show the whole robot again">Fit</button>
<button type="button" id="pin" aria-pressed="false"
 title="Keep the replay in sight while scrolling">Keep in sight</button>
</div></div>"""

_PLAYER = """<div class="player">
<button type="button" id="play" aria-label="Play" title="Play or pause (space)">▶</button>
<input type="range" id="time" aria-label="Time" title="Arrow keys step">
<output id="now" for="time"></output>
<select id="speed" aria-label="Speed">{speeds}</select>
</div>"""

_HINT = (
    '<p class="note">Drag to turn, Shift-drag to move, wheel to zoom. Space plays, arrow keys '
    "step.</p>"
)


def replay_section(digests: Sequence[Digest], replay: Replay) -> str:
    """Return the replay, without what draws it."""
    speeds = "".join(
        f'<option value="{speed}"{" selected" if speed == 1 else ""}>{speed}x</option>'
        for speed in _SPEEDS
    )
    notes = "".join(f'<p class="note missing">{escape(note)}</p>' for note in replay.notes)
    return (
        '<section id="replay" aria-label="Replay"><div class="stage"><h2>Replay</h2>'
        f"{_VIEW}{_PLAYER.format(speeds=speeds)}</div>"
        f"{_runs(digests)}{_layers(replay)}{_HINT}{notes}</section>"
    )


def _runs(digests: Sequence[Digest]) -> str:
    """Return a box for each run; one alone needs none."""
    if len(digests) == 1:
        return ""
    boxes = "".join(
        f'<label><input type="checkbox" data-shown="{index}"'
        f"{' checked' if index < _SHOWN else ''}>{name}</label>"
        for index, name in enumerate(run_names(digests))
    )
    return f'<div class="boxes" role="group" aria-label="Runs in the replay">{boxes}</div>'


def _layers(replay: Replay) -> str:
    """Return a box for each part, with what it means."""
    length = f"{100 * ARROW:g} cm"
    parts = {
        "e": ("actual frame e", "thick"),
        "d": ("desired frame d", "long, thin"),
        "c": ("compliant frame c", "pale"),
        "f": ("force f", f"{replay.per_arrow['f']:g} N = {length}"),
        "mu": ("moment mu", f"{replay.per_arrow['mu']:g} Nm = {length}"),
        "path": ("path of the tip", ""),
    }
    boxes = "".join(
        f'<label><input type="checkbox" data-layer="{layer}" checked>'
        f'<span class="layer layer-{layer}"></span>{name}'
        f"{f' <small>({meaning})</small>' if meaning else ''}</label>"
        for layer, (name, meaning) in parts.items()
        if layer in replay.layers or layer in ("e", "path")
    )
    return f'<div class="boxes" role="group" aria-label="Parts of the replay">{boxes}</div>'
