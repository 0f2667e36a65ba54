"""The sign of the mutual quaternion: shortest, hysteretic, continuous."""

import math
from itertools import pairwise

import numpy as np
import pytest
from representations import make
from samples import about, generator, pairs_apart, uniform
from tolerances import ALGEBRAIC, assert_close

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws.orientation import SEPARATE, SIGNS, SignRule
from eulerparams_control.laws.rotations import EulerParameters, exp, mutual

Z = np.eye(3)[2]
DELTA = 0.2
NOISE = 0.02  # [rad]
STEP_OF_THE_WALK = 0.05  # [rad], each component

every_rule = pytest.mark.parametrize("name", SIGNS)


def about_z(theta):
    """Return the mutual quaternion of a rotation by theta [rad] about z, with eta >= 0."""
    return EulerParameters.from_R(about(2, theta))


def choose_all(rule, quaternions):
    """Return what the rule chooses along a sequence of quaternions."""
    chosen = []
    for Q in quaternions:
        chosen.append(rule.choose(Q, chosen[-1] if chosen else None))
    return chosen


def dot(Q_1, Q_2):
    return Q_1.eta * Q_2.eta + Q_1.eps @ Q_2.eps


def flips(chosen):
    """Return how often the sign jumps from one sample to the next."""
    return sum(dot(Q_1, Q_2) < 0 for Q_1, Q_2 in pairwise(chosen))


def random_walk(steps=2000, step=STEP_OF_THE_WALK):
    """Return the quaternions, eta >= 0, of an orientation that wanders everywhere."""
    walk = [np.eye(3)]
    for x in step * generator(20).normal(size=(steps, 3)) + step * Z:
        walk.append(exp(x) @ walk[-1])
    return [EulerParameters.from_R(R) for R in walk]


# --- the rules -------------------------------------------------------------------------------


@every_rule
def test_the_first_quaternion_has_positive_eta(name):
    for R in uniform(50):
        Q = EulerParameters.from_R(R)
        for given in (Q, -Q):
            chosen = SignRule(name).choose(given, None)
            assert chosen.eta >= 0
            np.testing.assert_array_equal(chosen.eps, Q.eps)


@every_rule
def test_what_is_chosen_stands_for_the_same_rotation(name):
    walk = random_walk()
    for Q, chosen in zip(walk, choose_all(SignRule(name), walk), strict=True):
        assert abs(dot(Q, chosen)) == pytest.approx(1.0, abs=ALGEBRAIC)


@every_rule
def test_the_choice_does_not_depend_on_the_sign_that_is_given(name):
    walk = random_walk()
    signs = generator(21).choice([-1, 1], size=len(walk))
    mixed = [Q if sign > 0 else -Q for Q, sign in zip(walk, signs, strict=True)]
    rule = SignRule(name)
    for Q_1, Q_2 in zip(choose_all(rule, walk), choose_all(rule, mixed), strict=True):
        assert Q_1.eta == Q_2.eta
        np.testing.assert_array_equal(Q_1.eps, Q_2.eps)


def test_shortest_never_returns_negative_eta_and_jumps_at_180_degrees():
    chosen = choose_all(SignRule("shortest"), random_walk())
    assert min(Q.eta for Q in chosen) >= 0
    assert flips(chosen) > 0


@pytest.mark.parametrize("delta", [0.0, 0.05, DELTA, 0.9])
def test_hysteretic_flips_only_beyond_delta_and_never_returns_eta_below_minus_delta(delta):
    chosen = choose_all(SignRule("hysteretic", delta), random_walk())
    lowest = min(Q.eta for Q in chosen)
    assert -delta <= lowest < -delta + STEP_OF_THE_WALK  # and it gets there
    after_flips = [Q_2.eta for Q_1, Q_2 in pairwise(chosen) if dot(Q_1, Q_2) < 0]
    assert len(after_flips) > 0
    assert min(after_flips) > delta


def test_continuous_never_flips_and_reaches_eta_of_minus_one():
    chosen = choose_all(SignRule("continuous"), random_walk())
    assert flips(chosen) == 0
    assert min(Q.eta for Q in chosen) < -0.9


