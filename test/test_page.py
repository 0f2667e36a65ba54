"""The page: it is whole, says what it should, and trusts nothing that a bag says."""

import base64
import json
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plotly.offline import get_plotlyjs
from synthetic_runs import URDF, recorded

from eulerparams_control.analysis.digest import Approach, Digest
from eulerparams_control.analysis.html import script, viewer
from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.quantities import BY_NAME
from eulerparams_control.analysis.quantities.base import Prediction
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.verdict import Verdict, groups
from eulerparams_control.bags.format import BagFlaw, BagWarning
from eulerparams_control.robot.robot import Robot

EVIL = "</script><script>alert(1)</script>"

MET = Verdict("largest <error>", "calm", "about 5", 5.73, "deg", "< 6", True)
MISSED = Verdict("joint speed", "wild / calm", "", 2.5e8, "", "< 10", False)


def page_of(path: Path, runs: Sequence[Digest | Recording], *args: Any, **options: Any) -> str:
    """Return the page without its libraries, which are checked to be in it."""
    digests = [Digest.of(run) if isinstance(run, Recording) else run for run in runs]
    write_page(path / "page.html", digests, *args, **options)
    text = (path / "page.html").read_text()
    for library in (get_plotlyjs(), viewer()):
        assert len(library) > 500_000
        assert text.count(library) == 1
        text = text.replace(library, "")
    return re.sub(r">\s+<", "><", text)


def figures_of(page: str) -> list[dict[str, Any]]:
    match = re.search(r'<script type="application/json" id="figures">(.*?)</script>', page)
    assert match is not None
    figures: list[dict[str, Any]] = json.loads(match[1])
    return figures


def array(values: Any) -> np.ndarray:
    if isinstance(values, dict):
        return np.frombuffer(base64.b64decode(values["bdata"]), values["dtype"])
    return np.array(values)


def pair(folder: Path) -> list[Recording]:
    """Return two runs: the second jumps for one sample, 1e8 times faster than the first."""
    runs = []
    for name, jump, fastest, k_Po in (("calm", 0.1, 0.5, 100.0), ("wild", 1.5, 5e8, 2.5)):
        q, speed = np.full(9000, 0.1), np.full(9000, 0.5)
        q[4567], speed[4567] = jump, fastest
        parameters = {"k_Po": k_Po, "orientation": "euler_angles"}
        runs.append(recorded(folder / name, q, q, speeds=speed, parameters=parameters))
    return runs


def panels_of(page: str) -> dict[str, list[dict[str, Any]]]:
    """Return the plots below each title: one, or one a component."""
    figures = iter(figures_of(page))
    panels = {}
    for panel in re.findall(r"<figure .*?</figure>", page, re.DOTALL):
        title = re.search(r"<h3>(.*?)</h3>", panel)
        assert title is not None
        panels[title[1]] = [next(figures) for _ in range(panel.count('class="plot"'))]
    assert not list(figures)
    return panels


def titles_of(page: str) -> list[str]:
    """Return the titles of the plots, but for those of components."""
    components = {quantity.title for quantity in BY_NAME.values() if quantity.is_vector}
    return [title for title in panels_of(page) if title not in components]


def figure_of(page: str, title: str) -> dict[str, Any]:
    """Return the only plot below a title."""
    (figure,) = panels_of(page)[title]
    return figure


def components_of(page: str, title: str) -> list[str]:
    """Return the headings of the plots below a title."""
    panel = page[page.index(f"<h3>{title}</h3>") :]
    return re.findall(r"<h4>(.*?)</h4>", panel[: panel.index("</figure>")])


def folded_in(page: str) -> str:
    """Return the parameters in which all runs agree."""
    start = page.index("<details><summary>")
    return page[start : page.index("</details>", start)]


def differing_in(page: str) -> list[tuple[str, list[str]]]:
    """Return the parameters in which runs differ, with their values."""
    rows = re.findall(r'<tr class="differs"><th>(.*?)</th>(.*?)</tr>', page)
    return [(name, re.findall(r"<td.*?>(.*?)</td>", cells)) for name, cells in rows]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("page")
    verdicts = [MET, MISSED]
    return page_of(folder, pair(folder), "The claim (28).", "Wild is off by 85.9 deg.", verdicts)


