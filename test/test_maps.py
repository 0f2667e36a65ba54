"""Maps: closed forms, the same numbers wherever the cells run, and what the experiments leave."""

import math
import re
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from distributed import LocalCluster
from matplotlib.colors import LogNorm

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.experiments import library
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.experiments.evaluate import look
from eulerparams_control.lab.experiments.library import map_failure, map_set_points, map_stiffness
from eulerparams_control.lab.experiments.paper import MAPS
from eulerparams_control.lab.run.jobs import cluster, processes

SMALL = replace(map_set_points.MAP, directions=30)


def test_the_apparent_stiffness_of_euler_angles_is_that_of_58():
    """K / (1 + s), K / (1 - s) with s = |sin(beta_d)| of XYZ, |cos(beta_d)| of ZYZ."""
    cells = replace(map_stiffness.MAP, directions=6)
    found = cells.sweep(map_stiffness.simulate)
    for column, row in ((0, 0), (1, 2)):
        s = np.abs(cells.tool_axes[:, row])
        assert s.max() > 0.7
        assert found["smallest"][0, column, :, 0] == pytest.approx(1 / (1 + s), rel=5e-3)
        assert found["largest"][0, column, :, 0] == pytest.approx(1 / (1 - s), rel=5e-3)


def test_angle_axis_comes_back_from_below_90_deg_and_never_from_beyond():
    cells = replace(map_failure.MAP, directions=4, tasks=(70.0, 120.0))
    speed = cells.sweep(map_failure.simulate)["speed"]
    angle_axis, parameters = speed[:, 3], speed[:, 5]
    assert np.isfinite(angle_axis[0]).all()
    assert np.isinf(angle_axis[1]).all()
    # k theta / e of a critically damped error; the torque of Euler parameters is weaker
    assert ((parameters > 0.7) & (parameters < 1.2)).all()


def test_all_columns_meet_the_same_random_numbers():
    twice = replace(SMALL, columns=(SMALL.columns[0],) * 2, trials=2)
    astray = twice.sweep(map_set_points.simulate)["astray"]
    assert np.array_equal(astray[:, 0], astray[:, 1])
    assert len(set(astray[0, 0].ravel())) == 60


def test_each_column_has_its_label():
    below, scale = ["here"] * 5, ("viridis", "off [deg]", (0.1, 1.0))
    figure = SMALL.spheres({"all": (np.ones((5, 30)), below)}, LogNorm(0.1, 1.0), *scale)
    assert [axes.get_title() for axes in figure.axes[:5]] == [c.label for c in SMALL.columns]


@pytest.mark.slow
def test_the_numbers_are_the_same_here_in_processes_and_with_a_scheduler():
    def swept(pool=None):
        return SMALL.sweep(map_set_points.simulate, pool)["astray"]

    with processes(2) as pool:
        assert np.array_equal(swept(pool), swept())
    with (
        LocalCluster(n_workers=2, host="127.0.0.1", dashboard_address="127.0.0.1:0") as other,
        cluster(other.scheduler_address) as pool,
    ):
        assert np.array_equal(swept(pool), swept())


def test_a_scheduler_that_is_not_there_is_named():
    with pytest.raises(ConfigurationError, match="no Dask scheduler at 127"):  # noqa: SIM117
        with cluster("127.0.0.1:x"):
            pass


@pytest.mark.parametrize("name", MAPS)
def test_a_map_is_an_experiment_with_pictures_and_numbers(tmp_path, monkeypatch, name):
    module = import_module(f"{library.__name__}.{name}")
    directions = 150 if name == "map_set_points" else 2  # some tools point down
    monkeypatch.setattr(module, "MAP", replace(module.MAP, directions=directions))
    outcome = look(load_experiment(name), tmp_path, {})
    assert all(math.isfinite(verdict.measured) for verdict in outcome.verdicts)
    page = (tmp_path / "report.html").read_text()
    assert page.count('class="picture map"') == 1
    assert not re.findall(r'(?:src|href)="https?:', page)
    assert "#d62700" in outcome.figure  # where it fails
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