@pytest.mark.parametrize(
    ("name", "expected"), [("shortest", 1.0), ("hysteretic", 1.0), ("continuous", -1.0)]
)
def test_after_a_full_turn_only_continuous_remembers_it(name, expected):
    turn = [about_z(theta) for theta in np.linspace(0, 2 * math.pi, 101)]
    last = choose_all(SignRule(name), turn)[-1]
    assert last.eta == pytest.approx(expected, abs=ALGEBRAIC)


def test_hysteretic_flips_at_the_angle_that_delta_stands_for():
    rule = SignRule("hysteretic", DELTA)
    edge, step = 2 * math.acos(-DELTA), 1e-6
    before = choose_all(rule, [about_z(3.0), about_z(edge - step)])[-1]
    after = choose_all(rule, [about_z(3.0), about_z(edge + step)])[-1]
    assert before.eta == pytest.approx(-DELTA, abs=step)
    assert after.eta == pytest.approx(DELTA, abs=step)


def test_only_shortest_chatters_under_noise_at_180_degrees():
    noise = [about_z(math.pi + NOISE * (-1) ** n) for n in range(100)]
    for name, count in (("shortest", 99), ("hysteretic", 0), ("continuous", 0)):
        assert flips(choose_all(SignRule(name), noise)) == count


# --- where the sign must not be chosen: on each quaternion apart (E14) -------------------------


@every_rule
def test_the_choice_on_the_error_never_sees_more_than_180_degrees_at_first(name):
    law = make("euler_parameters", sign=name)
    for theta in (0.1, 1.0, 3.0):
        for R_d, R_e in pairs_apart(theta, 30):
            eta = law.displacement(R_d, R_e).Q_de.eta
            assert eta == pytest.approx(math.cos(theta / 2), abs=ALGEBRAIC)


@pytest.mark.parametrize("apart", [0.1, 1.0, 3.0])
def test_separate_is_the_composition_of_two_quaternions_with_positive_eta(apart):
    negative = 0
    for R_d, R_e in pairs_apart(apart, 30):
        expected = mutual(EulerParameters.from_R(R_e), EulerParameters.from_R(R_d))
        for previous in (None, expected, -expected):  # it has no memory
            Q = SignRule(SEPARATE).mutual(R_e, R_d, previous)
            assert Q.eta == expected.eta
            np.testing.assert_array_equal(Q.eps, expected.eps)
        assert_close(expected.R, R_e.T @ R_d)
        negative += expected.eta < 0
    assert negative > 0  # which eta >= 0 of each does not prevent


def test_with_an_initial_sign_of_minus_one_eta_begins_negative_and_stays_on_its_sheet():
    walk = random_walk()
    rule, other = SignRule("continuous", initial=-1), SignRule("continuous")
    assert rule.choose(walk[100], None).eta < 0
    assert rule.choose(-walk[100], None).eta < 0
    chosen = choose_all(rule, walk)
    assert flips(chosen) == 0
    for Q, Q_other in zip(chosen, choose_all(other, walk), strict=True):
        assert Q.eta == -Q_other.eta
        np.testing.assert_array_equal(Q.eps, -Q_other.eps)


# --- bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["shortes", "", "Hysteretic"])
def test_an_unknown_rule_lists_the_known_ones(name):
    with pytest.raises(UnknownNameError) as caught:
        SignRule(name)
    assert all(known in str(caught.value) for known in SIGNS)
    assert isinstance(caught.value, ConfigurationError)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        *(
            (("hysteretic", delta), rf"hysteresis.*{delta}.*\[0, 1\)")
            for delta in (-1e-9, 1.0, 2.0, math.nan, math.inf, -math.inf)
        ),
        *(
            ((name, DELTA, -1), "initial sign of eta is -1.*1, or -1 with cont")
            for name in (SEPARATE, "shortest", "hysteretic")
        ),
        *(
            (("continuous", DELTA, initial), f"initial sign of eta is {initial}")
            for initial in (0, 2, -2, math.nan)
        ),
    ],
)
def test_impossible_options_are_refused_with_their_value_and_the_bounds(given, text):
    with pytest.raises(ConfigurationError, match=text):
        SignRule(*given)
