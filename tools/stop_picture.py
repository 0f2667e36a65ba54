"""The picture of docs/stops.md: a halted arm that is leaned on, from its bag.

experiment stops --variant ur5_500 --out out
python tools/stop_picture.py out/stops/ur5_500 docs/stop.webp
"""

import argparse
import io
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from eulerparams_control import analysis
from eulerparams_control.analysis.quantities.contact import force
from eulerparams_control.analysis.static import STYLE

COLOURS = ("#0072b2", "#d55e00", "#1a6b43", "#7a4fa3", "#a07800", "#4d5560", "#c2518f")
LOOK = STYLE | {"font.family": "DejaVu Sans", "font.size": 13, "axes.labelsize": 12}
LOOK |= {"xtick.labelsize": 12, "ytick.labelsize": 12, "axes.titlesize": 13}
LOOK |= {"legend.fontsize": 11}
WIDE, HIGH, DPI = 6.4, 8.2, 130  # [in], [in], [1/in]
LEANS = 1.0  # [N] of a hand that is there


def draw(bag: Path) -> Figure:
    """Return hand, tip, joints and efforts over time."""
    run = analysis.load(bag)
    arm, efforts, (t, f) = run.measured, run.effort, force(run)
    at = np.searchsorted(arm.t, run.stopped)
    q = [f"joint {k + 1}" for k in range(run.robot.n)]
    rows = (
        ("force of the hand [N]", t, f, ("along x", "along y", "along z")),
        ("way of the tip [mm]", arm.t, 1e3 * (arm.p_e - arm.p_e[at]), ("along x", "y", "z")),
        ("joint speeds [rad/s]", arm.t, arm.dq, q),
        ("commanded efforts [Nm]", efforts.t, efforts.tau, q),
    )
    figure = Figure(figsize=(WIDE, HIGH), dpi=DPI, layout="constrained", facecolor="white")
    panels = figure.subplots(len(rows), 1, sharex=True)
    leans = np.linalg.norm(f, axis=1) > LEANS
    for axes, (title, when, values, names) in zip(panels, rows, strict=True):
        axes.fill_between(t, 0, 1, leans, color="0.93", lw=0, transform=axes.get_xaxis_transform())
        axes.axvline(run.stopped, color="black", linewidth=1.0, linestyle=(0, (4, 3)))
        for name, line, colour in zip(names, values.T, COLOURS, strict=False):
            axes.plot(when, line, color=colour, linewidth=1.4, label=name)
        axes.set_title(title, loc="left")
        axes.margins(y=0.12)
    panels[0].annotate(
        "~/halt", (run.stopped, 0.97), (5, 0), xycoords=("data", "axes fraction"),
        textcoords="offset points", va="top",
    )  # fmt: skip
    look = {"handlelength": 0.8, "handletextpad": 0.4, "columnspacing": 0.9}
    panels[0].legend(ncols=3, loc="upper right", **look)
    keys = panels[2].get_legend_handles_labels()
    figure.legend(*keys, loc="outside lower center", ncols=len(q), **look)
    panels[-1].set(xlabel="time [s]", xlim=(0.0, arm.t[-1]))
    return figure


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path, help="of the experiment stops")
    parser.add_argument("picture", type=Path, help="webp or png")
    given = parser.parse_args()
    with mpl.rc_context(LOOK):
        file = io.BytesIO()
        FigureCanvasAgg(draw(given.bag)).print_png(file)
    Image.open(file).convert("RGB").save(given.picture, quality=80, method=6)
    print(f"{given.picture}: {given.picture.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
