"""Mass, damping and stiffness: what is accepted, task axes (53), (63), damping by a ratio."""

import math

import numpy as np
import pytest
from samples import generator, positive_definite, uniform, unit_vectors, vectors
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

every_matrix = pytest.mark.parametrize("name", MATRICES)


def impedance(**given):
    """Return an impedance of unit matrices, but for those given."""
    return Impedance(**{**dict.fromkeys(MATRICES, I), **given})


def semidefinite(count, key=0):
    """Return symmetric matrices (3, 3) of which one eigenvalue is zero up to rounding."""
    flat = [np.diag([0.0, *v]) for v in generator(700, key).uniform(1, 9, size=(count, 2))]
    return [U @ values @ U.T for U, values in zip(uniform(count, 701 + key), flat, strict=True)]


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
@pytest.mark.parametrize("name", ["D", "K"])
def test_no_damping_or_stiffness_along_an_axis_is_accepted(name):
    for matrix in [np.zeros((3, 3)), np.diag([1000.0, 0.0, 1000.0]), *semidefinite(COUNT)]:
        np.testing.assert_array_equal(getattr(impedance(**{name: matrix}), name), matrix)


@every_matrix
def test_rounding_is_no_lack_of_symmetry(name):
    for A, B in zip(positive_definite(COUNT, 3), uniform(COUNT, 4), strict=True):
        rounded = B @ A @ B.T  # not symmetric to the bit
        impedance(**{name: 1e4 * rounded})


def with_value(value, *where):
    """Return I with a value at a place and its mirror image."""
    matrix = I.copy()
    matrix[where] = matrix[where[::-1]] = value
    return matrix


SKEWED = [3 * I + U @ (1e-6 * np.outer(I[0], I[1])) @ U.T for U in uniform(COUNT)]
NEGATIVE = {
    value: [(A + A.T) / 2 for A in (U @ np.diag([value, 1, 2]) @ U.T for U in uniform(10, 5))]
    for value in (-1e-3, -1.0)
}


@every_matrix
@pytest.mark.parametrize(
    ("matrices", "text"),
    [
        (SKEWED, " is not symmetric"),
        *((matrices, f" .*{value:.3g}") for value, matrices in NEGATIVE.items()),
        *(
            ([with_value(value, *where)], " is ")
            for value in (math.nan, math.inf, -math.inf)
            for where in ((0, 0), (0, 2), (2, 1))
        ),
        *(([np.ones(shape)], " is ") for shape in ((3,), (2, 2), (3, 4), (6, 6), ())),
    ],
)
def test_a_matrix_that_is_none_of_an_impedance_is_refused(name, matrices, text):
    for matrix in matrices:
        with pytest.raises(ConfigurationError, match=f"^{name}{text}"):
            impedance(**{name: matrix})


@pytest.mark.parametrize(
    "M", [np.zeros((3, 3)), np.diag([1.0, 0.0, 1.0]), np.ones((3, 3))], ids=["0", "axis", "ones"]
)
def test_a_mass_that_is_none_along_an_axis_is_refused(M):
    with pytest.raises(ConfigurationError, match="M is not positive definite"):
        impedance(M=M)


# --- what follows from them -------------------------------------------------------------------
def test_the_rate_is_that_of_the_fastest_mode():
    for M, D, K in zip(*(positive_definite(COUNT, key) for key in (6, 7, 8)), strict=True):
        Z = Impedance(M, D, K)
        assert Z.rate == pytest.approx(np.abs(poles_of(Z)).max(), rel=MODES)


def test_other_coordinates_have_the_same_energy_power_and_rate():
    samples = zip(*(positive_definite(COUNT, key) for key in (9, 10, 11)), strict=True)
    for Z, y, T in zip(map(Impedance, *zip(*samples, strict=True)), vectors(COUNT), uniform(COUNT),
                       strict=True):  # fmt: skip
        stretched = T @ np.diag([0.5, 1.0, 2.0])
        other, x = Z.transformed(stretched), stretched @ y
        for name in MATRICES:
            expected = x @ getattr(Z, name) @ x
            assert y @ getattr(other, name) @ y == pytest.approx(expected, rel=ALGEBRAIC)
        assert other.rate == pytest.approx(Z.rate, rel=MODES)


