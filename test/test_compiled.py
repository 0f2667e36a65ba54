"""Formulas give the same for many samples at once as for one after the other."""

import os
import pickle
import subprocess
import sys
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plain_run import all_commands
from representations import every_representation, of_the_quaternion
from samples import all_rotations, near_pole, poles
from tolerances import assert_close

from eulerparams_control.laws import rotations
from eulerparams_control.laws._old.compiled import (
    IS_COMPILED,
    Formula,
    cache_folder,
    formula,
    from_rows,
    layout,
    sample,
)
from eulerparams_control.laws._old.linear import Mat, Vec
from eulerparams_control.laws.clik import ClikLaw
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.orientation import (
    EulerSequence,
    OrientationOptions,
    SignRule,
    representation,
)
from eulerparams_control.laws.orientation.base import Coordinates
from eulerparams_control.laws.orientation.euler_parameters import (
    EulerParametersRepresentation,
    QuaternionDisplacement,
)
from eulerparams_control.laws.orientation.sequences import SEQUENCES
from eulerparams_control.laws.rotations import Array, EulerParameters, exp, quaternion
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

FORMULAS = sorted(name for name, value in vars(rotations).items() if isinstance(value, Formula))
EXACT = {"rtol": 0, "atol": 4e-15}


def rotations_everywhere(seed: int, count: int = 300) -> Array:
    """Rotations spread uniformly, near identity, near half turns, and on and near the poles."""
    near = [near_pole(s, p, d, 4) for s in ("XYZ", "ZYZ") for p in poles(s) for d in (0.0, 1e-7)]
    every = np.array([*all_rotations(), *(R for some in near for R in some)])
    return np.random.default_rng(seed).permutation(every)[:count]


def path(seed: int, count: int = 2000) -> Array:
    """A walk over all orientations, in small steps."""
    steps = 0.2 * np.random.default_rng(seed).normal(size=(count, 3))
    return np.array(list(accumulate(map(exp, steps), np.matmul)))


def assert_same(found: Any, expected: Any, tolerance: float = 4e-15) -> None:
    """Assert that two values whose parts are arrays are the same."""
    if isinstance(expected, tuple):
        assert type(found) is type(expected)
        for one, other in zip(found, expected, strict=True):
            assert_same(one, other, tolerance)
    else:
        assert_close(found, expected, tolerance)


def in_a_row(samples: list[Any]) -> Any:
    """Return samples of a value whose parts are arrays as one value, whose parts are stacked."""
    kind = type(samples[0])
    if not issubclass(kind, tuple):
        return np.array(samples)
    parts = map(in_a_row, map(list, zip(*samples, strict=True)))
    return kind(*parts) if hasattr(kind, "_fields") else tuple(parts)


def numbers(rng: np.random.Generator, kind: Any, count: int) -> Any:
    """Return N values of a kind: rotations, unit quaternions, else any numbers."""
    R = rotations_everywhere(rng.integers(1000), count)
    if kind is Mat:
        return R
    if kind is EulerParameters:
        return EulerParameters(*quaternion(R))
    return from_rows(kind, rng.normal(size=(count, layout(kind).width)))


@pytest.mark.parametrize("name", FORMULAS)
def test_a_formula_of_many_samples_is_that_of_each(name):
    formula, count = getattr(rotations, name), 300
    kinds, rng = list(formula.takes.values()), np.random.default_rng(3)
    taken = [numbers(rng, kind, count) for kind in kinds]
    if name in ("R_axis", "jacobian_coefficients"):
        taken[0] = np.abs(taken[0] * 10) // 1 % 3 if name == "R_axis" else np.abs(taken[0])
    many = formula(*taken)
    for k in range(0, count, 7):
        one = [np.asarray(v) if isinstance(v, float) else v for v in sample(tuple(taken), k)]
        assert_same(sample(many, k), formula(*one), 1e-13)


@pytest.mark.parametrize("name", SEQUENCES)
def test_euler_angles_of_many_are_those_of_each(name):
    sequence, R = EulerSequence(name), rotations_everywhere(8)
    phi, each, previous = sequence.extract(R), [], None
    for one in R:
        previous = sequence.extract(one, previous)
        each.append(previous)
    assert_close(phi, each, 1e-9)  # next to a pole: its last bits
    assert_close([sequence.R(one) for one in phi], R, 4e-15)
    np.testing.assert_allclose(sequence.T(phi), [sequence.T(one) for one in phi], **EXACT)
    distances = [sequence.pole_distance(one) for one in R]
    assert_close(sequence.pole_distance(R), distances, 3e-8)  # arcsin at 1


OPTIONS = [
    OrientationOptions(EulerSequence("XYZ"), SignRule("hysteretic", 0.2)),
    OrientationOptions(EulerSequence("ZYZ"), SignRule("continuous", 0.2, -1)),
    OrientationOptions(EulerSequence("YXZ"), SignRule("shortest")),
    OrientationOptions(EulerSequence("XYX"), SignRule("hysteretic", 0.0)),
    OrientationOptions(EulerSequence("ZXZ"), SignRule("separate")),
]


