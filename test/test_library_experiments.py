"""Experiments in the library alone, and the curves that theory predicts."""

import json
import math
from functools import cache

import numpy as np
import pytest

from eulerparams_control.errors import UnknownNameError
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.experiments.library import (
    Result,
    _errata,
    library_names,
    run_library,
)
from eulerparams_control.lab.experiments.library._samples import (
    accelerated,
    derivatives,
    rotations,
    vectors,
)
from eulerparams_control.lab.experiments.library.e1 import DIFFERENCES, TWICE, residuals
from eulerparams_control.lab.experiments.model import Criterion, Experiment
from eulerparams_control.lab.experiments.predictions import FORMS, Predicted
from eulerparams_control.lab.experiments.result import judge
from eulerparams_control.laws.linear import Mat
from eulerparams_control.laws.orientation import euler_angles, sequences
from eulerparams_control.laws.rotations import S

FOUND = 1.0  # what a wrong T or dT leaves of (24), [1], and of (38) and (50), [rad/s^2], at least

# Runge-Kutta's method in steps of 2 ms leaves 1e-9 deg of errors of 180 deg.
INTEGRATED = 1e-6


result_of = cache(run_library)


@pytest.fixture(params=library_names())
def found(request: pytest.FixtureRequest) -> tuple[str, Result]:
    return request.param, result_of(request.param)


def test_every_criterion_on_the_library_is_met(found):
    name, result = found
    experiment = load_experiment(name)
    assert experiment.library == name
    verdicts = judge(experiment, {}, result.numbers)
    assert len(verdicts) == sum(bool(criterion.number) for criterion in experiment.criteria) >= 2
    assert [verdict for verdict in verdicts if not verdict.met] == []
    assert {verdict.variant for verdict in verdicts} == {"library"}


def test_a_result_survives_json(found):
    _, result = found
    assert Result.from_json(json.loads(json.dumps(result.to_json()))) == result


@pytest.mark.parametrize(
    ("method", "wrong", "found"),
    [
        ("dT", lambda dT: 3 * dT, {"(38)", "(50)"}),
        ("dT", lambda dT: 0 * dT, {"(38)", "(50)"}),
        ("dT", lambda dT: dT.T, {"(38)", "(50)"}),
        ("T", lambda T: T * [1, 1, 2], {"(24)", "(38)", "(50)"}),
        ("T", lambda T: T[:, ::-1], {"(24)", "(38)", "(50)"}),
    ],
)
def test_a_wrong_T_or_its_derivative_is_found(monkeypatch, method, wrong, found):
    right = getattr(sequences, f"{method}_of")

    def wrongly(*given):
        found = right(*given)
        if isinstance(found, np.ndarray):
            return wrong(found)
        rows = np.array([getattr(found, name) for name in Mat.__slots__]).reshape(3, 3)
        return Mat(*np.ravel(wrong(rows)).tolist())

    for module in (sequences, euler_angles):
        monkeypatch.setattr(module, f"{method}_of", wrongly)
    monkeypatch.setattr(_errata, "_SAMPLES", 30)
    left = residuals(_errata.errata())
    assert {name for name in ("(24)", "(38)", "(50)") if left[name] > FOUND} == found


def test_derivatives_by_differences_are_those_of_a_function_that_is_known():
    first, second = derivatives(lambda t: np.array([math.sin(10 * t + 1), math.exp(3 * t)]))
    np.testing.assert_allclose(first, [10 * math.cos(1), 3], rtol=1e-11)
    np.testing.assert_allclose(second, [-100 * math.sin(1), 9], atol=TWICE / 10)


def test_a_frame_that_is_accelerated_turns_as_it_is_told():
    R, (omega, domega) = rotations(1, 1)[0], vectors(2, 2)
    R_of = accelerated(R, omega, domega)
    dR, ddR = derivatives(R_of)  # dR = S(omega) R, ddR = (S(domega) + S(omega)^2) R
    np.testing.assert_allclose(dR, S(omega) @ R, atol=DIFFERENCES / 10)
    np.testing.assert_allclose(ddR, (S(domega) + S(omega) @ S(omega)) @ R, atol=TWICE / 10)


def test_a_library_experiment_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(UnknownNameError, match="unknown library experiment 'e9'; known: e1, e2"):
        run_library("e9")


def test_a_number_that_the_library_does_not_have_is_refused():
    criterion = Criterion(number="slop", below=1.0)
    experiment = Experiment("x", "claim", (), {}, (criterion,), library="e2")
    assert judge(experiment, {}) == []
    with pytest.raises(UnknownNameError, match=r"'slop' \(did you mean 'slope'\?\)"):
        judge(experiment, {}, result_of("e2").numbers)


# --- predictions over time --------------------------------------------------------------------


def test_a_small_error_by_41_decays_as_the_linear_equation_says():
    k_V = 10.0  # with k_Po = 50 the roots are -5 (1 +- j sqrt(0))
    t, error = FORMS["error_41"](2.0, error=1e-3, k_Po=k_V**2 / 2, k_Vo=k_V)
    expected = 1e-3 * (1 + 5 * t) * np.exp(-5 * t)
    np.testing.assert_allclose(error, expected, atol=1e-3 * INTEGRATED)


def test_an_error_next_to_Q1_grows_at_the_rate_of_the_paper_and_comes_the_long_way():
    t, error = FORMS["error_41"](6.0, error=359.999, k_Po=100.0, k_Vo=14.142)
    rate = (-14.142 + math.sqrt(14.142**2 + 200)) / 2
    early = (t > 0.5) & (t < t[np.argmax(error > 1.0)])
    assert np.polyfit(t[early], np.log(error[early]), 1)[0] == pytest.approx(rate, rel=1e-3)
    assert error.max() == pytest.approx(180, abs=1)
    assert error[-1] < 1


def test_a_value_is_a_line_over_the_time_of_the_runs_and_points_stay_what_they_are():
    curve = Predicted("force", "theory", ((0.0, 9.5),)).over(3.0)
    assert (curve.quantity, curve.text) == ("force", "theory")
    np.testing.assert_array_equal([curve.t, curve.y], [[0.0, 3.0], [9.5, 9.5]])
    curve = Predicted("force", "theory", ((0.0, 1.0), (2.0, 5.0))).over(3.0)
    np.testing.assert_array_equal([curve.t, curve.y], [[0.0, 2.0], [1.0, 5.0]])
