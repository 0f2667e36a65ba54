"""What is calculated for many samples at once is what is calculated for one after the other."""

import numpy as np
import pytest

from eulerparams_control.laws import rotations, rotations_batch
from eulerparams_control.laws.orientation import (
    EulerSequence,
    OrientationOptions,
    OrientationRepresentation,
    SignRule,
    representation,
)
from eulerparams_control.laws.orientation.sequences import SEQUENCES
from eulerparams_control.laws.rotations import Array, EulerParameters, exp

EXACT = {"rtol": 0, "atol": 4e-15}


def rotations_everywhere(seed: int, count: int = 300) -> Array:
    """Rotations spread uniformly, near identity, near half turns, and on and near the poles."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    angles = rng.uniform(0, np.pi, count)
    angles[::5] = 1e-7 * rng.uniform(size=len(angles[::5]))
    angles[1::5] = np.pi - 1e-7 * rng.uniform(size=len(angles[1::5]))
    axes[2::10], angles[2::10] = np.eye(3)[rng.integers(0, 3, len(axes[2::10]))], np.pi / 2
    R = np.array([exp(angle * axis) for angle, axis in zip(angles, axes, strict=True)])
    R[7] = np.eye(3)
    R[8] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # exactly on a pole of XYZ
    R[9] = np.diag([1.0, -1.0, -1.0])  # and of ZYZ
    return R


def path(seed: int, count: int = 2000) -> Array:
    """A walk over all orientations, in small steps."""
    rng = np.random.default_rng(seed)
    R, walk = np.eye(3), []
    for _ in range(count):
        R = R @ exp(0.2 * rng.normal(size=3))
        walk.append(R)
    return np.array(walk)


@pytest.mark.parametrize("seed", [1, 2])
def test_quaternions_of_many_are_those_of_each(seed: int) -> None:
    R = rotations_everywhere(seed)
    Q = rotations_batch.quaternions(R)
    expected = rotations_batch.stack([EulerParameters.from_R(one) for one in R])
    np.testing.assert_allclose(Q.eta, expected.eta, **EXACT)
    np.testing.assert_allclose(Q.eps, expected.eps, **EXACT)
    np.testing.assert_allclose(rotations_batch.matrices(Q.eta, Q.eps), R, rtol=0, atol=2e-15)


def test_exponentials_of_many_are_those_of_each() -> None:
    x = np.random.default_rng(3).normal(size=(200, 3))
    x[:50] *= 1e-5
    x[0] = 0
    np.testing.assert_allclose(rotations_batch.exps(x), [exp(one) for one in x], **EXACT)


@pytest.mark.parametrize("sign", [1, -1])
def test_rotation_vectors_of_many_are_those_of_each(sign: int) -> None:
    Q = rotations_batch.quaternions(rotations_everywhere(4))
    Q = EulerParameters(sign * Q.eta, sign * Q.eps)
    each = [
        rotations.rotation_vector(EulerParameters(eta, eps))
        for eta, eps in zip(Q.eta, Q.eps, strict=True)
    ]
    np.testing.assert_allclose(rotations_batch.rotation_vectors(Q), each, rtol=0, atol=2e-14)


def test_angles_between_many_are_those_between_each() -> None:
    R_1, R_2 = rotations_everywhere(5), rotations_everywhere(6)
    each = [rotations.angle_between(a, b) for a, b in zip(R_1, R_2, strict=True)]
    np.testing.assert_allclose(rotations_batch.angles_between(R_1, R_2), each, **EXACT)


def test_body_rates_of_many_are_those_of_each() -> None:
    rng = np.random.default_rng(7)
    x, dx, ddx = rng.normal(size=(3, 200, 3))
    x[:60] *= 1e-3
    omega, domega = rotations_batch.body_rates_of(x, dx, ddx)
    each = [rotations.body_rates(*one) for one in zip(x, dx, ddx, strict=True)]
    np.testing.assert_allclose(omega, [one[0] for one in each], rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(domega, [one[1] for one in each], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("name", SEQUENCES)
def test_euler_angles_of_many_are_those_of_each(name: str) -> None:
    sequence, R = EulerSequence(name), rotations_everywhere(8)
    phi, each, previous = sequence.extracts(R), [], None
    for one in R:
        previous = sequence.extract(one, previous)
        each.append(previous)
    np.testing.assert_allclose(phi, each, rtol=0, atol=1e-9)  # next to a pole: its last bits
    np.testing.assert_allclose([sequence.R(one) for one in phi], R, rtol=0, atol=4e-15)
    np.testing.assert_allclose(sequence.Ts(phi), [sequence.T(one) for one in phi], **EXACT)
    distances = [sequence.pole_distance(one) for one in R]
    np.testing.assert_allclose(sequence.pole_distances(R), distances, atol=3e-8)  # arcsin at 1


OPTIONS = [
    OrientationOptions(EulerSequence("XYZ"), SignRule("hysteretic", 0.2)),
    OrientationOptions(EulerSequence("ZYZ"), SignRule("continuous", 0.2, -1)),
    OrientationOptions(EulerSequence("YXZ"), SignRule("shortest")),
    OrientationOptions(EulerSequence("XYX"), SignRule("hysteretic", 0.0)),
    OrientationOptions(EulerSequence("ZXZ"), SignRule("separate")),
]


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("name", sorted(OrientationRepresentation.registry))
def test_displacements_of_many_are_those_of_each(name: str, options: OrientationOptions) -> None:
    orientation = representation(name, options)
    R_d, R_e = path(9), path(10)
    each = OrientationRepresentation.displacements(orientation, R_d, R_e)
    _assert_close(orientation.displacements(R_d, R_e), each)
    begin = orientation.displacements(R_d[:700], R_e[:700])
    rest = orientation.displacements(R_d[700:], R_e[700:], rotations_batch.sample(begin, -1))
    _assert_close(rest.error, each.error[700:])


def test_the_walk_makes_the_sign_flip() -> None:
    Q = SignRule("hysteretic", 0.2).mutuals(path(10), path(9), None)
    assert (np.asarray(Q.eta) < 0).any()
    assert (np.diff(np.sign(Q.eta)) != 0).sum() > 10


@pytest.mark.parametrize("name", ["euler_parameters", "angle_axis", "rotation_vector"])
def test_lyapunov_functions_of_many_are_those_of_each(name: str) -> None:
    from eulerparams_control.laws.impedance_matrices import Impedance

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


def _assert_close(found: object, expected: object) -> None:
    if isinstance(expected, tuple):
        assert type(found) is type(expected)
        for one, other in zip(found, expected, strict=True):  # type: ignore[call-overload]
            _assert_close(one, other)
    else:
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
