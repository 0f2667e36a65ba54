"""A soak as one page, which loads nothing: its criteria, its plots, what happened."""

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eulerparams_control.analysis.labels import COLOURS
from eulerparams_control.analysis.static_image import STYLE, svg
from eulerparams_control.lab.experiments.html import cells, mark, page, picture, table
from eulerparams_control.lab.soak.record import SoakRecord
from eulerparams_control.lab.soak.summary import causes, cpu_of, sentence
from eulerparams_control.lab.soak.verdict import SoakVerdict, growth, longest

_SIZE = (7.4, 2.8)  # [in]
_STYLES = ("-", "--", ":", "-.")
_NONE = "nothing was measured"


def write_page(path: Path, record: SoakRecord, verdicts: Sequence[SoakVerdict]) -> None:
    """Write the page."""
    title = sentence(record, verdicts)
    path.write_text(page("Soak", _body(title, record, verdicts)), encoding="utf-8")


def _body(title: str, record: SoakRecord, verdicts: Sequence[SoakVerdict]) -> list[str]:
    plan = record.plan
    criteria = [
        _row((v.text, v.of, v.measured, v.bound)) + cells([mark(v.met)]) for v in verdicts
    ]
    return [
        f"<h1>{escape(title)}</h1>",
        '<p class="soft">Each controller with a robot, a reference and a namespace of its own, in '
        f"real time at {plan.rate:g} Hz, after {plan.warm_up:g} s of warm-up. A round trip is from "
        "the publication of joint_states to the receipt of the command of the same stamp.</p>",
        "<section><h2>What must hold</h2>",
        table(("criterion", "of", "measured", "bound", ""), criteria),
        "</section><section><h2>Round trip</h2>",
        picture(_figure(record, _draw_latency, "ms"), _NONE),
        "</section><section><h2>Memory beyond that at the end of the warm-up</h2>",
        picture(_figure(record, _draw_memory, "MiB"), _NONE),
        _processes(record),
        "</section><section><h2>States without a command</h2>",
        table(("why", "states"), [_row((k, str(n))) for k, n in causes(record).most_common()]),
        "</section><section><h2>What was said and done</h2>",
        table(("s", "who", "what"), [_row((f"{e.t:.1f}", e.who, e.what)) for e in record.events]),
        f'<p class="soft">The clock of the machine was set {record.clock_steps} times; the monitor '
        f"did not look for {1e3 * record.monitor_gap:.0f} ms at most; the bag has "
        f"{record.bag_megabytes:.1f} MB.</p></section>",
    ]  # fmt: skip


def _row(texts: Sequence[str]) -> str:
    return cells(map(escape, texts))


def _processes(record: SoakRecord) -> str:
    rows = []
    for life in longest(record):
        last, grown = life.samples[-1][1], growth(life, record.plan.warm_up)
        numbers = (last.rss, last.uss, 100 * grown, cpu_of(life))
        rows.append(_row((life.name, *(f"{number:.2f}" for number in numbers))))
    return table(("node", "RSS [MiB]", "USS [MiB]", "growth [%]", "CPU [% of a core]"), rows)


def _figure(record: SoakRecord, draw: Callable[[Axes, SoakRecord], None], unit: str) -> str:
    """Return a figure over the minutes as SVG without a ground of its own."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=_SIZE, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        draw(axes, record)
        axes.set_xlabel("time after the warm-up [min]")
        axes.set_ylabel(f"[{unit}]")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    figure.patch.set_visible(False)
    axes.patch.set_visible(False)
    return svg(figure)


def _draw_latency(axes: Axes, record: SoakRecord) -> None:
    for (controller, pages), colour in zip(record.pages.items(), COLOURS, strict=False):
        times = [(p.begin + p.end) / 120 for p in pages]
        for percent, style in ((50, ":"), (99, "-")):
            values = [1e3 * p.latencies.percentile(percent) for p in pages]
            axes.plot(times, values, style, color=colour, label=f"{controller} p{percent}")
    axes.set_yscale("log")
    axes.axvline(0, color="0.6", linewidth=0.8)


def _draw_memory(axes: Axes, record: SoakRecord) -> None:
    for index, life in enumerate(longest(record)):
        later = [(t, u) for t, u in life.samples if t >= 0]
        if not later:
            continue
        start = later[0][1].rss
        style = _STYLES[index // len(COLOURS) % len(_STYLES)]
        axes.plot(
            [t / 60 for t, _ in later],
            [u.rss - start for _, u in later],
            style,
            color=COLOURS[index % len(COLOURS)],
            label=life.name,
        )
