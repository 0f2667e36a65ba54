"""Maps: they agree with closed forms, and are the same wherever and in whatever order they run."""

import math
import re
import shutil
import sys
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from distributed import LocalCluster

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.maps import arm_map
from eulerparams_control.lab.maps import definition as definition_module
from eulerparams_control.lab.maps.arm_map import ArmMap, difference
from eulerparams_control.lab.maps.base import MapKind, MapVariant, Table, kinds, of_variant
from eulerparams_control.lab.maps.definition import load_map
from eulerparams_control.lab.maps.deflection_map import DeflectionMap
from eulerparams_control.lab.maps.error_map import ErrorMap
from eulerparams_control.lab.maps.gain_map import GainMap
from eulerparams_control.lab.maps.main import main
from eulerparams_control.lab.maps.orientation_map import OrientationMap
from eulerparams_control.lab.maps.sampling import directions, passing
from eulerparams_control.lab.maps.stiffness_map import StiffnessMap
from eulerparams_control.lab.maps.sweep import batches_of, simulate, sweep
from eulerparams_control.lab.maps.turning import DIVERGED, FAST, FINE, UNSETTLED
from eulerparams_control.lab.run import jobs
from eulerparams_control.lab.run.jobs import results, workers
from eulerparams_control.laws.orientation import EulerSequence
from eulerparams_control.laws.rotations import exp
from eulerparams_control.resources import config_names
from eulerparams_control.robot.catalogue import load_robot

XYZ = MapVariant("XYZ", "euler_angles", "XYZ")
ZYZ = MapVariant("ZYZ", "euler_angles", "ZYZ")
RELATIVE = MapVariant("relative", "relative_euler_angles")
ANGLE_AXIS = MapVariant("angle/axis", "angle_axis")
VECTOR = MapVariant("vector", "rotation_vector")
PARAMETERS = MapVariant("parameters", "euler_parameters", k_factor=2.0)

