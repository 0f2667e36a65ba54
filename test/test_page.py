"""The page: it is whole, says what it should, and trusts nothing that a bag says."""

import base64
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from plotly.offline import get_plotlyjs
from synthetic_runs import URDF, write_run

from eulerparams_control.analysis.page import figures_json, write_page
from eulerparams_control.analysis.plots import Panel
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.experiments.criteria import Verdict
from eulerparams_control.robot import Robot

EVIL = "</script><script>alert(1)</script>"
MAX_BYTES = 8_000_000

MET = Verdict("largest <error>", "calm", "about 5", 5.73, "deg", "< 6", True)
MISSED = Verdict("joint speed", "wild / calm", "", 2.5e8, "", "< 10", False)


def page_of(path: Path, runs: list[Recording], *args: Any) -> str:
    """Return the page without plotly.js, which is checked to be in it."""
    write_page(path / "page.html", runs, *args)
    text = (path / "page.html").read_text()
    assert text.count(get_plotlyjs()) == 1
    return text.replace(get_plotlyjs(), "")


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
    calm, wild = np.full(9000, 0.1), np.full(9000, 0.1)
    wild[4567] = 1.5
    speed = np.full(9000, 0.5)
    fast = speed.copy()
    fast[4567] = 5e8
    parameters: dict[str, Any] = {"k_Po": 100.0, "orientation": "euler_angles"}
    paths = [
        write_run(folder / "calm", calm, calm, speeds=speed, parameters=parameters),
        write_run(folder / "wild", wild, wild, speeds=fast, parameters={**parameters, "k_Po": 2.5}),
    ]
    return [Recording.load(path) for path in paths]


def figure_of(page: str, title: str) -> dict[str, Any]:
    """Return the plot below a title."""
    titles = re.findall(r"<h3>(.*?)</h3>", page)
    return figures_of(page)[titles.index(title)]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("page")
    verdicts = [MET, MISSED]
    return page_of(folder, pair(folder), "The claim (28).", "Wild is off by 85.9 deg.", verdicts)


def test_the_page_loads_nothing(page: str, tmp_path: Path) -> None:
    assert not re.search(r"https?:", page)
    assert not re.search(r"\s(src|href)\s*=|@import|url\(", page)
    assert "Content-Security-Policy\" content=\"default-src 'none'" in page
    assert "showSendToCloud: false" in page  # else plotly offers to upload the data


def test_the_page_is_small(tmp_path: Path) -> None:
    runs = pair(tmp_path) * 20
    write_page(tmp_path / "page.html", runs, "", "")
    assert (tmp_path / "page.html").stat().st_size < MAX_BYTES


def test_the_page_begins_with_the_sentence_and_the_orientation_error(page: str) -> None:
    heading = re.search(r"<body>\s*<header>\s*<h1>(.*?)</h1>", page)
    assert heading is not None
    assert re.sub("<.*?>", "", heading[1]) == "Wild is off by 85.9 deg."
    assert "The claim (28)." in page
    assert page.index("<h3>Orientation error</h3>") < page.index("<h2>Criteria</h2>")
    first = figures_of(page)[0]
    assert [trace["name"] for trace in first["data"]] == ["calm", "wild"]
    assert first["layout"]["yaxis"]["title"]["text"] == "orientation error [deg]"


def test_every_verdict_is_on_the_page(page: str) -> None:
    text = re.sub(r"<wbr>", "", page)
    assert '<span class="no">1 of 2 criteria met.</span>' in text
    rows = re.findall(r"<tr class=\"group\">(.*?)</tr>", text)
    cells = [re.findall(r"<td.*?>(.*?)</td>", row) for row in rows]
    assert cells == [
        ["largest &lt;error&gt;", "calm", "about 5", "5.73 deg", "&lt; 6", "✓ yes"],
        ["joint speed", "wild / calm", "-", "2.50e8", "&lt; 10", "✗ no"],
    ]


def test_without_verdicts_there_are_no_criteria(tmp_path: Path) -> None:
    text = page_of(tmp_path, pair(tmp_path), "", "")
    assert "Criteria" not in text
    assert "criteria met" not in text
    assert "<h1>Largest orientation error: " in text


def test_the_peak_of_one_sample_is_drawn_beside_the_calm_run(page: str) -> None:
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


def test_a_run_has_one_colour_and_one_time_axis_everywhere(page: str) -> None:
    figures = figures_of(page)
    colours = {
        (trace["legendgroup"], trace.get("line", trace.get("marker"))["color"])
        for figure in figures
        for trace in figure["data"]
    }
    assert len(figures) == 7
    assert len(colours) == len({run for run, _ in colours}) == len({c for _, c in colours}) == 2
    ranges = {
        tuple(axis["range"])
        for figure in figures
        for name, axis in figure["layout"].items()
        if name.startswith("xaxis")
    }
    assert ranges == {(0.0, 89.99)}


