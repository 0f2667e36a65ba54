"""The sign of the mutual quaternion: shortest, hysteretic, continuous."""

import math
from itertools import pairwise

import numpy as np
import pytest
from samples import about, generator, pairs_apart, rodrigues, uniform, unit_vectors
from tolerances import ALGEBRAIC, ESCAPE_RATE, LONG_WAY_DEG, TRAVEL_DEG

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws.orientation import (
    SEPARATE,
    SIGNS,
    OrientationOptions,
    SignRule,
    representation,
)
from eulerparams_control.laws.rotations import EulerParameters, angle_between, exp, mutual, mutual_R

Z = np.eye(3)[2]
DELTA = 0.2
DT = 1e-3  # [s]
K = 10.0  # k_Po [1/s] of (28)
K_P, K_V = 100.0, 14.142  # k_Po [1/s^2], k_Vo [1/s] of (40)
NOISE = 0.02  # [rad]
STEP_OF_THE_WALK = 0.05  # [rad], each component

every_rule = pytest.mark.parametrize("name", SIGNS)


def euler_parameters(sign, initial=1):
    """Return the representation with that rule for the sign."""
    rule = SignRule(sign, DELTA, initial)
    return representation("euler_parameters", OrientationOptions(sign=rule))


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
    """Return the inner product of two quaternions."""
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


def noise_at_pi():
    """Return the quaternions of an error of 180 deg under noise that alternates."""
    return [about_z(math.pi + NOISE * (-1) ** n) for n in range(100)]


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
def test_hysteretic_never_returns_eta_below_minus_delta(delta):
    chosen = choose_all(SignRule("hysteretic", delta), random_walk())
    lowest = min(Q.eta for Q in chosen)
    assert -delta <= lowest < -delta + STEP_OF_THE_WALK  # and it gets there


@pytest.mark.parametrize("delta", [0.0, 0.05, DELTA, 0.9])
def test_hysteretic_flips_only_beyond_delta(delta):
    chosen = choose_all(SignRule("hysteretic", delta), random_walk())
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


# --- chattering at 180 degrees ---------------------------------------------------------------


def test_shortest_chatters_under_noise_at_180_degrees():
    assert flips(choose_all(SignRule("shortest"), noise_at_pi())) == 99


@pytest.mark.parametrize("name", ["hysteretic", "continuous"])
def test_hysteretic_and_continuous_do_not_chatter_under_noise_at_180_degrees(name):
    assert flips(choose_all(SignRule(name), noise_at_pi())) == 0


def final_error_under_adversarial_noise(name):
    """Return the error [rad] after 3 s of (28), measured with noise that holds it at pi."""
    law = euler_parameters(name)
    R_e, x_de = about(2, math.pi - 0.01), None
    for _ in range(3000):
        before_pi = mutual_R(np.eye(3), R_e).eps[2] > 0
        measured = about(2, NOISE if before_pi else -NOISE) @ R_e
        x_de = law.displacement(np.eye(3), measured, x_de)
        R_e = exp(DT * law.resolved_velocity(x_de, np.zeros(3), K)) @ R_e
    return angle_between(R_e, np.eye(3))


def test_adversarial_noise_holds_shortest_at_180_degrees():
    assert final_error_under_adversarial_noise("shortest") > math.radians(178)


def test_adversarial_noise_does_not_hold_hysteretic():
    assert final_error_under_adversarial_noise("hysteretic") < 1.1 * NOISE


# --- where the sign must not be chosen: on each quaternion apart (E14) -------------------------


def naive(R_e, R_d):
    """Return the mutual quaternion of two that were extracted apart, each with eta >= 0."""
    return mutual(EulerParameters.from_R(R_e), EulerParameters.from_R(R_d))


def travel(R_d, R_e, extract):
    """Return the angle [deg] that (28) travels in 3 s with that mutual quaternion."""
    angle = 0.0
    for _ in range(3000):
        omega = K * (R_e @ extract(R_e, R_d).eps)
        R_e = exp(DT * omega) @ R_e
        angle += DT * np.linalg.norm(omega)
    return math.degrees(angle)


@pytest.mark.parametrize("r", unit_vectors(3))
def test_the_naive_choice_makes_a_travel_of_358_degrees_of_an_error_of_2(r):
    R_d, R_e = rodrigues(math.radians(179), r), rodrigues(math.radians(181), r)
    assert naive(R_e, R_d).eta < 0
    assert travel(R_d, R_e, naive) == pytest.approx(358, abs=TRAVEL_DEG)
    assert travel(R_d, R_e, mutual_R) == pytest.approx(2, abs=TRAVEL_DEG)