def test_the_page_loads_nothing(page, tmp_path):
    assert not re.search(r"https?:", page)
    assert not re.search(r"\ssrc\s*=|@import|url\(", page)
    assert not re.search(r"\shref\s*=(?!\"#section-\d+\")", page)
    for word in ("fetch(", "XMLHttpRequest", "WebSocket", "eval(", "import("):
        assert word not in script()
    assert "Content-Security-Policy\" content=\"default-src 'none'" in page
    assert "showSendToCloud: false" in page  # else plotly offers to upload the data


def test_the_page_begins_with_the_sentence_and_the_orientation_error(page):
    heading = re.search(r"<body>\s*<header>\s*<h1>(.*?)</h1>", page)
    assert heading is not None
    assert re.sub("<.*?>", "", heading[1]) == "Wild is off by 85.9 deg."
    assert "The claim (28)." in page
    assert page.index("<h3>Orientation error</h3>") < page.index('id="replay"')
    assert page.index('id="replay"') < page.index("<h2>Criteria</h2>")
    first = figures_of(page)[0]
    assert [trace["name"] for trace in first["data"]] == ["calm", "wild"]
    assert first["layout"]["yaxis"]["title"]["text"] == "orientation error [deg]"


def test_every_verdict_is_on_the_page_if_there_are_any(page, tmp_path):
    text = re.sub(r"<wbr>", "", page)
    assert '<span class="no">1 of 2 criteria met.</span>' in text
    rows = re.findall(r"<tr class=\"group\">(.*?)</tr>", text)
    cells = [re.findall(r"<td.*?>(.*?)</td>", row) for row in rows]
    assert cells == [
        ["largest &lt;error&gt;", "calm", "about 5", "5.73 deg", "&lt; 6", "✓ yes"],
        ["joint speed", "wild / calm", "-", "2.50e8", "&lt; 10", "✗ no"],
    ]
    assert 'data-exact="5.73 deg"' in page  # all digits of what was measured
    assert 'data-exact="250000000"' in page
    assert page.count('class="digits"') >= 1
    without = page_of(tmp_path, pair(tmp_path), "", "")
    assert not re.search("Criteria|criteria met", without)
    assert "<h1>Largest orientation error: " in without


def test_a_criterion_that_one_variant_misses_is_missed():
    missed = replace(MET, variant="wild", measured=9.0, met=False)
    assert [group.met for group in groups([MET, missed])] == [False]
    assert [group.met for group in groups([missed, MET])] == [False]
    assert [group.met for group in groups([MET, replace(MET, variant="wild")])] == [True]


def test_the_peak_of_one_sample_is_drawn_beside_the_calm_run(page):
    error, speed = figures_of(page)[:2]
    calm, wild = (array(trace["y"]) for trace in error["data"])
    assert wild.max() == pytest.approx(np.degrees(1.5), rel=1e-6)
    assert len(wild) < 4000
    assert calm.max() == pytest.approx(np.degrees(0.1), rel=1e-6)
    calm, wild = (array(trace["y"]) for trace in speed["data"])
    assert wild.max() == pytest.approx(5e8)
    axis = speed["layout"]["yaxis"]
    assert axis["type"] == "log"
    low, high = (10**end for end in axis["range"])
    assert low < 0.5 < 5e8 < high
    assert 3 in [shape.get("y0") for shape in speed["layout"]["shapes"]]  # the limit


def test_text_of_a_bag_is_escaped_everywhere(tmp_path):
    evil_folder = EVIL.replace("/", "\\")
    parameters = {EVIL: EVIL, "euler_sequence": "XYZ"}
    run = recorded(tmp_path / evil_folder, [0.1, 0.2], parameters=parameters)
    run = replace(run, warnings=(BagWarning(BagFlaw.DAMAGED, EVIL),), diverged=1.0)
    verdict = Verdict(EVIL, EVIL, EVIL, 1.0, EVIL, EVIL, True)
    text = page_of(tmp_path, [run, run], EVIL, EVIL, [verdict])
    assert "<script>alert" not in text
    assert text.count("alert(1)") >= 9
    for figure in figures_of(text):  # plotly reads its text as HTML, too
        assert all("<script>" not in trace.get("name", "") for trace in figure["data"])


# --- dynamic control -----------------------------------------------------------------------
GAINS = {"orientation": "euler_parameters", "k_Po": 100.0, "k_Vo": 15.0}