def test_the_limits_of_the_joints_are_drawn(page: str) -> None:
    shapes = figures_of(page)[1]["layout"]["shapes"]
    assert 3 in [shape.get("y0") for shape in shapes]


def test_the_time_near_the_pole_is_shaded_and_the_closest_approach_marked(page: str) -> None:
    layout = figures_of(page)[0]["layout"]
    bands = [(shape["x0"], shape["x1"]) for shape in layout["shapes"] if "fillcolor" in shape]
    assert bands == [(45.67, 45.67)]
    assert [note["text"] for note in layout["annotations"]] == [
        "4.06 deg from the pole of XYZ, at 45.670 s"
    ]


def test_parameters_that_differ_are_highlighted_and_the_others_folded(page: str) -> None:
    differing = re.findall(r'<tr class="differs"><th>(.*?)</th>(.*?)</tr>', page)
    assert [name for name, _ in differing] == ["/clik k_Po"]
    assert re.findall(r"<td.*?>(.*?)</td>", differing[0][1]) == ["100", "2.5"]
    folded = page[page.index("<details>") : page.index("</details>")]
    assert "<th>/clik orientation</th>" in folded
    assert "k_Po" not in folded


def test_text_of_a_bag_is_escaped_everywhere(tmp_path: Path) -> None:
    evil_folder = EVIL.replace("/", "\\")
    parameters = {EVIL: EVIL, "euler_sequence": "XYZ"}
    run = Recording.load(write_run(tmp_path / evil_folder, [0.1, 0.2], parameters=parameters))
    run = replace(run, warning=EVIL, diverged=1.0)
    verdict = Verdict(EVIL, EVIL, EVIL, 1.0, EVIL, EVIL, True)
    text = page_of(tmp_path, [run, run], EVIL, EVIL, [verdict])
    assert "<script>alert" not in text
    assert text.count("alert(1)") >= 9
    for figure in figures_of(text):  # plotly reads its text as HTML, too
        assert all("<script>" not in trace.get("name", "") for trace in figure["data"])


def test_the_json_of_the_plots_cannot_end_its_script_element() -> None:
    panel = Panel("", "", go.Figure(layout={"title": {"text": EVIL}}), 300)
    text = figures_json([panel])
    assert "<" not in text
    assert json.loads(text)[0]["layout"]["title"]["text"] == EVIL


def test_a_bag_with_joint_states_only_has_a_page(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "real", [0.1, 0.2], speeds=[1.0, 1.0], desired=False)
    text = page_of(tmp_path, [Recording.load(folder, tip_frame="tip")], "", "")
    assert re.findall(r"<h3>(.*?)</h3>", text) == [
        "Joint speed",
        "Distance to the representation singularity",
        "Distance to the kinematic singularities",
        "Speed of each joint",
    ]
    assert "None recorded." in text


# --- dynamic control -----------------------------------------------------------------------

GAINS = {"orientation": "euler_parameters", "k_Po": 100.0, "k_Vo": 15.0}


def dynamic(folder: Path, efforts: Any, **options: Any) -> Recording:
    """Return a run of dynamic control that goes to rest, with these efforts."""
    q = np.geomspace(1.0, 1e-7, len(efforts))
    return Recording.load(
        write_run(folder, q, speeds=-q, efforts=efforts, parameters=GAINS, **options)
    )


