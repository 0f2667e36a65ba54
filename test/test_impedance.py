"""Mass, damping and stiffness: what is accepted, task axes (53), (63), damping by a ratio."""

import math

import numpy as np
import pytest
from samples import generator, positive_definite, uniform, vectors
from tolerances import ALGEBRAIC, AXES_OF_4_DIGITS, DISTINCT, MODES, assert_close

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.impedance_matrices import (
    Impedance,
    damping_of_ratio,
    symmetric_matrix,
)

I = np.eye(3)
COUNT = 50
MATRICES = ("M", "D", "K")


def impedance(**given):
    """Return an impedance of unit matrices, but for those given."""
    return Impedance(**{**dict.fromkeys(MATRICES, I), **given})


def impedances(key):
    """Return impedances of general matrices."""
    return map(Impedance, *(positive_definite(COUNT, key + i) for i in range(3)))


def with_eigenvalues(count, key, *values):
    """Return symmetric matrices (3, 3) of these eigenvalues, along any axes."""
    return [(A + A.T) / 2 for A in (U @ np.diag(values) @ U.T for U in uniform(count, key))]


def generalized_modes(M, K):
    """Return omega^2 (3,) and V (3, 3) of K v = omega^2 M v with V' M V = I, by Cholesky."""
    L_inverse = np.linalg.inv(np.linalg.cholesky(M))
    squares, Y = np.linalg.eigh(L_inverse @ K @ L_inverse.T)
    return squares, L_inverse.T @ Y


def poles_of(Z):
    """Return the six s of det(M s^2 + D s + K) = 0, by interpolation of that polynomial."""
    nodes = np.exp(2j * np.pi * np.arange(7) / 7) * 3
    values = [np.linalg.det(Z.M * s**2 + Z.D * s + Z.K) for s in nodes]
    return np.roots(np.linalg.solve(np.vander(nodes), values))


# --- what is accepted -----------------------------------------------------------------------
SEMIDEFINITE = [0 * I, np.diag([1000.0, 0.0, 1000.0]), *with_eigenvalues(COUNT, 701, 0.0, 3.0, 7.0)]
ROUNDED = [
    1e4 * B @ A @ B.T for A, B in zip(positive_definite(COUNT, 3), uniform(COUNT, 4), strict=True)
]  # not symmetric to the bit


@pytest.mark.parametrize("name", MATRICES)
def test_rounding_and_no_damping_or_stiffness_along_an_axis_are_accepted(name):
    for matrix in ROUNDED + (SEMIDEFINITE if name != "M" else []):
        np.testing.assert_array_equal(getattr(impedance(**{name: matrix}), name), matrix)


SKEWED = [3 * I + U @ (1e-6 * np.outer(I[0], I[1])) @ U.T for U in uniform(COUNT)]


@pytest.mark.parametrize(
    ("names", "matrices", "text"),
    [
        (MATRICES, SKEWED, "is not symmetric"),
        (MATRICES, with_eigenvalues(10, 5, -1e-3, 1, 2), ".*-0.001"),
        (MATRICES, [np.diag([1.0, 1.0, value]) for value in (math.nan, math.inf)], "is "),
        (MATRICES, map(np.ones, ((3,), (2, 2), (3, 4), (6, 6), ())), "is "),
        ("M", [0 * I, np.diag([1.0, 0.0, 1.0]), np.ones((3, 3))], "is not positive definite"),
    ],
)
def test_a_matrix_that_is_none_of_an_impedance_is_refused(names, matrices, text):
    for matrix in matrices:
        for name in names:
            with pytest.raises(ConfigurationError, match=f"^{name} {text}"):
                impedance(**{name: matrix})


# --- what follows from them -------------------------------------------------------------------
def test_rate_least_mass_and_least_damping_are_those_of_the_extreme_modes():
    for Z in impedances(6):
        assert Z.rate == pytest.approx(np.abs(poles_of(Z)).max(), rel=MODES)
        assert Z.least_mass == pytest.approx(1 / np.linalg.norm(np.linalg.inv(Z.M), 2))
        rates, _ = generalized_modes(Z.M, Z.D)  # D v = rate M v
        assert Z.least_damping == pytest.approx(rates[0], rel=1e-9)
    assert impedance(D=np.diag([1.0, 0.0, 2.0])).least_damping == pytest.approx(0, abs=1e-12)