def dynamic(folder: Path, efforts: Any, **options: Any) -> Recording:
    """Return a run of dynamic control that goes to rest, with these efforts."""
    q = np.geomspace(1.0, 1e-7, len(efforts))
    return recorded(folder, q, speeds=-q, efforts=efforts, parameters=GAINS, **options)


def test_dynamic_control_shows_its_efforts_and_its_lyapunov_function(tmp_path):
    text = page_of(tmp_path, [dynamic(tmp_path / "run", np.linspace(-3.0, -8.0, 50))], "", "")
    assert titles_of(text) == [
        "Orientation error",
        "Joint speed",
        "Effort",
        "Distance to the representation singularity",
        "Distance to the kinematic singularities",
        "Position error",
        "Lyapunov function",
        "Speed of each joint",
        "Effort of each joint",
    ]
    effort = figure_of(text, "Effort")
    assert array(effort["data"][0]["y"])[[0, -1]].tolist() == [3.0, 8.0]
    assert [shape["y0"] for shape in effort["layout"]["shapes"]] == [10]
    assert effort["layout"]["yaxis"]["range"][1] > 10  # the limit is near
    assert components_of(text, "Effort of each joint") == ["hinge", "roll"]
    joints = panels_of(text)["Effort of each joint"]
    ends = [[array(trace["y"])[[0, -1]].tolist() for trace in joint["data"]] for joint in joints]
    assert ends == [[[3.0, 8.0]], [[0.5, 0.5]]]
    assert {shape["y0"] for joint in joints for shape in joint["layout"]["shapes"]} == {10}
    lyapunov = figure_of(text, "Lyapunov function")
    q = np.geomspace(1.0, 1e-7, 50)
    V_2 = 100.0 * 2 * (1 - np.cos(q / 2)) + q**2 / 2
    np.testing.assert_allclose(array(lyapunov["data"][0]["y"]), V_2, rtol=1e-6, atol=1e-12)
    assert lyapunov["layout"]["yaxis"]["type"] == "log"
    for equation in ("(30)", "(42)", "(38)", "(40)"):
        assert equation in text


def test_parameters_are_compared_between_the_runs_that_have_their_node(tmp_path):
    plane, stiff = {"shape": "plane", "stiffness": 1e3}, {"shape": "plane", "stiffness": 1e5}
    first = GAINS | {"environment": {"plane": plane}}
    other = GAINS | {"environment": {"plane": stiff}, "k_Po": 900.0}
    runs = [recorded(tmp_path / "clik", [1.0], [1.0], parameters=GAINS)]
    for name, parameters in (("soft", first), ("stiff", other)):
        runs.append(recorded(tmp_path / name, [0.1], efforts=[0.0], parameters=parameters))
    text = page_of(tmp_path, runs, "", "")
    assert differing_in(text) == [
        ("nodes", ["/clik", "/dynamic_control", "/dynamic_control"]),
        ("/dynamic_control environment.plane.stiffness", ["", "1000", "100000"]),
        ("/dynamic_control k_Po", ["", "100", "900"]),
    ]
    assert "<th>/dynamic_control environment.plane.shape</th>" in folded_in(text)


def test_joints_of_different_robots_are_named_each(tmp_path):
    runs = [dynamic(tmp_path / name, [3.0, 3.0]) for name in ("one", "other")]
    runs[1] = replace(runs[1], robot=Robot(URDF.replace("hinge", "elbow"), "base", "tip"))
    rigid = URDF.replace('name="roll" type="revolute"', 'name="roll" type="fixed"')
    runs.append(dynamic(tmp_path / "shorter", [3.0, 3.0], urdf=rigid))
    text = page_of(tmp_path, runs, "", "")
    assert components_of(text, "Speed of each joint") == ["hinge / elbow", "roll"]
    joints = panels_of(text)["Speed of each joint"]
    names = [trace["name"] for joint in joints for trace in joint["data"]]
    assert names.count("shorter") == 1
    assert "The robot cannot be drawn: not between base and tip: elbow." in text


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e30, 1e300])
def test_a_run_that_diverged_is_told_and_its_axes_can_be_read(tmp_path, size):
    calm = dynamic(tmp_path / "calm", np.full(99, 5.0))
    q = np.append(np.full(50, 0.1), [size, -size])
    wild = recorded(tmp_path / "wild", q, speeds=q, efforts=q, parameters=GAINS)
    wild = replace(wild, diverged=0.51)
    text = page_of(tmp_path, [calm, wild], "", "")
    assert '<p class="warning">wild diverged at 0.510 s' in text
    assert "calm diverged" not in text
    assert re.search(r"<th>diverged at \[s\]</th><td.*?>-</td><td.*?>0\.510</td>", text)
    axis = figure_of(text, "Effort")["layout"]["yaxis"]
    assert axis["type"] == "log"
    low, high = axis["range"]
    assert low < np.log10(5.0) < high < 13
    assert axis["dtick"] <= 3


