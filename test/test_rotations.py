"""Section II: rotations, Euler parameters and their sign, eqs. (1), (4)-(17); Euler angles."""

import itertools
import math
import re
from itertools import pairwise

import numpy as np
import pytest
import samples
from representations import every_sequence
from tolerances import ALGEBRAIC, ASIN, DIFFERENCES, ETA_NEAR_PI, RELATIVE, UNBOUNDED, assert_close

from eulerparams_control.errors import ConfigurationError, SingularityError, UnknownNameError
from eulerparams_control.laws import rotations as so3
from eulerparams_control.laws.orientation import SEPARATE, SEQUENCES, SIGNS, EulerSequence, SignRule
from eulerparams_control.laws.orientation.sequences import R_axis
from eulerparams_control.laws.rotations import EulerParameters

X, Y, Z = np.eye(3)
COUNT, FEW = 100, 50
# Angles [rad] at which each formula of theta is tried; their signs matter.
ANGLES = (0.0, 1e-9, 1e-4, 0.5, math.pi / 2, 2.5, math.pi - 1e-9, math.pi, -1e-7, -1.0, -3.0)
# Angles [rad] over which the logarithm keeps its relative accuracy.
LOG_ANGLES = (1e-15, 1e-12, 1e-9, 1e-7, 0.99e-4, 1.01e-4, 1.99e-4, 2.01e-4, 0.1, 1.0, 3.0, 3.1415)


def random_parameters(count, key=0):
    """Return Euler parameters uniform on the sphere, of either sign of eta."""
    quaternions = np.random.default_rng(key).normal(size=(count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    return [EulerParameters(float(q[0]), q[1:]) for q in quaternions]


def as_array(Q):
    return np.array([Q.eta, *Q.eps])


# --- products, eqs. (1), (2) ----------------------------------------------------------------
def test_products_of_vectors_and_matrices_are_those_of_numpy():
    matrices = samples.generator(14).normal(size=(2, COUNT, 3, 3))
    for v, w, A, B in zip(
        samples.vectors(COUNT), samples.vectors(COUNT, key=1), *matrices, strict=True
    ):
        for found, expected in (
            (so3.dot(v, w), v @ w),
            (so3.norm(v), np.linalg.norm(v)),
            (so3.cross(v, w), np.cross(v, w)),
            (so3.S(v) @ w, np.cross(v, w)),  # eq. (1)
            (so3.S(v) + so3.S(v).T, 0),
            (so3.turn(A, v), A @ v),
            (so3.turn_back(A, v), A.T @ v),
            (so3.product(A, B), A @ B),
            (so3.product(A.T, B), A.T @ B),
            (A @ so3.solve(A, v), v),
            (A @ so3.inverse(A), np.eye(3)),
        ):
            assert_close(found, expected, 100 * ALGEBRAIC)


def test_a_singular_matrix_has_no_solution_and_no_inverse():
    A = np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [0.0, 0.0, 1.0]])
    assert np.isnan(so3.solve(A, X)).all()
    assert np.isnan(so3.inverse(A)).all()


# --- eqs. (4)-(7): angle and axis, Euler parameters --------------------------------------------
@pytest.mark.parametrize("theta", ANGLES)
def test_R_and_euler_parameters_of_angle_and_axis_are_their_formulas(theta):
    for axis in range(3):
        assert_close(R_axis(axis, theta), samples.about(axis, theta))
    for r in [X, Y, Z, *samples.unit_vectors(20)]:
        assert_close(so3.R_angle_axis(theta, r), samples.rodrigues(theta, r))  # eq. (4)
        eta, eps = Q = EulerParameters.from_angle_axis(theta, r)
        assert eta == pytest.approx(math.cos(theta / 2), abs=ALGEBRAIC)  # eq. (5)
        np.testing.assert_allclose(eps, math.sin(theta / 2) * r, rtol=RELATIVE)  # eq. (5)
        assert eta**2 + eps @ eps == pytest.approx(1.0, abs=ALGEBRAIC)  # eq. (6)
        assert eta >= 0  # abs(theta) <= pi
        assert_close(Q.R, samples.rodrigues(theta, r))  # eq. (7)


@pytest.mark.parametrize("gap", [1e-12, 1e-9, 1e-6])
def test_extraction_just_below_pi_keeps_the_side_of_the_axis(gap):
    for r in [X, -Y, Z, *samples.unit_vectors(30)]:
        eta, eps = so3.quaternion(samples.rodrigues(math.pi - gap, r))
        assert eta == pytest.approx(gap / 2, rel=ETA_NEAR_PI)
        assert_close(eps, r)