def test_a_run_of_dynamic_control_shows_its_efforts_and_its_lyapunov_function(
    tmp_path: Path,
) -> None:
    text = page_of(tmp_path, [dynamic(tmp_path / "run", np.linspace(3.0, 8.0, 50))], "", "")
    assert re.findall(r"<h3>(.*?)</h3>", text) == [
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
    lyapunov = figure_of(text, "Lyapunov function")
    q = np.geomspace(1.0, 1e-7, 50)
    V_2 = 100.0 * 2 * (1 - np.cos(q / 2)) + q**2 / 2
    np.testing.assert_allclose(array(lyapunov["data"][0]["y"]), V_2, rtol=1e-6, atol=1e-12)
    assert lyapunov["layout"]["yaxis"]["type"] == "log"
    for equation in ("(30)", "(42)", "(38)", "(40)"):
        assert equation in text


def test_the_axis_of_v_is_logarithmic_however_little_v_changes(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", [0.2, 0.1], [0.2, 0.1], parameters=GAINS)
    text = page_of(tmp_path, [Recording.load(folder)], "", "")
    assert figure_of(text, "Lyapunov function")["layout"]["yaxis"]["type"] == "log"
    assert figure_of(text, "Orientation error")["layout"]["yaxis"]["type"] == "linear"


def test_the_effort_of_each_joint_has_its_plot(tmp_path: Path) -> None:
    text = page_of(tmp_path, [dynamic(tmp_path / "run", [3.0, -8.0])], "", "")
    joints = figure_of(text, "Effort of each joint")
    assert [array(trace["y"]).tolist() for trace in joints["data"]] == [[3.0, 8.0], [0.5, 0.5]]
    assert [note["text"] for note in joints["layout"]["annotations"]] == ["hinge", "roll"]
    assert {shape["y0"] for shape in joints["layout"]["shapes"]} == {10}


def test_a_run_without_efforts_has_no_line_among_those_of_one_that_has_some(
    tmp_path: Path,
) -> None:
    kinematic = Recording.load(
        write_run(tmp_path / "clik", [1.0, 0.5], [1.0, 0.5], parameters=GAINS)
    )
    text = page_of(tmp_path, [kinematic, dynamic(tmp_path / "dynamic", [3.0, -8.0])], "", "")
    for title in ("Effort", "Effort of each joint"):
        names = {trace["name"] for trace in figure_of(text, title)["data"]}
        assert names == {"dynamic"}
    assert {trace["name"] for trace in figure_of(text, "Servo")["data"]} == {"clik"}
    assert len(figure_of(text, "Lyapunov function")["data"]) == 2


def test_parameters_are_compared_between_the_runs_that_have_their_node(tmp_path: Path) -> None:
    kinematic = Recording.load(write_run(tmp_path / "clik", [1.0], [1.0], parameters=GAINS))
    soft = dynamic(tmp_path / "soft", [3.0, 3.0])
    stiff = Recording.load(
        write_run(tmp_path / "stiff", [0.1], efforts=[0.0], parameters=GAINS | {"k_Po": 900.0})
    )
    text = page_of(tmp_path, [kinematic, soft, stiff], "", "")
    differing = re.findall(r'<tr class="differs"><th>(.*?)</th>(.*?)</tr>', text)
    assert [(name, re.findall(r"<td.*?>(.*?)</td>", cells)) for name, cells in differing] == [
        ("nodes", ["/clik", "/dynamic_control", "/dynamic_control"]),
        ("/dynamic_control k_Po", ["", "100", "900"]),
    ]


def test_parameters_in_groups_are_compared_one_by_one(tmp_path: Path) -> None:
    plane = {"shape": "plane", "stiffness": 1e3}
    runs = [
        Recording.load(
            write_run(tmp_path / name, [0.1], parameters={"environment": {"plane": keys}})
        )
        for name, keys in (("soft", plane), ("stiff", plane | {"stiffness": 1e5}))
    ]
    text = page_of(tmp_path, runs, "", "")
    differing = re.findall(r'<tr class="differs"><th>(.*?)</th>(.*?)</tr>', text)
    assert [(name, re.findall(r"<td.*?>(.*?)</td>", cells)) for name, cells in differing] == [
        ("/clik environment.plane.stiffness", ["1000", "100000"])
    ]
    folded = text[text.index("<details>") : text.index("</details>")]
    assert "<th>/clik environment.plane.shape</th>" in folded


def test_joints_of_different_robots_are_named_each(tmp_path: Path) -> None:
    runs = [dynamic(tmp_path / name, [3.0, 3.0]) for name in ("one", "other")]
    runs[1] = replace(runs[1], robot=Robot(URDF.replace("hinge", "elbow"), "base", "tip"))
    rigid = URDF.replace('name="roll" type="revolute"', 'name="roll" type="fixed"')
    runs.append(dynamic(tmp_path / "shorter", [3.0, 3.0], urdf=rigid))
    joints = figure_of(page_of(tmp_path, runs, "", ""), "Speed of each joint")
    titles = [note["text"] for note in joints["layout"]["annotations"]]
    assert titles == ["hinge / elbow", "roll"]
    assert [trace["name"] for trace in joints["data"]].count("shorter") == 1


# --- runs beyond all numbers ---------------------------------------------------------------


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e30, 1e300])
def test_the_page_of_a_run_that_diverged_says_so_and_its_axes_can_be_read(
    tmp_path: Path, size: float
) -> None:
    calm = dynamic(tmp_path / "calm", np.full(99, 5.0))
    q = np.append(np.full(50, 0.1), [size, -size])
    path = write_run(tmp_path / "wild", q, speeds=q, efforts=q, parameters=GAINS)
    wild = replace(Recording.load(path), diverged=0.51)
    text = page_of(tmp_path, [calm, wild], "", "")
    assert '<p class="warning">wild diverged at 0.510 s' in text
    assert "calm diverged" not in text
    assert re.search(r"<th>diverged at \[s\]</th><td.*?>-</td><td.*?>0\.510</td>", text)
    axis = figure_of(text, "Effort")["layout"]["yaxis"]
    assert axis["type"] == "log"
    low, high = axis["range"]
    assert low < np.log10(5.0) < high < 13
    assert axis["dtick"] <= 3


def test_a_page_of_runs_that_did_not_diverge_does_not_speak_of_it(page: str) -> None:
    assert "diverged" not in page