SMALL = OrientationMap(
    variants=(XYZ, PARAMETERS), samples=6, trials=1, errors=(100.0,), speeds=(), batch=3
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the small map, all of which is simulated."""
    folder = tmp_path_factory.mktemp("small")
    sweep(replace(load_map("failure"), kind=SMALL), folder, Counting(), lambda *_: None)
    return folder


def table_of(kind: MapKind) -> Table:
    rows = simulate(kind, (0, kind.cells()))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def rows_of(pool: Executor, kind: MapKind) -> list[object]:
    batches = enumerate(batches_of(kind))
    found = {
        job[0]: future.result() for job, future in results(pool, partial(simulate, kind), batches)
    }
    return [found[number] for number in sorted(found)]


# --- sampling --------------------------------------------------------------------------
def test_directions_are_unit_vectors_spread_evenly():
    v = directions(400)
    assert np.allclose(np.linalg.norm(v, axis=1), 1)
    assert np.allclose(v.T @ v / 400, np.eye(3) / 3, atol=5e-3)


@pytest.mark.parametrize(("axis", "sequence"), [(0, "XYZ"), (2, "ZYZ")])
def test_a_passing_turn_comes_as_close_to_the_pole_as_asked(axis, sequence):
    R, n = passing(axis, 0.1, 0.7)
    distance = [EulerSequence(sequence).pole_distance(exp(phi * n) @ R) for phi in (-0.2, 0, 0.2)]
    beside = math.acos(math.cos(0.1) * math.cos(0.2))
    assert distance == pytest.approx([beside, 0.1, beside])


# --- closed forms ----------------------------------------------------------------------
def test_the_peak_speed_of_clik_is_that_of_its_error_equation():
    """k theta of a rotation vector; 2 k sin(theta/2) of Euler parameters, eq. (28)."""
    kind = OrientationMap(
        variants=(VECTOR, PARAMETERS), samples=4, trials=1, errors=(30.0, 170.0), speeds=(),
        law="clik", noise=0.0, dt=1e-3,
    )  # fmt: skip
    table = table_of(kind)
    assert of_variant(table, 0)["speed_ratio"] == pytest.approx(1.0)
    for error in kind.errors:
        half = math.radians(error) / 2
        rows = of_variant(table, 1, error=error)
        assert rows["speed_ratio"] == pytest.approx(math.sin(half) / half)
        assert rows["detour"] == pytest.approx(1.0, abs=1e-3)
    assert (table["failure"] == FINE).all()


def test_the_settle_time_of_clik_with_euler_parameters_is_that_of_28():
    """dtheta = -2 k sin(theta/2), so tan(theta/4) decays with exp(-k t)."""
    kind = OrientationMap(
        variants=(PARAMETERS,), samples=2, trials=1, errors=(120.0,), speeds=(), law="clik",
        noise=0.0, dt=1e-3, rate=20.0, settled=1.0,
    )  # fmt: skip
    start, end = math.radians(120.0), math.radians(1.0)
    expected = math.log(math.tan(start / 4) / math.tan(end / 4)) / kind.rate
    # explicit steps of h shorten it by about h k / 2
    assert table_of(kind)["settle_time"] == pytest.approx(expected, rel=kind.rate * kind.dt)


@pytest.mark.parametrize(("variant", "row"), [(XYZ, 0), (ZYZ, 2)])
def test_the_apparent_stiffness_of_euler_angles_is_that_of_58(variant, row):
    """K / (1 + s), K / (1 - s) with s = |sin(beta_d)| of XYZ, |cos(beta_d)| of ZYZ."""
    kind = StiffnessMap(variants=(variant,), samples=8, moment=1e-5)
    table = table_of(kind)
    s = np.abs(table["xyz"[row]])
    assert s.max() > 0.8
    assert table["k_min"] == pytest.approx(1 / (1 + s), rel=1e-3)
    assert table["k_max"] == pytest.approx(1 / (1 - s), rel=1e-3)


def test_large_moments_turn_as_in_closed_form():
    """arcsin(m) with Euler parameters, m with a rotation vector; m is moment over stiffness."""
    kind = DeflectionMap(variants=(PARAMETERS, VECTOR), samples=3, trials=2, largest=0.9)
    kind = replace(kind, duration=2.0)
    table = table_of(kind)
    m = of_variant(table, 0)["moment"]
    assert of_variant(table, 0)["turn"] == pytest.approx(np.degrees(np.arcsin(m)), rel=1e-3)
    assert of_variant(table, 1)["turn"] == pytest.approx(np.degrees(m), rel=1e-3)
    assert table["deviation"].max() < 1e-3


def test_beyond_half_the_stiffness_angle_axis_has_no_equilibrium():
    kind = DeflectionMap(variants=(ANGLE_AXIS,), samples=2, trials=1, largest=0.9)
    table = table_of(kind)
    assert table["turn"][0] == pytest.approx(math.degrees(math.asin(0.9) / 2), rel=1e-2)
    assert math.isnan(table["turn"][1])


# --- what fails ------------------------------------------------------------------------
def test_angle_axis_settles_below_90_deg_and_never_beyond():
    kind = OrientationMap(
        variants=(ANGLE_AXIS, PARAMETERS), samples=3, trials=1, errors=(70.0, 120.0), speeds=()
    )
    table = table_of(kind)
    assert (of_variant(table, 0, error=70.0)["failure"] == FINE).all()
    assert (of_variant(table, 0, error=120.0)["failure"] == UNSETTLED).all()
    assert of_variant(table, 0, error=120.0)["final_deg"] == pytest.approx(180.0, abs=0.5)
    assert (of_variant(table, 1)["failure"] == FINE).all()


def test_euler_angles_fail_close_to_their_pole_and_nowhere_else():
    kind = GainMap(
        variants=(XYZ, ZYZ, PARAMETERS), samples=2, closest=(0.05, 30.0), gains=(10.0, 100.0),
        arc=20.0,
    )  # fmt: skip
    table = table_of(kind)
    near = table["closest"] < 1
    assert (table["failure"][near & (table["variant"] < 2)] >= UNSETTLED).any()
    assert (table["failure"][near & (table["variant"] == 2)] == FINE).all()
    assert (table["failure"][~near] == FINE).all()


def test_euler_angles_go_astray_where_euler_parameters_turn_directly():
    kind = ErrorMap(variants=(XYZ, RELATIVE, PARAMETERS), samples=3)
    table = table_of(kind)
    assert of_variant(table, 0)["detour"].max() > 1.2
    assert of_variant(table, 1)["detour"].max() > 1.2
    assert of_variant(table, 2)["detour"].max() < 1.01
    assert set(table["failure"]) <= {FINE, FAST, UNSETTLED, DIVERGED}


def test_an_arm_does_what_the_free_frame_does():
    kind = ArmMap(variants=(XYZ, PARAMETERS), samples=5, error=100.0, noise=0.0)
    table = table_of(kind)
    reached = table["reached"] > 0
    assert 2 <= reached.sum() < len(reached) or reached.all()
    assert difference(table) < 0.01
    speeds = table["speed_ratio"][reached] / table["free_speed_ratio"][reached]
    assert speeds == pytest.approx(1.0, abs=0.02)
    assert np.isnan(table["detour"][~reached]).all()


def test_a_failure_says_what_failed():
    def failure(final: float = 0.0, end: int = 3, highest: float = 1.0, stays: bool = False):
        errors, speeds = np.array([1.0, 0.1, final]), np.ones(3)
        return SMALL._row(errors, speeds, end, (highest, 1.0), stays)["failure"]

    assert failure() == FINE
    assert failure(highest=0.5) == FAST
    assert failure(final=0.1) == failure(stays=True) == UNSETTLED
    assert failure(end=2) == DIVERGED


# --- the sweep -------------------------------------------------------------------------
def test_all_representations_meet_the_same_errors_and_noise():
    twice = replace(SMALL, variants=(PARAMETERS, PARAMETERS))
    table = table_of(twice)
    assert np.array_equal(of_variant(table, 0)["speed_ratio"], of_variant(table, 1)["speed_ratio"])
    assert len(set(of_variant(table, 0)["final_deg"])) == 6
    other = table_of(replace(twice, seed=2))
    assert not np.array_equal(table["final_deg"], other["final_deg"])


class Counting(Executor):
    """An executor that keeps which batches it simulated; the first few, or all of them."""

    def __init__(self, most: int = sys.maxsize) -> None:
        self.simulated: list[int] = []
        self._most = most

    def submit(self, function, batch):  # type: ignore[no-untyped-def,override]
        future: Future[object] = Future()
        if len(self.simulated) == self._most:
            future.set_exception(KeyboardInterrupt())
        else:
            self.simulated.append(batch[0])
            future.set_result(function(batch))
        return future


def test_what_was_finished_is_not_simulated_again(tmp_path, finished, monkeypatch):
    definition = replace(load_map("failure"), kind=SMALL)
    monkeypatch.setattr(jobs, "as_completed", list)  # in order
    interrupted, counting = Counting(2), Counting()
    shown: list[tuple[int, int]] = []
    with pytest.raises(KeyboardInterrupt):
        sweep(definition, tmp_path / "a", interrupted, lambda *_: None)
    resumed = sweep(definition, tmp_path / "a", counting, lambda *s: shown.append(s))
    assert (interrupted.simulated, counting.simulated) == ([0, 1], [2, 3])
    assert shown == [(6, 12), (9, 12), (12, 12)]
    at_once = sweep(definition, finished, counting, lambda *_: None)
    assert counting.simulated == [2, 3]
    assert all(np.array_equal(resumed[name], at_once[name]) for name in at_once)
    stored = pq.read_table(tmp_path / "a" / "map.parquet").to_pydict()
    assert stored["speed_ratio"] == list(resumed["speed_ratio"])
    other = replace(definition, kind=replace(SMALL, seed=9))
    again = Counting()
    sweep(other, tmp_path / "a", again, lambda *_: None)
    assert again.simulated == [0, 1, 2, 3]  # other options: nothing of it was finished


@pytest.mark.parametrize("damage", ["empty", "truncated", "garbage", "flipped", "other", "rows"])
def test_a_part_that_is_damaged_or_foreign_is_simulated_again(tmp_path, damage, finished):
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    definition, counting = replace(load_map("failure"), kind=SMALL), Counting()
    expected = sweep(definition, tmp_path, counting, lambda *_: None)
    assert counting.simulated == []  # all is finished
    (folder,) = (tmp_path / "parts").iterdir()
    part = folder / "000001.parquet"
    whole = part.read_bytes()
    half = len(whole) // 2
    cells = tmp_path / "cells.parquet"  # of the right cells, but without what became of them
    pq.write_table(pa.Table.from_pylist(batches_of(SMALL)[1]), cells)
    damaged = {
        "empty": b"",
        "truncated": whole[:half],
        "garbage": b"PAR1 is no map PAR1",
        "flipped": whole[:8] + bytes(255 - byte for byte in whole[8:half]) + whole[half:],
        "other": (folder / "000002.parquet").read_bytes(),
        "rows": cells.read_bytes(),
    }
    part.write_bytes(damaged[damage])
    for stray in ("x.parquet", "-1.parquet", "000099.parquet"):
        (folder / stray).write_bytes(b"stray")
    again = sweep(definition, tmp_path, counting, lambda *_: None)
    assert counting.simulated == [1]
    assert all(np.array_equal(again[name], expected[name]) for name in expected)


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("eulerparams_control/lab/maps/turning.py", True),
        ("eulerparams_control/lab/maps/arm_map.py", True),
        ("eulerparams_control/laws/orientation/euler_angles.py", True),
        ("eulerparams_control/laws/rotations.py", True),
        ("eulerparams_control/lab/maps/gain_map.py", False),
        ("eulerparams_control/analysis/static.py", False),
        ("eulerparams_control/lab/maps/main.py", False),
    ],
)
def test_other_code_makes_another_map_but_not_another_kind_or_style(monkeypatch, name, counts):
    definition = load_map("arm")
    before = definition.fingerprint
    assert before == load_map("arm").fingerprint
    read = Path.read_bytes
    path = Path(definition_module.__file__).parents[3] / name
    assert path.is_file()
    monkeypatch.setattr(Path, "read_bytes", lambda p: read(p) + b"#" * (p == path))
    definition_module._code.cache_clear()
    assert (definition.fingerprint != before) is counts
    definition_module._code.cache_clear()


def test_a_map_of_an_arm_depends_on_the_whole_robot(monkeypatch):
    arm, free = load_map("arm"), load_map("failure")
    before = arm.fingerprint, free.fingerprint
    robot = replace(load_robot("ur5"), home=(0.1,) * 6)
    monkeypatch.setattr(arm_map, "load_robot", lambda _: robot)
    assert arm.fingerprint != before[0]
    assert free.fingerprint == before[1]


@pytest.mark.slow
def test_the_numbers_are_the_same_here_in_workers_of_its_own_and_with_another_scheduler():
    with workers(0) as here:
        expected = rows_of(here, SMALL)
    with workers(2) as local:
        assert rows_of(local, SMALL) == expected
    with (
        LocalCluster(n_workers=2, host="127.0.0.1", dashboard_address="127.0.0.1:0") as other,
        workers(0, other.scheduler_address) as cluster,
    ):
        assert rows_of(cluster, SMALL) == expected


# --- the executable --------------------------------------------------------------------
def test_writes_a_page_with_pictures_that_need_no_network(tmp_path):
    args = ["stiffness", "gain", "--quick", "--samples", "2", "--workers", "0"]
    assert main([*args, "--out", str(tmp_path)]) == 0
    page = (tmp_path / "index.html").read_text()
    assert page.count("<svg") == 2
    assert "<script" not in page
    assert not re.findall(r'(?:src|href)="https?:', page)
    ids = re.findall(r'\bid="([^"]*)"', page)
    assert len(ids) == len(set(ids))
    assert len(ids) > 100
    for file in ("stiffness/stiffness", "gain/gain"):
        assert (tmp_path / f"{file}.png").read_bytes().startswith(b"\x89PNG")
        assert f'href="{file}.svg"' in page
    assert "Euler parameters nowhere" in page


@pytest.mark.parametrize("name", config_names("maps"))
def test_the_shipped_maps_are_whole(name):
    definition = load_map(name)
    assert definition.question.endswith("?")
    cells = definition.kind.cells()
    assert len(cells) < 30_000
    assert {cell["variant"] for cell in cells} == set(range(len(definition.kind.variants)))
    assert len(load_map(name, quick=True).kind.cells()) < 400


def test_every_kind_of_map_is_shipped():
    assert {load_map(name).kind.kind for name in config_names("maps")} == set(kinds())


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("wrong", "kind: nothing", "unknown kind of map 'nothing'"),
        ("wrong", "kind: gain\ngain: 3", "unknown key of the kind 'gain' 'gain'"),
        ("wrong", "kind: gain\nspeed: -1", "speed is -1; expected a finite number above 0"),
        ("wrong", "kind: gain\nsamples: 1.5", "samples is 1.5; expected a whole number"),
        ("wrong", "kind: gain\nclosest: [.nan, 1]", "closest is [nan, 1]; expected some finite"),
        ("wrong", "kind: gain\nlaw: none", "unknown value of law: 'none'"),
        ("..", "kind: gain", "map '..': use letters, digits"),
        ("a b", "kind: gain", "map 'a b': use letters, digits"),
        ("a.b", "kind: gain", "map 'a.b': use letters, digits"),
    ],
)
def test_a_wrong_file_is_refused_with_its_path(tmp_path, name, content, message):
    path = tmp_path / f"{name}.yaml"
    path.write_text(f"{content}\nvariants: {{a: {{orientation: euler_parameters}}}}\n")
    with pytest.raises(ConfigurationError, match=re.escape(f"{path}: {message}")):
        load_map(str(path))


def test_a_scheduler_that_is_not_there_is_named():
    with pytest.raises(ConfigurationError, match="no Dask scheduler at 127"):  # noqa: SIM117
        with workers(0, "127.0.0.1:x"):
            pass


def test_without_dask_the_error_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigurationError, match=r"Dask is not installed .*--workers 0"):  # noqa: SIM117
        with workers(1):
            pass
    with workers(0) as here:
        assert len(rows_of(here, SMALL)) == 4
