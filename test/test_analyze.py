"""The options of analyze, what it writes, and the same as a library."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from synthetic_runs import URDF, arms_together, recorded, write_run
from tolerances import assert_close

from eulerparams_control import analysis
from eulerparams_control.analysis import Digest
from eulerparams_control.analysis.export import file_name
from eulerparams_control.analysis.main import main
from eulerparams_control.laws.rotations import exp
from eulerparams_control.motion.frames import DesiredFrame

Q = [0.8 * math.sin(0.03 * k) for k in range(500)]
NODE = {"orientation": "euler_parameters", "k_Po": 10.0, "damping_eps": 0.5}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("analyze") / "swing"
    wrenches = [[0.1 * k, 0.0, 1.0, 0.0, 0.0, 0.1] for k in range(500)]
    frames = [DesiredFrame(np.array([1.0, 0.0, 1e-5 * k]), np.eye(3)) for k in range(500)]
    command = [1.01 * q for q in Q]
    return write_run(folder, Q, command, wrenches=wrenches, compliant=frames, parameters=NODE)


type Analyze = Callable[..., tuple[int, str]]


@pytest.fixture
def analyze(capsys: pytest.CaptureFixture[str]) -> Analyze:
    """The executable: its exit code and what it printed."""
    return lambda *args: (main(list(map(str, args))), capsys.readouterr().out)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_the_export_is_the_table(bag, tmp_path, analyze, suffix):
    code, out = analyze(bag, "--no-page", "--export", suffix, "--out", tmp_path / "p.html")
    assert code == 0
    assert f"The table: {tmp_path / f'swing.{suffix}'}" in out
    read = pyarrow.csv.read_csv if suffix == "csv" else pyarrow.parquet.read_table
    found = read(str(tmp_path / f"swing.{suffix}"))
    expected = analysis.columns(analysis.load(bag))
    assert set(expected) <= set(found.column_names)
    stamps = [1_700_000_000_000_000_000 + 10_000_000 * k for k in range(500)]
    assert found.column("stamp [ns]").to_pylist() == stamps
    for name in set(found.column_names) - set(expected) - {"stamp [ns]"}:
        assert found.column(name).null_count == len(Q), name
    for name, values in expected.items():
        column = np.array(found.column(name).to_pylist(), dtype=float)
        np.testing.assert_array_equal(column, values, err_msg=name)
    angles = np.degrees(np.abs([1.01 * q for q in Q]))
    assert_close(expected["orientation_error [deg]"], angles, 1e-9)
    assert expected["q.hinge [rad]"].tolist() == Q
    for name in ("error_rotation_vector.y [deg]", "lyapunov", "force [N]", "p_cd_d.z [mm]"):
        assert np.isfinite(expected[name]).any()


def test_near_a_kinematic_singularity_is_where_the_controller_damps(tmp_path):
    """The smallest singular value of the rod is 1 everywhere."""
    for eps, near in ((0.9, []), (1.1, [(0.0, 0.04)])):
        path = write_run(tmp_path / f"run_{eps}", [0.1] * 5, parameters=NODE | {"damping_eps": eps})
        assert Digest.of(analysis.load(path)).near_singular == near


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("missing",), "missing"),
        (("swing", "--tip-frame", "tpi"), "unknown frame 'tpi' (did you mean 'tip'?)"),
        (("swing", "--urdf", "missing.urdf"), "cannot read the URDF missing.urdf"),
        (("swing", "--out", "swing"), "cannot write the page swing"),
        (("swing", "--from", "3", "--to", "2"), "--from 3 --to 2: expected a time before the end"),
        (("swing", "--from", "90"), "no joint_states from 90 to inf s"),
        (("swing", "--from", "0.501", "--to", "0.509"), "no joint_states from 0.501 to 0.509 s"),
    ],
)
def test_an_error_is_one_line_at_the_end_and_code_2(bag, monkeypatch, analyze, args, message):
    monkeypatch.chdir(bag.parent)
    code, out = analyze(*args)
    assert code == 2
    (error,) = [line for line in out.splitlines() if line.startswith("error: ")]
    assert out.splitlines()[-1] == error
    assert message in error


@pytest.mark.parametrize("args", [("--from", "-1"), ("--to", "nan"), ("--topic", "joint_states")])
def test_impossible_options_are_refused(bag, capsys, args):
    with pytest.raises(SystemExit) as ended:
        main([str(bag), *args])
    assert ended.value.code == 2
    assert "expected" in capsys.readouterr().err


def test_all_arms_of_a_bag_are_shown_or_the_one_named(tmp_path, analyze):
    arms = {f"/{s}": write_run(tmp_path / s, [q] * 5) for s, q in (("left", 0.1), ("right", 0.2))}
    both = arms_together(tmp_path / "both", arms)
    code, out = analyze(both, "--out", tmp_path / "page.html", "--export", "csv")
    assert code == 0
    assert re.search(r"orientation error, peak \[deg\] *│ *5\.73 │ *11\.5 │", out)
    assert {f.name for f in tmp_path.glob("*.csv")} == {"both_left.csv", "both_right.csv"}
    code, out = analyze(both, "--no-page", "--namespace", "right")
    assert re.search(r"orientation error, peak \[deg\] *│ *11\.5 │", out)
    code, out = analyze(both, "--no-page", "--namespace", "/middle")
    assert code == 2
    assert "has the arms /left, /right" in out


def test_a_broken_bag_does_not_hide_the_others(bag, tmp_path, analyze):
    (tmp_path / "broken.mcap").write_bytes(b"no bag at all")
    code, out = analyze(tmp_path / "broken.mcap", bag, "--no-page")
    assert code == 2
    assert "expected an MCAP file" in out
    assert re.search(r"orientation error, peak \[deg\] *│ *46\.", out)


def test_a_bag_of_another_recorder_needs_a_urdf_and_a_tip_and_shows_what_it_has(tmp_path, analyze):
    bag = write_run(tmp_path / "run", [0.1, 0.2], speeds=[2.0, 1.0], desired=False, urdf="")
    (tmp_path / "arm.urdf").write_text(URDF)
    code, _ = analyze(bag, "--no-page")
    assert code == 2
    urdf = ("--urdf", tmp_path / "arm.urdf")
    code, out = analyze(bag, "--no-page", *urdf)
    assert code == 2
    assert "give it with --tip-frame" in out
    page = tmp_path / "page.html"
    code, out = analyze(bag, "--out", page, *urdf, "--tip-frame", "tip")
    assert code == 0
    assert re.search(r"joint speed, peak \[rad/s\] *│ *2\.00 │", out)
    for title in ("orientation error", "measured", "effort", "servo lag", "diverged"):
        assert title not in out
    text = page.read_text()
    assert "None recorded." in text
    titles = re.findall("<h3>(.*?)</h3>", text)
    assert titles[:2] == ["Joint speed", "Distance to the representation singularity"]
    assert "Speed of each joint" in titles
    assert not [title for title in titles if "error" in title or "Effort" in title]


def test_the_numbers_of_runs_of_each_kind_are_shown_and_the_path_of_the_page(tmp_path, analyze):
    q, speeds, page = [0.0, 0.3, -0.5, 0.2], [0.0, -2.0, 1.0, 0.5], tmp_path / "new" / "page.html"
    efforts = [3.0, -10.0, 10.0, 7.0]  # the limit is 10 Nm
    clik = write_run(tmp_path / "clik", q, [0.0, 0.1, -0.4, 0.1], speeds=speeds)
    dynamic = write_run(tmp_path / "dynamic", q, speeds=speeds, efforts=efforts)
    code, out = analyze(clik, dynamic, "--out", page)
    assert code == 0
    for row in (
        r"orientation error, peak \[deg\] *│ *22\.9 │ *28\.6 │",
        r"  measured, peak \[deg\] *│ *28\.6 │ *- │",
        r"servo lag, largest \[deg\] *│ *11\.5 ",
        r"closest to pole of XYZ \[deg\] *│ *67\.1 ",
        r"effort, peak \[Nm\] *│ *- │ *10\.0 │",
        r"time at an effort limit \[s\] *│ *- │ *0\.0200 │",
    ):
        assert re.search(row, out), row
    assert out.rstrip().endswith(f"The page: {page}")
    assert page.is_file()


def test_contact_and_motion_loop_are_shown_where_they_are(tmp_path, analyze):
    felt = [[0, 0, 20, 0, 0, 0], [3, 4, 0, 0, 0, 2]]
    frames = [
        DesiredFrame(np.array([1.0 + x, 0.0, 0.0]), exp(np.array([0.0, turn, 0.0])))
        for x, turn in ((0.0, 0.0), (0.01, -0.4))
    ]
    contact = write_run(tmp_path / "contact", [0.0, -0.3], compliant=frames, wrenches=felt)
    free = write_run(tmp_path / "free", [0.1, 0.2], wrenches=[[0.0] * 6] * 2)
    code, out = analyze(contact, free, "--no-page")
    assert code == 0
    for row, value in {
        r"force, peak \[N\]": "20.0",
        r"force, end \[N\]": "5.00",
        r"moment, end \[Nm\]": "2.00",
        r"compliant frame, end \[mm\]": "10.0",
        r"compliant frame, end \[deg\]": "22.9",
        r"motion loop, peak \[deg\]": "5.73",
    }.items():
        assert re.search(rf"{row} *│ *{value} │ *- │", out), row
    code, out = analyze(free, "--no-page")
    assert code == 0
    assert not re.search("force|compliant", out)


def test_the_warning_of_a_truncated_bag_is_shown(tmp_path, analyze):
    bag = write_run(tmp_path / "run", [0.1] * 4000)
    file = bag / "run_0.mcap"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    page = tmp_path / "page.html"
    code, out = analyze(bag, "--out", page)
    assert code == 0
    assert re.search(r"warning: .*run_0.mcap: was not finished", out)
    assert "run_0.mcap: was not finished" in page.read_text()
    assert "5.73" in out


@pytest.mark.parametrize(
    ("label", "name"), [("a/b", "a_b"), ("../../x", "x"), ("..", "run"), ("é n", "é_n")]
)
def test_files_of_tables_stay_in_their_folder(label, name):
    assert file_name(label) == name


def test_joints_that_slide_have_units_of_their_own(tmp_path):
    """The roll of the rod slides at 0.5 m/s here, 20 mm from its command; the hinge turns."""
    urdf = URDF.replace('name="roll" type="revolute"', 'name="roll" type="prismatic"')
    run = recorded(tmp_path / "run", [0.1] * 5, [0.1] * 5, urdf=urdf)
    slides = np.arange(5) * 0.005
    moved = replace(run.measured, q=np.column_stack([run.measured.q[:, 0], slides + 0.02]))
    speeds = np.column_stack([np.full(5, 0.1), np.full(5, 0.5)])
    assert run.command is not None
    command = replace(run.command, q=np.column_stack([run.command.q[:, 0], slides]), dq=speeds)
    run = replace(run, measured=moved, command=command)
    assert {"q.hinge [rad]", "q.roll [m]", "dq.roll [m/s]"} <= analysis.columns(run).keys()
    assert analysis.measure("servo_lag", run) == 0.0
    assert analysis.measure("peak_joint_speed", run) == 0.1
