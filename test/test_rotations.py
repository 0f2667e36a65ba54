"""Section II: rotation matrices and Euler parameters, eqs. (1), (4)-(17)."""

import math

import numpy as np
import pytest
from samples import (
    about,
    all_rotations,
    derivative,
    pairs_apart,
    rodrigues,
    turning,
    uniform,
    unit_vectors,
    vectors,
)
from tolerances import ALGEBRAIC, DIFFERENCES, ETA_NEAR_PI, RELATIVE, assert_close

from eulerparams_control.laws.rotations import (
    SMALL_ANGLE,
    SMALL_JACOBIAN_ANGLE,
    EulerParameters,
    R_angle_axis,
    R_axis,
    S,
    angle_between,
    body_rates,
    chord,
    cross,
    exp,
    log,
    mutual,
    mutual_R,
    product,
    propagation,
    right_jacobian,
    rotation_vector,
)

X, Y, Z = np.eye(3)
COUNT = 100

# Angles [rad] at which each formula of theta is tried; their signs matter.
ANGLES = (0.0, 1e-9, 1e-4, 0.5, math.pi / 2, 2.5, math.pi - 1e-9, math.pi, -1e-7, -1.0, -3.0)

# Angles [rad] over which the logarithm keeps its relative accuracy.
LOG_ANGLES = (1e-12, 1e-9, 1e-7, 0.99e-4, 1.01e-4, 1.99e-4, 2.01e-4, 0.1, 1.0, 3.0, 3.1415)