def test_other_coordinates_have_the_same_energy_power_and_rate():
    for Z, y, U in zip(impedances(9), vectors(COUNT), uniform(COUNT), strict=True):
        T = U @ np.diag([0.5, 1.0, 2.0])
        other, x = Z.transformed(T), T @ y
        for name in MATRICES:
            expected = x @ getattr(Z, name) @ x
            assert y @ getattr(other, name) @ y == pytest.approx(expected, rel=ALGEBRAIC)
        assert other.rate == pytest.approx(Z.rate, rel=MODES)


# --- matrices of a few numbers, eqs. (53), (63) -------------------------------------------------
def test_three_numbers_are_the_diagonal_and_six_the_upper_half():
    np.testing.assert_array_equal(symmetric_matrix("K", [1, 2, 3]), np.diag([1.0, 2.0, 3.0]))
    expected = [[1.0, 2.0, 3.0], [2.0, 4.0, 5.0], [3.0, 5.0, 6.0]]
    np.testing.assert_array_equal(symmetric_matrix("K", [1, 2, 3, 4, 5, 6]), expected)


@pytest.mark.parametrize("hand", [1, -1])
def test_with_axes_a_displacement_along_one_gives_a_force_along_it(hand):  # (53), (54), (63)
    gammas = generator(710).uniform(1, 900, (COUNT, 3))
    for U, gamma in zip(uniform(COUNT), gammas, strict=True):
        axes = U * [1, 1, hand]
        K = symmetric_matrix("K_p", gamma.tolist(), axes.T.ravel().tolist())
        assert_close(K @ axes, axes * gamma, 1e-9)
        printed = np.round(axes.T, 4).ravel().tolist()  # keeps the values exactly
        K = symmetric_matrix("K_p", gamma.tolist(), printed)
        np.testing.assert_allclose(np.linalg.eigvalsh(K), np.sort(gamma), rtol=1e-10)
        assert_close(K @ axes, axes * gamma, gamma.max() * AXES_OF_4_DIGITS)


ONES = [1.0] * 3
NO_AXES = (
    *(2 * I, 0 * I),
    [[1, 0, 0], [0, 1, 0], [0, 1, 0]],  # one of them twice
    *([[1, 0.01, 0], [0, 1, 0], [0, 0, 1]], [[1, 0, 0], [0, 1, 0], [0, 0, math.nan]]),
)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        *(([[1.0] * n], rf"K_o has {n} values; expected 3.*6: xx, xy") for n in (0, 1, 2, 4, 5, 7)),
        ([[1.0] * 6, I.ravel()], r"K_o has 6 values; .*without axes"),
        *(([ONES, [1.0] * n], f"K_o_axes has {n} values; expected 9") for n in (1, 3, 8, 10)),
        *(([ONES, np.ravel(U)], r"K_o_axes are .*expected three unit vectors") for U in NO_AXES),
    ],
)
def test_values_and_axes_that_make_no_matrix_are_refused_with_what_is_expected(given, text):
    with pytest.raises(ConfigurationError, match=text):
        symmetric_matrix("K_o", *map(list, given))


# --- damping by a ratio -------------------------------------------------------------------------
@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.7, 1.0, 2.0])
def test_each_mode_has_the_damping_ratio_and_one_without_stiffness_no_damping(ratio):
    for M, K in zip(positive_definite(COUNT, 14), positive_definite(COUNT, 15), strict=True):
        D = damping_of_ratio(M, 100 * K, ratio)
        squares, V = generalized_modes(M, 100 * K)
        expected = np.diag(2 * ratio * np.sqrt(squares))  # v'' + 2 ratio omega v' + omega^2 v = 0
        assert_close(V.T @ D @ V, expected, 1e2 * ALGEBRAIC)
        np.testing.assert_array_equal(D, D.T)
    for M, K in zip(positive_definite(COUNT, 18), SEMIDEFINITE[2:], strict=True):
        D, free = damping_of_ratio(M, K, ratio), np.linalg.eigh(K)[1][:, 0]
        assert abs(free @ D @ free) <= DISTINCT**2 * np.abs(D).max()
        Impedance(M, D, K)  # accepted
