"""The three pictures of docs/which_law.md, from the runs of ``make compare``.

python tools/law_pictures.py out/compare docs
"""

import argparse
import io
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from eulerparams_control import analysis
from eulerparams_control.analysis.quantities.springs import work_of_contact
from eulerparams_control.analysis.stacks import angles_between
from eulerparams_control.analysis.static import STYLE
from eulerparams_control.lab.experiments.library.set_points import TWO, between, shaped
from eulerparams_control.laws.rotations import log

RED, GREEN, GREY = "#b03021", "#1a6b43", "#4d5560"
LOOK = STYLE | {"font.family": "DejaVu Sans", "font.size": 13, "axes.labelsize": 13}
LOOK |= {"xtick.labelsize": 12, "ytick.labelsize": 12, "axes.titlesize": 13}
WIDE, DPI = 6.4, 130  # [in], [1/in]


def energy(runs: Path) -> Figure:
    """Draw the work of a hand that guides the tool around the path twice, with both laws."""
    figure, (axes,) = _figure(1, 3.8)
    for name, colour, said, above in (
        ("parameters_twice", GREEN, "2 E' K eps, (60)", True),
        ("shipped_twice", RED, "K 2 eps, as shipped", False),
    ):
        t, work = work_of_contact(analysis.load(runs / "guided_path" / name))
        axes.plot(t, work, color=colour, linewidth=2)
        at = t[-1], work.max() if above else work.min()
        _say(axes, f"{said}: {work[-1]:+.1f} J", at, colour, above)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.set(xlabel="time [s]", ylabel="work of the hand [J]", xlim=(0.0, t[-1]))
    axes.margins(y=0.2)
    axes.set_title("Twice around a path: who gives energy to whom?", loc="left")
    return figure


def tool_down(_runs: Path) -> Figure:
    """Draw where the tool points on the way between two set-points 2 deg apart."""
    figure, all_axes = _figure(2, 3.6)
    by_component = between("rotation_vector", *TWO, np.linspace(0.0, 1.0, 31)[:, None])
    aside = np.cross([0.0, 0.0, 1.0], log(TWO[1] @ TWO[0].T))
    aside /= np.linalg.norm(aside)
    for axes, Rs, colour, said in (
        (all_axes[0], shaped(np.array(TWO))[::10], GREEN, "two set-points, shaped"),
        (all_axes[1], by_component, RED, "rotation vectors by component"),
    ):
        z = np.c_[Rs[:, :, 2] @ aside, Rs[:, 2, 2]]
        for tip in z:
            axes.annotate("", tip, (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": colour})
        most = np.degrees(angles_between(np.broadcast_to(TWO[0], Rs.shape), Rs).max())
        axes.text(0.0, 1.2, f"{said}:\n{most:.0f} deg away", color=colour, ha="center")
        axes.set(xlim=(-1.4, 1.4), ylim=(-1.05, 1.75), aspect="equal")
        axes.axis("off")
    return figure


def screw(runs: Path) -> Figure:
    """Draw the way of the tip from above."""
    figure, (axes,) = _figure(1, 2.9)
    for name, colour, said, above in (
        ("apart", GREEN, "position and orientation apart, (28)", False),
        ("log6", RED, "log6 of the pose", True),
    ):
        run = analysis.load(runs / "screw_path" / name)
        p = run.measured.p_e
        along, off = 1e3 * (p - p[0])[:, [1, 0]].T
        axes.plot(along, off, color=colour, linewidth=2)
        far = analysis.measure("off_line", run, of="measured")
        highest = 0.0 if name == "apart" else off.max()
        _say(axes, f"{said}: {far:.1f} mm", (150.0, highest), colour, above, "center")
    axes.plot(0.0, 0.0, "o", along[-1], 0.0, "o", color=GREY)
    axes.set(xlabel="along the line [mm]", ylabel="off the line [mm]", aspect="equal")
    axes.set(xlim=(-15.0, 315.0), ylim=(-25.0, 90.0))
    axes.set_title("The tip on 0.3 m with a turn of 90 deg, from above", loc="left")
    return figure


def _say(
    axes: Axes, text: str, at: tuple[float, float], colour: str, above: bool, ha: str = "right"
) -> None:
    """Write a text at a point, above or below it."""
    off, side = ((0, 8), "bottom") if above else ((0, -8), "top")
    axes.annotate(text, at, off, textcoords="offset points", color=colour, ha=ha, va=side)


def _figure(columns: int, high: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(WIDE, high), dpi=DPI, layout="constrained", facecolor="white")
    return figure, list(figure.subplots(1, columns, squeeze=False).flat)


def main() -> None:
    """Draw them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, help="the folder of make compare")
    parser.add_argument("folder", type=Path, help="where the pictures go")
    given = parser.parse_args()
    with mpl.rc_context(LOOK):
        for draw in (energy, tool_down, screw):
            file = io.BytesIO()
            FigureCanvasAgg(draw(given.runs)).print_png(file)
            picture = given.folder / f"law_{draw.__name__}.webp"
            Image.open(file).convert("RGB").save(picture, quality=80, method=6)
            print(f"{picture}: {picture.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