def test_propagation_rule_is_the_derivative_of_the_euler_parameters():
    for Q, omega in zip(random_parameters(COUNT), samples.vectors(COUNT, key=1), strict=True):
        R = samples.turning(Q.R, omega)

        def of_sign_of_Q(t, R=R, Q=Q):
            Q_t = as_array(so3.quaternion(R(t)))
            return Q_t * np.sign(Q_t @ as_array(Q))

        # eqs. (8), (9)
        expected = samples.derivative(of_sign_of_Q)
        assert_close(np.hstack(so3.propagation(*Q, omega)), expected, DIFFERENCES)


def test_composition_is_the_mutual_rotation_and_the_conjugate_inverts():
    for R_1, R_2 in zip(samples.all_rotations(), reversed(samples.all_rotations()), strict=True):
        Q_1, Q_2 = so3.quaternion(R_1), so3.quaternion(R_2)
        assert_close(so3.mutual(Q_1, Q_2).R, R_1.T @ R_2)  # eqs. (11), (12), (13)
        Q = so3.mutual_R(R_1, R_2)
        assert Q.eta >= 0
        assert_close(R_1 @ Q.R, R_2)
    for Q_1, Q_2 in zip(random_parameters(COUNT), random_parameters(COUNT, key=1), strict=True):
        conjugate = EulerParameters(Q_1.eta, -Q_1.eps)
        assert_close(so3.mutual(conjugate, Q_2).R, Q_1.R @ Q_2.R)
        assert_close(conjugate.R, Q_1.R.T)
        assert_close(as_array(so3.mutual(Q_1, Q_1)), [1, 0, 0, 0])
        np.testing.assert_array_equal(as_array(-Q_1), -as_array(Q_1))
        np.testing.assert_array_equal((-Q_1).R, Q_1.R)


# --- exponential and logarithm ---------------------------------------------------------------
@pytest.mark.parametrize("theta", [*LOG_ANGLES, so3.SMALL_ANGLE, math.pi, 4.0, 7.0])
def test_exp_turns_by_the_length_about_the_direction_and_log_inverts_it_accurately(theta):
    for r in samples.unit_vectors(50):
        assert_close(so3.exp(theta * r), samples.rodrigues(theta, r))
        if theta <= math.pi:
            Q = EulerParameters.from_angle_axis(theta, r)
            np.testing.assert_allclose(so3.rotation_vector(*Q), theta * r, rtol=RELATIVE, atol=0)
            assert_close(so3.rotation_vector(*-Q), -(2 * math.pi - theta) * r)  # the long way round
        if theta < math.pi:
            for R in (so3.exp(theta * r), samples.rodrigues(theta, r)):
                assert np.linalg.norm(so3.log(R) - theta * r) / theta < ALGEBRAIC


def test_exp_inverts_log_at_every_angle():
    for R in samples.all_rotations():
        assert_close(so3.exp(so3.log(R)), R)
        assert np.linalg.norm(so3.log(R)) <= math.pi + ALGEBRAIC
    np.testing.assert_array_equal(so3.log(np.eye(3)), np.zeros(3))  # exactly
    np.testing.assert_array_equal(so3.exp(np.zeros(3)), np.eye(3))
    for eta in (1.0, -1.0):
        np.testing.assert_array_equal(so3.rotation_vector(eta, np.zeros(3)), np.zeros(3))


# Angles [rad] on both sides of where the series of the right Jacobian ends.
JACOBIAN_ANGLES = (
    *(0.0, 1e-6, 0.01, 0.999 * so3.SMALL_JACOBIAN_ANGLE, 1.001 * so3.SMALL_JACOBIAN_ANGLE),
    *(1.0, 3.0, math.pi, 5.0),
)


def series_of_the_right_jacobian(x):
    """Return the sum of (-S(x))^n / (n + 1)! (3, 3)."""
    term, total = np.eye(3), np.eye(3)
    for n in range(1, 50):
        term = term @ -samples.skew(x) / (n + 1)
        total = total + term
    return total


@pytest.mark.parametrize("theta", JACOBIAN_ANGLES)
def test_the_right_jacobian_is_its_series_and_gives_the_body_rates_with_its_derivative(theta):
    rates = samples.vectors(20)
    for r, dx, ddx in zip(samples.unit_vectors(20), rates, rates[::-1], strict=True):
        x = theta * r
        dJ_r = samples.derivative(lambda t, x=x, dx=dx: series_of_the_right_jacobian(x + t * dx))
        J_r = series_of_the_right_jacobian(x)
        assert_close(so3.right_jacobian(x), J_r)
        omega, domega = so3.body_rates(x, dx, ddx)
        assert_close(omega, J_r @ dx)
        assert_close(domega, J_r @ ddx + dJ_r @ dx, DIFFERENCES)