def dynamic_run(law, R_d, R_e, duration=3.0):
    """Return the mutual quaternions and the angle travelled [deg] along (41), R_d at rest."""
    omega, x_de, quaternions, angle = np.zeros(3), None, [], 0.0
    rest = np.zeros(3)
    for _ in range(round(duration / DT)):
        x_de = law.displacement(R_d, R_e, x_de)
        quaternions.append(x_de.Q_de)
        omega = omega + DT * law.resolved_acceleration(x_de, rest, rest, omega, K_P, K_V)
        R_e = exp(DT * omega) @ R_e
        angle += DT * np.linalg.norm(omega)
    return quaternions, math.degrees(angle)


@pytest.mark.parametrize("r", unit_vectors(3))
@pytest.mark.parametrize("name", [SEPARATE, *SIGNS])
def test_dynamic_control_makes_358_degrees_of_an_error_of_2_only_with_separate_signs(name, r):
    R_d, R_e = rodrigues(math.radians(179), r), rodrigues(math.radians(181), r)
    quaternions, angle = dynamic_run(euler_parameters(name), R_d, R_e)
    assert angle == pytest.approx(358 if name == SEPARATE else 2, abs=TRAVEL_DEG)
    assert quaternions[0].eta == pytest.approx(
        (-1 if name == SEPARATE else 1) * math.cos(math.radians(1)), abs=ALGEBRAIC
    )
    assert quaternions[-1].eta > 0  # Q2 is reached either way
    assert math.degrees(quaternions[-1].theta) < TRAVEL_DEG


@every_rule
def test_the_choice_on_the_error_never_sees_more_than_180_degrees_at_first(name):
    law = euler_parameters(name)
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
        np.testing.assert_allclose(expected.R, R_e.T @ R_d, rtol=0, atol=ALGEBRAIC)
        negative += expected.eta < 0
    assert negative > 0  # which eta >= 0 of each does not prevent


# --- the sign at first, and the way from Q1 to Q2 (E13) -----------------------------------------


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


def test_Q1_is_left_at_the_rate_of_its_unstable_pole_and_Q2_reached_the_long_way():
    law = euler_parameters("continuous", initial=-1)
    for r in unit_vectors(2):
        R_e = rodrigues(math.radians(-0.1), r)
        quaternions, angle = dynamic_run(law, np.eye(3), R_e, duration=5.0)
        from_Q1 = np.array([2 * math.atan2(np.linalg.norm(Q.eps), -Q.eta) for Q in quaternions])
        leaving = np.flatnonzero((from_Q1 > math.radians(1)) & (from_Q1 < math.radians(10)))
        rate = np.polyfit(DT * leaving, np.log(from_Q1[leaving]), 1)[0]
        assert rate == pytest.approx((-K_V + math.sqrt(K_V**2 + 2 * K_P)) / 2, rel=ESCAPE_RATE)
        assert angle == pytest.approx(359.9, abs=LONG_WAY_DEG)
        assert quaternions[0].eta < 0 < 1 - 1e-6 < quaternions[-1].eta


def test_exactly_at_Q1_nothing_moves():
    law = euler_parameters("continuous", initial=-1)
    quaternions, angle = dynamic_run(law, np.eye(3), np.eye(3), duration=0.1)
    assert angle == 0
    assert {Q.eta for Q in quaternions} == {-1.0}


# --- bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["shortes", "", "Hysteretic"])
def test_an_unknown_rule_lists_the_known_ones(name):
    with pytest.raises(UnknownNameError) as caught:
        SignRule(name)
    assert all(known in str(caught.value) for known in SIGNS)
    assert isinstance(caught.value, ConfigurationError)


@pytest.mark.parametrize("delta", [-1e-9, 1.0, 2.0, math.nan, math.inf, -math.inf])
def test_a_hysteresis_out_of_bounds_is_refused_with_the_bounds(delta):
    with pytest.raises(ConfigurationError, match=r"hysteresis.*\[0, 1\)") as caught:
        SignRule("hysteretic", delta)
    assert str(delta) in str(caught.value)


@pytest.mark.parametrize("delta", [0.0, 0.5, 0.999])
def test_a_hysteresis_within_bounds_is_kept(delta):
    assert SignRule("hysteretic", delta).delta == delta


@pytest.mark.parametrize("name", [SEPARATE, "shortest", "hysteretic"])
def test_only_the_continuous_sign_can_begin_negative(name):
    with pytest.raises(ConfigurationError, match=r"initial sign of eta is -1.*1, or -1 with cont"):
        SignRule(name, initial=-1)


@pytest.mark.parametrize("initial", [0, 2, -2, math.nan])
def test_an_impossible_initial_sign_is_refused_with_its_value(initial):
    with pytest.raises(ConfigurationError, match=f"initial sign of eta is {initial}"):
        SignRule("continuous", initial=initial)