@pytest.mark.parametrize("options", OPTIONS)
@every_representation
def test_displacements_in_a_row_follow_from_their_predecessors(name, options):
    orientation = representation(name, options)
    R_d, R_e = path(9), path(10)
    many, each = orientation.displacement(R_d, R_e), [None]
    for pair in zip(R_d, R_e, strict=True):
        each.append(orientation.displacement(*pair, each[-1]))
    assert_same(many, in_a_row(each[1:]), 1e-12)
    rest = orientation.displacement(R_d[700:], R_e[700:], sample(many, 699))
    assert_same(rest.error, many.error[700:])
    if options is OPTIONS[0] and hasattr(many, "Q_de"):  # the walk makes the sign flip
        assert (np.diff(np.sign(many.Q_de.eta)) != 0).sum() > 10


@of_the_quaternion
def test_lyapunov_functions_of_many_are_those_of_each(name):
    orientation = representation(name)
    rng = np.random.default_rng(11)
    R, x, mu = path(12, 100), rng.normal(size=(100, 3)), rng.normal(size=(100, 3))
    A = rng.normal(size=(3, 3))
    Z = Impedance(A @ A.T + np.eye(3), np.eye(3) + A @ A.T / 2, A @ A.T)
    many = orientation.lyapunov_3(R, x, Z, mu)
    each = [orientation.lyapunov_3(*one, Z, m) for *one, m in zip(R, x, mu, strict=True)]
    assert many is not None
    np.testing.assert_allclose(many.V, [one.V for one in each if one], rtol=1e-13)
    np.testing.assert_allclose(many.dV, [one.dV for one in each if one], rtol=1e-12, atol=1e-12)


@pytest.mark.skipif(not IS_COMPILED, reason="nothing is compiled")
@pytest.mark.parametrize("kind", [Vec, Mat, EulerParameters])
def test_what_is_compiled_with_what_another_process_has_compiled_has_the_same_types(kind: Any):
    from numba import float64, int64

    read = layout(kind).read.compiled
    read.get_call_template((float64[::1], int64), {})
    compiled, *_ = read.overloads.values()
    found = pickle.loads(pickle.dumps(compiled.signature.return_type))
    assert found is compiled.signature.return_type


@pytest.mark.slow
@pytest.mark.skipif(not IS_COMPILED, reason="nothing is compiled")
def test_without_a_folder_that_can_be_written_formulas_are_compiled_all_the_same(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    code = "from eulerparams_control.laws.rotations import exp; exp.prepare()"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(file), "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True
    )
    assert "set NUMBA_CACHE_DIR to a folder that can be written" in done.stderr
    assert list(tmp_path.iterdir()) == [file]  # what was compiled lasts no longer than the process


@pytest.mark.skipif(not IS_COMPILED, reason="nothing is compiled")
def test_schemes_command_the_same_where_nothing_is_compiled(tmp_path):
    script, file = Path(__file__).with_name("plain_run.py"), tmp_path / "commands.npz"
    environment = {**os.environ, "EULERPARAMS_PLAIN": "1"}
    subprocess.run([sys.executable, script, file], env=environment, check=True)
    plain, compiled = np.load(file), all_commands()
    assert set(plain.files) == compiled.keys()
    for name, found in compiled.items():
        scale = np.abs(found).max()
        assert_close(plain[name] / scale, found / scale, 1e-12)


@pytest.mark.skipif(not IS_COMPILED, reason="nothing is compiled")
def test_of_a_folder_for_many_programs_only_what_is_its_own_is_deleted(tmp_path, monkeypatch):
    mine, other = tmp_path / "eulerparams_control" / ("0" * 12), tmp_path / "other"
    for folder in (mine, other):
        (folder / "deep").mkdir(parents=True)
        os.utime(folder, (0, 0))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder = Path(cache_folder.__wrapped__())
    assert folder.parent == mine.parent
    assert folder.is_dir()
    assert other.is_dir()
    assert not mine.exists()


def times(k):
    """Return Euler parameters whose law has its gain times k: a representation of one's own."""
    right = representation("euler_parameters").laws.velocity

    @formula
    def velocity(
        x_de: QuaternionDisplacement, omega_d: Vec, k_Po: float, options: Coordinates
    ) -> Vec:
        return right(x_de, omega_d, FACTORS[k] * k_Po, options)

    class Own(EulerParametersRepresentation):
        laws = EulerParametersRepresentation.laws._replace(velocity=velocity)

    return Own()


FACTORS = (1.0, -1.0)


@pytest.mark.slow
def test_two_representations_of_one_name_have_laws_of_their_own():
    ur5 = load_robot("ur5")
    robot = Robot(ur5.urdf, ur5.base_frame, ur5.tip_frame)
    arm = robot.state(np.array(ur5.home), np.zeros(6))
    there = DesiredFrame(arm.p_e, exp(np.array([0.0, 0.1, 0.0])) @ arm.R_e)
    one, other = (ClikLaw(times(k), 0.0, 10.0).velocity(arm, there, None)[0] for k in (0, 1))
    assert np.abs(one).max() > 0.1
    assert_close(one, -other)