@pytest.mark.parametrize("theta", [1e-9, 1e-3, 0.7, 2.0, math.pi - 1e-6, math.pi])
def test_angle_between_two_frames_is_the_angle_of_their_mutual_rotation(theta):
    for R_2, R_1 in samples.pairs_apart(theta, 20):
        assert so3.angle_between(R_1, R_2) == pytest.approx(theta, abs=ALGEBRAIC)
        assert so3.angle_between(R_2, R_1) == pytest.approx(theta, abs=ALGEBRAIC)
        assert so3.chord(R_1, R_2) == pytest.approx(2 * math.sin(theta / 2), abs=1e-7)


# --- the sign of the mutual quaternion -----------------------------------------------------
NOISE = 0.02  # [rad]
STEP_OF_THE_WALK = 0.05  # [rad], each component


def choose_all(rule, quaternions):
    """Return what the rule chooses along a sequence of quaternions."""
    chosen = []
    for Q in quaternions:
        chosen.append(rule.choose(Q, chosen[-1] if chosen else None))
    return chosen


def after_flips(chosen):
    """Return eta after each jump of the sign from one sample to the next."""
    return [two.eta for one, two in pairwise(chosen) if as_array(one) @ as_array(two) < 0]


def random_walk(steps=2000, step=STEP_OF_THE_WALK):
    """Return the quaternions, eta >= 0, of an orientation that wanders everywhere."""
    walk = [np.eye(3)]
    for x in step * samples.generator(20).normal(size=(steps, 3)) + step * Z:
        walk.append(so3.exp(x) @ walk[-1])
    return [so3.quaternion(R) for R in walk]


@pytest.mark.parametrize("delta", [0.0, 0.05, 0.2, 0.9])
def test_hysteretic_flips_only_beyond_delta_and_never_returns_eta_below_minus_delta(delta):
    chosen = choose_all(SignRule("hysteretic", delta), random_walk())
    lowest = min(Q.eta for Q in chosen)
    assert -delta <= lowest < -delta + STEP_OF_THE_WALK  # and it gets there
    assert min(after_flips(chosen)) > delta


def test_only_shortest_chatters_under_noise_and_only_continuous_gets_to_eta_of_minus_one():
    for name, low, jumps in (("shortest", (0.0, 0.1), True), ("continuous", (-1.0, -0.9), False)):
        chosen = choose_all(SignRule(name), random_walk())
        assert low[0] <= min(Q.eta for Q in chosen) < low[1]
        assert bool(after_flips(chosen)) == jumps
    turns = [samples.about(2, math.pi + NOISE * (-1) ** n) for n in range(100)]
    noise = list(map(so3.quaternion, turns))  # eta >= 0
    for name, count in (("shortest", 99), ("hysteretic", 0), ("continuous", 0)):
        assert len(after_flips(choose_all(SignRule(name), noise))) == count


# Where the sign must not be chosen: on each quaternion apart (E14).
@pytest.mark.parametrize("apart", [0.1, 1.0, 3.0])
def test_separate_is_the_composition_of_two_quaternions_with_positive_eta(apart):
    negative = 0
    for R_d, R_e in samples.pairs_apart(apart, 30):
        expected = so3.mutual(so3.quaternion(R_e), so3.quaternion(R_d))
        for previous in (None, expected, -expected):  # it has no memory
            Q = SignRule(SEPARATE).mutual(R_e, R_d, previous)
            np.testing.assert_array_equal(as_array(Q), as_array(expected))
        assert_close(expected.R, R_e.T @ R_d)
        negative += expected.eta < 0
    assert negative > 0  # which eta >= 0 of each does not prevent


@pytest.mark.parametrize(("name", "initial"), [*((name, 1) for name in SIGNS), ("continuous", -1)])
def test_the_first_eta_has_the_initial_sign_from_which_only_the_continuous_one_never_flips(
    name, initial
):
    walk, rule = random_walk(), SignRule(name, initial=initial)
    for Q in walk[:50]:
        for given in (Q, -Q):
            np.testing.assert_array_equal(as_array(rule.choose(given, None)), initial * as_array(Q))
    assert (after_flips(choose_all(rule, walk)) == []) == (name == "continuous")


@pytest.mark.parametrize(
    ("kind", "given", "words"),
    [
        (SignRule, ("shortes",), SIGNS),
        *((EulerSequence, (name,), SEQUENCES) for name in ("XYY", "xyz", "XYZX")),
        *(
            (SignRule, ("hysteretic", delta), ("hysteresis", str(delta), "[0, 1)"))
            for delta in (-1e-9, 1.0, math.nan)
        ),
        (SignRule, ("hysteretic", 0.2, -1), ("eta is -1", "expected 1, or -1 with continuous")),
        (SignRule, ("continuous", 0.2, 0), ("eta is 0", "expected 1, or -1")),
    ],
)
def test_impossible_options_are_refused_with_their_value_and_what_is_possible(kind, given, words):
    with pytest.raises(ConfigurationError) as refusal:
        kind(*given)
    assert all(word in str(refusal.value) for word in words)
    if len(given) == 1:
        assert isinstance(refusal.value, UnknownNameError)
        assert f"'{given[0]}'" in str(refusal.value)


