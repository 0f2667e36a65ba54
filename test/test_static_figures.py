"""Static figures: every quantity that was recorded, the same bytes each time, text as it is."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from synthetic_runs import write_run

from eulerparams_control.analysis.digest import Curve, Digest
from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.quantities import BY_NAME
from eulerparams_control.analysis.quantities.base import Prediction
from eulerparams_control.analysis.static import (
    plain,
    quantity_figure,
    svg,
    write_figures,
)

FORCE = BY_NAME["f"]
ORIENTATION_ERROR, POSITION_ERROR = BY_NAME["orientation_error"], BY_NAME["position_error"]
JOINT_SPEED, JOINT_SPEEDS = BY_NAME["joint_speed"], BY_NAME["joint_speeds"]

T = np.linspace(0.0, 1.99, 200)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Digest:
    """A rod that swings by 0.1 rad, and a contact force of (1, 2, 3) N (1 + t)."""
    angles = 0.1 * np.sin(3 * T)
    wrenches = np.outer(1 + T, [1.0, 2.0, 3.0, 0.1, 0.0, 0.0])
    folder = tmp_path_factory.mktemp("run") / "swing"
    write_run(folder, angles, speeds=0.3 * np.cos(3 * T), wrenches=wrenches)
    return Digest.of(load(folder))


def with_curve(run: Digest, name: str, *columns: np.ndarray, **other: Any) -> Digest:
    curves = [Curve(np.linspace(0.0, 1.99, len(y)), y) for y in columns]
    return replace(run, curves={**run.curves, name: curves}, **other)


def lines_of(figure: Figure) -> list[list[np.ndarray]]:
    return [[np.asarray(line.get_ydata()) for line in axes.lines] for axes in figure.axes]


def texts_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_each_quantity_that_was_recorded_has_one_file_a_format(run, tmp_path):
    files = write_figures(tmp_path / "new" / "figures", [run], ("svg",))
    assert {file.name for file in files} == {f"{name}.svg" for name in run.curves}
    few = {name: run.curves[name] for name in ("f", "joint_speeds", "orientation_error")}
    files = write_figures(tmp_path, [replace(run, curves=few)], ("svg", "png", "pdf"))
    assert {file.name for file in files} == {f"{n}.{e}" for n in few for e in ("svg", "png", "pdf")}
    starts = {".svg": b"<svg", ".png": b"\x89PNG", ".pdf": b"%PDF"}
    for file in files:
        assert file.read_bytes().startswith(starts[file.suffix])


def test_the_curves_of_a_figure_are_those_of_the_digest(run):
    (drawn,) = lines_of(quantity_figure([run], ORIENTATION_ERROR))
    (curve,) = run.curves["orientation_error"]
    assert np.allclose(drawn[0], curve.y, atol=1e-4)  # clipped at a decade below the axis
    assert np.abs(drawn[0]).max() == pytest.approx(np.degrees(0.1), rel=1e-2)


def test_a_vector_has_three_axes_of_the_same_scale_that_share_time(run):
    figure = quantity_figure([run], FORCE)
    lines = [axes.lines[0] for axes in figure.axes]
    now = [float(np.interp(1.0, line.get_xdata(), line.get_ydata())) for line in lines]
    assert now == pytest.approx([np.interp(1.0, *curve) for curve in run.curves["f"]])
    assert now[1] == pytest.approx(4.0)  # along the hinge: in the tip as in the base
    first, *others = figure.axes
    assert all(axes.get_shared_x_axes().joined(first, axes) for axes in others)
    lengths = [float(np.ptp(axes.get_ylim())) for axes in figure.axes]
    assert lengths == pytest.approx(lengths[:1] * 3)
    joints = quantity_figure([run], JOINT_SPEEDS).axes
    assert [axes.get_title("left") for axes in joints] == ["hinge", "roll"]


@pytest.mark.parametrize("name", ["$a_{x$", r"\frac{", "<b>&amp;", "a\x01b", "日本"])
def test_the_name_of_a_run_is_text_whatever_it_is(run, name, tmp_path):
    named = replace(run, path=tmp_path / name)
    figure = quantity_figure([named], ORIENTATION_ERROR)
    assert texts_of(figure)[0] == plain(name)
    ElementTree.fromstring(svg(figure))


@pytest.mark.parametrize(
    ("quantity", "value"),
    [
        *((JOINT_SPEED, value) for value in (1e25, 1e300, np.inf, np.nan, -1e300)),
        *((quantity, value) for quantity in (FORCE, POSITION_ERROR) for value in (1e300, np.nan)),
    ],
)
def test_a_divergence_breaks_no_figure(run, quantity, value):
    columns = [np.where(T > 1.5, value, 0.1 + T)] * (3 if quantity is FORCE else 1)
    wild = with_curve(run, quantity.name, *columns)
    figure = quantity_figure([run, wild], quantity)
    ElementTree.fromstring(svg(figure))
    drawn = np.concatenate([y for lines in lines_of(figure) for y in lines])
    assert np.abs(drawn[np.isfinite(drawn)]).max() < 1e14
    assert figure.axes[0].get_ylim()[1] < 1e13


def test_what_theory_says_is_dashed_and_named(run):
    theory = [
        Prediction("orientation_error", "by (28) $", T, np.full(200, 7.0)),
        Prediction("position_error", "another", T, T),
    ]
    figure = quantity_figure([run], ORIENTATION_ERROR, theory)
    (drawn,) = lines_of(figure)
    assert len(drawn) == 2
    assert np.all(drawn[1] == 7.0)
    assert figure.axes[0].get_ylim()[1] > 7.0
    assert figure.axes[0].lines[1].is_dashed()
    assert "by (28) $" in texts_of(figure)
    assert "another" not in texts_of(figure)
    of_two = Prediction("f", "(52)", T, np.stack([T, 2 * T], axis=1))  # of each its component
    drawn = lines_of(quantity_figure([run], FORCE, [of_two]))
    assert [len(lines) for lines in drawn] == [2, 2, 1]
    assert np.array_equal(drawn[1][1], 2 * T)


def test_the_time_near_either_singularity_is_shaded_so_that_they_differ(run):
    near = replace(run, near_pole=[(0.2, 0.4), (0.3, 0.5)], near_singular=[(1.0, 1.5)])
    figure = quantity_figure([near], ORIENTATION_ERROR)
    axes = figure.axes[0]
    times = axes.transData.inverted()
    spans = [
        (*times.transform_bbox(shade.get_extents()).intervalx, bool(shade.get_hatch()))
        for shade in axes.patches
    ]
    assert sorted(spans) == [
        pytest.approx((0.2, 0.5, False)),  # merged: laid over each other they would be darker
        pytest.approx((1.0, 1.5, True)),
    ]
    assert texts_of(figure)[1:] == ["near the pole of XYZ", "near a kinematic singularity"]