# --- predictions, shades, sections -----------------------------------------------------------
def digest_of(folder: Path, **changes: Any) -> Digest:
    run = dynamic(folder, np.linspace(3.0, 8.0, 50))
    return replace(Digest.of(run), **changes)


def test_a_prediction_is_drawn_dashed_and_its_text_stands_above(tmp_path):
    t, y = np.array([0.0, 0.5]), np.array([60.0, 2.0])
    predictions = [
        Prediction("orientation_error", f"by (65) {EVIL}", t, y),
        Prediction("effort", "9.9 Nm by (33)", t, np.array([9.9, 9.9])),
        Prediction("orientation_error", "another", t, y / 2),
    ]
    text = page_of(tmp_path, [digest_of(tmp_path / "run")], "", "", predictions=predictions)
    data = figure_of(text, "Orientation error")["data"]
    assert [trace["line"]["dash"] for trace in data] == ["solid", "dash", "dashdot"]
    assert array(data[1]["x"]).tolist() == [0, 0.5]
    assert array(data[1]["y"]).tolist() == [60, 2]
    assert "legendgroup" not in data[1]  # no button hides it
    panel = text[text.index("<h3>Orientation error</h3>") :].partition("</figure>")[0]
    listed = re.findall(r"</svg>(predicted: .*?)</li>", panel)
    assert listed == [
        "predicted: by (65) &lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;",
        "predicted: another",
    ]
    effort = figure_of(text, "Effort")
    assert len(effort["data"]) == 2
    assert effort["layout"]["yaxis"]["range"][1] > 9.9


def test_both_kinds_of_singularity_are_shaded_each_in_its_own_way(tmp_path):
    runs = [
        digest_of(tmp_path / "a", near_pole=[(0.1, 0.2)], near_singular=[(0.3, 0.4)]),
        digest_of(tmp_path / "b", near_pole=[(0.15, 0.25)]),
    ]
    text = page_of(tmp_path, runs, "", "")
    for figure in figures_of(text):
        shades = [s for s in figure["layout"]["shapes"] if s["type"] == "rect"]
        assert [(s["x0"], s["x1"]) for s in shades] == [(0.1, 0.25), (0.3, 0.4)]
        assert shades[0]["fillcolor"] != shades[1]["fillcolor"]
        assert [s["line"].get("dash") for s in shades] == [None, "dot"]
    assert "within 5 deg of the pole" in text
    assert "near a kinematic singularity" in text
    plain = page_of(tmp_path, [replace(runs[0], near_pole=[], near_singular=[])], "", "")
    assert "Shaded:" not in plain


def test_the_pole_of_each_sequence_is_marked_and_no_note_is_outside(tmp_path):
    approaches = [Approach(0.01, 1e-3, "XYZ"), Approach(0.48, 2e-3, "ZYZ")]
    run = digest_of(tmp_path / "run")
    runs = [replace(run, approach=approach) for approach in approaches]
    runs.append(replace(run, approach=Approach(0.2, math.inf, "XYX")))
    layout = figure_of(page_of(tmp_path, runs, "", ""), "Orientation error")["layout"]
    notes = layout["annotations"]
    assert [note["text"] for note in notes] == [
        "0.0573 deg from the pole of XYZ, at 0.010 s",
        "0.115 deg from the pole of ZYZ, at 0.480 s",
    ]
    assert [note["xanchor"] for note in notes] == ["left", "right"]
    assert len({note["yshift"] for note in notes}) == 2  # on lines of their own
    assert layout["margin"]["t"] >= 14 * 2
    assert [s["x0"] for s in layout["shapes"] if s.get("yref") == "paper"] == [0.01, 0.48]