# --- Euler angles, eqs. (2), (3) ----------------------------------------------------------
def assert_extracts(sequence, R, previous=None):
    """Assert that R(extract(R)) = R, and return the angles."""
    phi = EulerSequence(sequence).extract(R, previous)
    assert_close(samples.by_angles(sequence, *phi), R)
    return phi


def test_there_are_the_12_sequences_whose_neighbours_differ():
    letters = itertools.product("XYZ", repeat=3)
    assert sorted(SEQUENCES) == [i + j + k for i, j, k in letters if i != j and j != k]


@every_sequence
def test_R_is_the_product_of_elementary_rotations_T_makes_omega_of_rates_and_dT_is_its_rate(
    sequence,
):
    euler = EulerSequence(sequence)
    angles = samples.generator(10, 0).uniform(-math.pi, math.pi, size=(FEW, 3))  # beta too
    for phi, dphi in zip(angles, samples.vectors(FEW), strict=True):
        R = samples.by_angles(sequence, *phi)
        assert_close(euler.R(phi), R)  # eq. (2)
        dR = samples.derivative(
            lambda t, phi=phi, dphi=dphi: samples.by_angles(sequence, *(phi + t * dphi))
        )
        assert_close(dR, so3.S(euler.T(phi) @ dphi) @ R, DIFFERENCES)  # eqs. (1), (3)
        assert_close(euler.dT(phi, dphi), samples.dT_of(sequence, phi, dphi))


@every_sequence
def test_rates_invert_T_and_extraction_returns_angles_in_their_principal_range(sequence):
    euler, (lower, upper) = EulerSequence(sequence), samples.poles(sequence)
    low, high = [-math.pi, lower + 0.05, -math.pi], [math.pi, upper - 0.05, math.pi]
    angles = samples.generator(11).uniform(low, high, size=(FEW, 3))  # off the poles
    for phi, omega in zip(angles, samples.vectors(FEW), strict=True):
        assert_close(euler.T(phi) @ euler.rates(phi, omega), omega)
        assert_close(euler.extract(samples.by_angles(sequence, *phi)), phi)


@every_sequence
def test_the_rates_at_a_pole_are_refused_with_the_way_out_or_unbounded(sequence):
    euler, refusals = EulerSequence(sequence), []
    for pole in samples.poles(sequence):
        phi = np.array([0.4, pole, -0.9])
        omega = np.cross(*euler.T(phi).T[:2])
        try:
            rates = euler.rates(phi, omega)
        except SingularityError as error:
            refusals.append(str(error))
            continue
        assert np.abs(rates).max() > UNBOUNDED
    assert refusals or sequence[0] != sequence[2]  # T(0) is exactly singular
    assert all(re.search(f"{sequence}.*euler_parameters", text) for text in refusals)


@every_sequence
def test_extraction_inverts_R_everywhere_and_it_and_the_distance_are_accurate_at_poles(sequence):
    euler = EulerSequence(sequence)
    for R in samples.all_rotations():
        assert_extracts(sequence, R)
        clearance = samples.pole_clearance(sequence, R)  # of the first and the last axis
        assert euler.pole_distance(R) == pytest.approx(clearance, abs=ASIN)
    for pole, distance in itertools.product(samples.poles(sequence), samples.POLE_DISTANCES):
        for key, R in enumerate(samples.near_pole(sequence, pole, distance)):
            phi = assert_extracts(sequence, R)
            assert abs(phi[1] - pole) == pytest.approx(distance, abs=RELATIVE)
            assert euler.pole_distance(R) == pytest.approx(distance, abs=RELATIVE)
            (turn,) = samples.uniform(1, key)
            assert_extracts(sequence, turn.T @ (turn @ R))  # the same but for rounding


@every_sequence
def test_of_the_previous_angles_only_gamma_is_kept_and_only_at_the_pole(sequence):
    previous, euler = np.array([0.1, 0.2, -2.3]), EulerSequence(sequence)
    for pole in samples.poles(sequence):
        for R in samples.near_pole(sequence, pole, distance=0.0):
            assert assert_extracts(sequence, R, previous)[2] == previous[2]
            assert assert_extracts(sequence, R)[2] == 0.0
    for R in samples.clear_of_poles(sequence, FEW):
        np.testing.assert_array_equal(euler.extract(R, previous), euler.extract(R))