def test_the_least_mass_and_damping_are_those_of_the_worst_axis_and_mode():
    samples = zip(positive_definite(COUNT, 20), positive_definite(COUNT, 21), strict=True)
    for M, D in samples:
        Z, directions = Impedance(M, D, I), np.array(unit_vectors(200))
        quotients = np.einsum("ni,ij,nj->n", directions, M, directions)
        assert Z.least_mass <= quotients.min()
        assert Z.least_mass == pytest.approx(1 / np.linalg.norm(np.linalg.inv(M), 2))
        rates, _ = generalized_modes(M, D)  # D v = rate M v
        assert Z.least_damping == pytest.approx(rates[0], rel=1e-9)
    assert Impedance(I, np.diag([1.0, 0.0, 2.0]), I).least_damping == pytest.approx(0, abs=1e-12)


# --- matrices of a few numbers, eqs. (53), (63) -------------------------------------------------
def test_three_numbers_are_the_diagonal_and_six_the_upper_half():
    np.testing.assert_array_equal(symmetric_matrix("K", [1, 2, 3]), np.diag([1.0, 2.0, 3.0]))
    expected = [[1.0, 2.0, 3.0], [2.0, 4.0, 5.0], [3.0, 5.0, 6.0]]
    np.testing.assert_array_equal(symmetric_matrix("K", [1, 2, 3, 4, 5, 6]), expected)


def test_with_axes_a_displacement_along_one_gives_a_force_along_it():  # (53), (54), (63)
    axes = [U * side for U in uniform(COUNT) for side in ([1, 1, 1], [1, 1, -1])]  # of either hand
    for U, gamma in zip(axes, generator(710).uniform(0, 900, (2 * COUNT, 3)), strict=True):
        K = symmetric_matrix("K_p", gamma.tolist(), U.T.ravel().tolist())
        for i, length in enumerate([0.02, -0.3, 1.0]):
            assert_close(K @ (length * U[:, i]), gamma[i] * length * U[:, i], 1e-9)


def test_axes_printed_with_4_digits_keep_the_values_exactly():
    for U in uniform(COUNT, 13):
        K = symmetric_matrix("K", [20, 50, 100], np.round(U.T, 4).ravel().tolist())
        np.testing.assert_allclose(np.linalg.eigvalsh(K), [20, 50, 100], rtol=ALGEBRAIC)
        off = K @ U - U * [20, 50, 100]
        assert_close(off, 0, 100 * AXES_OF_4_DIGITS)


ONES = [1.0] * 3


@pytest.mark.parametrize(
    ("given", "text"),
    [
        *(([[1.0] * n], rf"K_o has {n} values; expected 3.*6: xx, xy") for n in (0, 1, 2, 4, 5, 7)),
        ([[1.0] * 6, I.ravel()], r"K_o has 6 values; .*without axes"),
        *(([ONES, [1.0] * n], f"K_o_axes has {n} values; expected 9") for n in (1, 3, 8, 10)),
        *(
            ([ONES, np.ravel(axes)], r"K_o_axes are .*expected three unit vectors")
            for axes in (
                2 * I,
                0 * I,
                [[1, 0, 0], [0, 1, 0], [0, 1, 0]],  # one of them twice
                [[1, 0.01, 0], [0, 1, 0], [0, 0, 1]],
                [[1, 0, 0], [0, 1, 0], [0, 0, math.nan]],
            )
        ),
    ],
)
def test_values_and_axes_that_make_no_matrix_are_refused_with_what_is_expected(given, text):
    with pytest.raises(ConfigurationError, match=text):
        symmetric_matrix("K_o", *map(list, given))


# --- damping by a ratio -------------------------------------------------------------------------
@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.7, 1.0, 2.0])
def test_each_mode_has_the_damping_ratio(ratio):
    for M, K in zip(positive_definite(COUNT, 14), positive_definite(COUNT, 15), strict=True):
        D = damping_of_ratio(M, 100 * K, ratio)
        squares, V = generalized_modes(M, 100 * K)
        expected = np.diag(2 * ratio * np.sqrt(squares))  # v'' + 2 ratio omega v' + omega^2 v = 0
        assert_close(V.T @ D @ V, expected, 1e2 * ALGEBRAIC)
        np.testing.assert_array_equal(D, D.T)


def test_a_motion_without_stiffness_gets_no_damping():
    for M, K in zip(positive_definite(COUNT, 18), semidefinite(COUNT, 19), strict=True):
        D = damping_of_ratio(M, K, 0.7)
        free = np.linalg.eigh(K)[1][:, 0]
        assert abs(free @ D @ free) < DISTINCT**2 * np.abs(D).max()
        Impedance(M, D, K)  # accepted