def random_parameters(count, key=0):
    """Return Euler parameters uniform on the sphere, of either sign of eta."""
    quaternions = np.random.default_rng(key).normal(size=(count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    return [EulerParameters(float(q[0]), q[1:]) for q in quaternions]


def as_array(Q):
    return np.array([Q.eta, *Q.eps])


# --- eqs. (1), (2): skew-symmetric operator, elementary rotations ---------------------------


def test_S_and_cross_perform_the_cross_product():
    for v, w in zip(vectors(COUNT), vectors(COUNT, key=1), strict=True):
        assert_close(S(v) @ w, np.cross(v, w))
        assert_close(cross(v, w), np.cross(v, w))
        np.testing.assert_array_equal(S(v), -S(v).T)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_elementary_rotations_turn_about_their_axis(axis):
    for angle in ANGLES:
        assert_close(R_axis(axis, np.array(angle)), about(axis, angle))


# --- eqs. (4)-(7): angle and axis, Euler parameters --------------------------------------------


@pytest.mark.parametrize("theta", ANGLES)
def test_R_and_euler_parameters_of_angle_and_axis_are_their_formulas(theta):
    for r in [X, Y, Z, *unit_vectors(20)]:
        assert_close(R_angle_axis(theta, r), rodrigues(theta, r))  # eq. (4)
        eta, eps = Q = EulerParameters.from_angle_axis(theta, r)
        assert eta == pytest.approx(math.cos(theta / 2), abs=ALGEBRAIC)  # eq. (5)
        np.testing.assert_allclose(eps, math.sin(theta / 2) * r, rtol=RELATIVE)  # eq. (5)
        assert eta**2 + eps @ eps == pytest.approx(1.0, abs=ALGEBRAIC)  # eq. (6)
        assert eta >= 0  # abs(theta) <= pi
        assert_close(Q.R, rodrigues(theta, r))  # eq. (7)


def test_both_signs_of_the_euler_parameters_are_the_same_rotation():
    for Q in random_parameters(COUNT):
        np.testing.assert_array_equal(as_array(-Q), -as_array(Q))
        np.testing.assert_array_equal((-Q).R, Q.R)
        assert (-Q).theta == Q.theta


def test_extraction_inverts_eq_7_at_every_angle():
    for R in all_rotations():
        Q = EulerParameters.from_R(R)
        assert_close(Q.R, R)
        assert Q.eta >= 0
        assert Q.eta**2 + Q.eps @ Q.eps == pytest.approx(1.0, abs=ALGEBRAIC)  # eq. (6)


@pytest.mark.parametrize("gap", [1e-12, 1e-9, 1e-6])
def test_extraction_just_below_pi_keeps_the_side_of_the_axis(gap):
    for r in [X, -Y, Z, *unit_vectors(30)]:
        eta, eps = EulerParameters.from_R(rodrigues(math.pi - gap, r))
        assert eta == pytest.approx(gap / 2, rel=ETA_NEAR_PI)
        assert_close(eps, r)


@pytest.mark.parametrize("theta", [1e-15, 1e-12, 1e-9, 1e-6, 1e-3])
def test_extraction_keeps_small_angles_to_relative_accuracy(theta):
    for r in unit_vectors(50):
        eps = EulerParameters.from_R(rodrigues(theta, r)).eps
        np.testing.assert_allclose(eps, math.sin(theta / 2) * r, rtol=ALGEBRAIC, atol=0)


@pytest.mark.parametrize("theta", [1e-12, 1e-9, 1e-4, 1.0, 3.0, math.pi - 1e-9, math.pi])
def test_theta_is_accurate_at_every_angle_and_for_both_signs(theta):
    for r in unit_vectors(10):
        Q = EulerParameters.from_angle_axis(theta, r)
        assert Q.theta == pytest.approx(theta, rel=RELATIVE)
        assert (-Q).theta == Q.theta


def test_propagation_rule_is_the_derivative_of_the_euler_parameters():
    for Q, omega in zip(random_parameters(COUNT), vectors(COUNT, key=1), strict=True):
        R = turning(Q.R, omega)

        def of_sign_of_Q(t, R=R, Q=Q):
            Q_t = as_array(EulerParameters.from_R(R(t)))
            return Q_t * np.sign(Q_t @ as_array(Q))

        deta, deps = propagation(Q, omega)
        expected = derivative(of_sign_of_Q)
        assert deta == pytest.approx(expected[0], abs=DIFFERENCES)  # eq. (8)
        assert_close(deps, expected[1:], DIFFERENCES)  # eq. (9)


def test_composition_is_the_mutual_rotation():
    for R_1, R_2 in zip(all_rotations(), reversed(all_rotations()), strict=True):
        Q_1, Q_2 = EulerParameters.from_R(R_1), EulerParameters.from_R(R_2)
        composed = mutual(Q_1, Q_2)  # eqs. (12), (13)
        assert_close(composed.R, R_1.T @ R_2)  # eq. (11)


def test_mutual_parameters_are_those_of_eqs_12_and_13():
    Q_1 = EulerParameters(0.5, np.array([0.5, 0.5, 0.5]))
    Q_2 = EulerParameters(0.6, np.array([0.0, 0.8, 0.0]))
    eta, eps = mutual(Q_1, Q_2)
    assert eta == pytest.approx(0.7, abs=ALGEBRAIC)
    assert_close(eps, [0.1, 0.1, -0.7])


def test_mutual_of_two_matrices_has_positive_eta_and_is_of_frame_2_in_frame_1():
    for R_1, R_2 in zip(uniform(COUNT), uniform(COUNT, key=1), strict=True):
        Q = mutual_R(R_1, R_2)
        assert Q.eta >= 0
        assert_close(R_1 @ Q.R, R_2)  # eq. (11)


def test_product_composes_and_conjugate_inverts():
    for Q_1, Q_2 in zip(random_parameters(COUNT), random_parameters(COUNT, key=1), strict=True):
        assert_close(product(Q_1, Q_2).R, Q_1.R @ Q_2.R)
        assert_close(Q_1.conjugate.R, Q_1.R.T)
        identity = as_array(product(Q_1, Q_1.conjugate))
        assert_close(identity, [1, 0, 0, 0])


def test_product_of_unit_quaternions_obeys_the_rule_of_hamilton():
    i, j, k = (EulerParameters(0.0, axis) for axis in (X, Y, Z))
    np.testing.assert_array_equal(as_array(product(i, j)), as_array(k))
    np.testing.assert_array_equal(as_array(product(i, i)), [-1, 0, 0, 0])


# --- exponential and logarithm ---------------------------------------------------------------


@pytest.mark.parametrize("theta", [*LOG_ANGLES, SMALL_ANGLE, 4.0, 7.0])
def test_exp_is_the_rotation_by_the_length_about_the_direction(theta):
    for r in unit_vectors(20):
        assert_close(exp(theta * r), rodrigues(theta, r))


@pytest.mark.parametrize("theta", LOG_ANGLES)
def test_log_inverts_exp_to_relative_accuracy(theta):
    for r in unit_vectors(50):
        error = np.linalg.norm(log(exp(theta * r)) - theta * r)
        assert error / theta < ALGEBRAIC


def test_exp_inverts_log_at_every_angle():
    for R in all_rotations():
        assert_close(exp(log(R)), R)
        assert np.linalg.norm(log(R)) <= math.pi + ALGEBRAIC


def test_log_and_exp_of_no_rotation_are_exact():
    np.testing.assert_array_equal(log(np.eye(3)), np.zeros(3))
    np.testing.assert_array_equal(exp(np.zeros(3)), np.eye(3))


@pytest.mark.parametrize("theta", LOG_ANGLES)
def test_rotation_vector_is_theta_r_and_of_negative_eta_the_long_way_round(theta):
    for r in unit_vectors(20):
        Q = EulerParameters.from_angle_axis(theta, r)
        np.testing.assert_allclose(rotation_vector(Q), theta * r, rtol=RELATIVE, atol=0)
        assert_close(rotation_vector(-Q), -(2 * math.pi - theta) * r)


def test_rotation_vector_of_no_rotation_is_zero_for_both_signs():
    identity = EulerParameters(1.0, np.zeros(3))
    np.testing.assert_array_equal(rotation_vector(identity), np.zeros(3))
    np.testing.assert_array_equal(rotation_vector(-identity), np.zeros(3))


# Angles [rad] on both sides of where the series of the right Jacobian ends.
JACOBIAN_ANGLES = (
    *(0.0, 1e-6, 0.01, 0.999 * SMALL_JACOBIAN_ANGLE, 1.001 * SMALL_JACOBIAN_ANGLE),
    *(1.0, 3.0, math.pi, 5.0),
)


def series_of_the_right_jacobian(x):
    """Return the sum of (-S(x))^n / (n + 1)! (3, 3)."""
    term, total = np.eye(3), np.eye(3)
    for n in range(1, 50):
        term = term @ -S(x) / (n + 1)
        total = total + term
    return total


@pytest.mark.parametrize("theta", JACOBIAN_ANGLES)
def test_the_right_jacobian_is_its_series(theta):
    for r in unit_vectors(20):
        assert_close(right_jacobian(theta * r), series_of_the_right_jacobian(theta * r))


@pytest.mark.parametrize("theta", JACOBIAN_ANGLES)
def test_the_body_rates_are_those_of_the_right_jacobian_and_its_derivative(theta):
    for r, dx, ddx in zip(unit_vectors(20), vectors(20), vectors(20)[::-1], strict=True):
        x = theta * r
        dJ_r = derivative(lambda t, x=x, dx=dx: series_of_the_right_jacobian(x + t * dx))
        J_r = series_of_the_right_jacobian(x)
        omega, domega = body_rates(x, dx, ddx)
        assert_close(omega, J_r @ dx)
        assert_close(domega, J_r @ ddx + dJ_r @ dx, DIFFERENCES)


def test_the_body_rates_do_not_jump_where_the_series_ends():
    for r, dx in zip(unit_vectors(50), vectors(50), strict=True):
        below, above = (
            body_rates(SMALL_JACOBIAN_ANGLE * (1 + side) * r, dx, dx) for side in (-1e-14, 1e-14)
        )
        assert_close(below, above)


@pytest.mark.parametrize("theta", [1e-9, 1e-3, 0.7, 2.0, math.pi - 1e-6, math.pi])
def test_angle_between_two_frames_is_the_angle_of_their_mutual_rotation(theta):
    for R_2, R_1 in pairs_apart(theta, 20):
        assert angle_between(R_1, R_2) == pytest.approx(theta, abs=ALGEBRAIC)
        assert angle_between(R_2, R_1) == pytest.approx(theta, abs=ALGEBRAIC)
        assert chord(R_1, R_2) == pytest.approx(2 * math.sin(theta / 2), abs=1e-7)
