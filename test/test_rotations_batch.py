"""What is calculated for many samples at once is what is calculated for one after the other."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tolerances import assert_close

from eulerparams_control.laws import rotations, rotations_batch
from eulerparams_control.laws.impedance_matrices import Impedance
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


def each_of(one: Callable[..., Any], *samples: Array) -> list[Any]:
    """Return what is calculated for one sample after the other."""
    return [one(*sample) for sample in zip(*samples, strict=True)]


@pytest.mark.parametrize("seed", [1, 2])
def test_what_rotations_of_many_are_is_what_those_of_each_are(seed):
    R, other = rotations_everywhere(seed), rotations_everywhere(seed + 4)
    eta, eps = Q = rotations_batch.quaternions(R)
    expected = rotations_batch.stack(each_of(EulerParameters.from_R, R))
    np.testing.assert_allclose(eta, expected.eta, **EXACT)
    np.testing.assert_allclose(eps, expected.eps, **EXACT)
    assert_close(rotations_batch.matrices(eta, eps), R, 2e-15)
    for sign in (1, -1):
        signed = EulerParameters(sign * Q.eta, sign * Q.eps)
        each = each_of(lambda *Q: rotations.rotation_vector(EulerParameters(*Q)), *signed)
        assert_close(rotations_batch.rotation_vectors(signed), each, 2e-14)
    angles = rotations_batch.angles_between(R, other)
    np.testing.assert_allclose(angles, each_of(rotations.angle_between, R, other), **EXACT)
    x = np.random.default_rng(seed).normal(size=(200, 3))
    x[:50] *= 1e-5
    x[0] = 0
    np.testing.assert_allclose(rotations_batch.exps(x), each_of(exp, x), **EXACT)


def test_body_rates_of_many_are_those_of_each():
    rng = np.random.default_rng(7)
    x, dx, ddx = rng.normal(size=(3, 200, 3))
    x[:60] *= 1e-3
    omega, domega = rotations_batch.body_rates_of(x, dx, ddx)
    each = [rotations.body_rates(*one) for one in zip(x, dx, ddx, strict=True)]
    np.testing.assert_allclose(omega, [one[0] for one in each], rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(domega, [one[1] for one in each], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("name", SEQUENCES)
def test_euler_angles_of_many_are_those_of_each(name):
    sequence, R = EulerSequence(name), rotations_everywhere(8)
    phi, each, previous = sequence.extracts(R), [], None
    for one in R:
        previous = sequence.extract(one, previous)
        each.append(previous)
    assert_close(phi, each, 1e-9)  # next to a pole: its last bits
    assert_close([sequence.R(one) for one in phi], R, 4e-15)
    np.testing.assert_allclose(sequence.Ts(phi), [sequence.T(one) for one in phi], **EXACT)
    distances = [sequence.pole_distance(one) for one in R]
    assert_close(sequence.pole_distances(R), distances, 3e-8)  # arcsin at 1


OPTIONS = [
    OrientationOptions(EulerSequence("XYZ"), SignRule("hysteretic", 0.2)),
    OrientationOptions(EulerSequence("ZYZ"), SignRule("continuous", 0.2, -1)),
    OrientationOptions(EulerSequence("YXZ"), SignRule("shortest")),
    OrientationOptions(EulerSequence("XYX"), SignRule("hysteretic", 0.0)),
    OrientationOptions(EulerSequence("ZXZ"), SignRule("separate")),
]


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("name", sorted(OrientationRepresentation.registry))
def test_displacements_of_many_are_those_of_each(name, options):
    def assert_same(found: Any, expected: Any) -> None:
        if isinstance(expected, tuple):
            assert type(found) is type(expected)
            for one, other in zip(found, expected, strict=True):
                assert_same(one, other)
        else:
            assert_close(found, expected)

    orientation = representation(name, options)
    R_d, R_e = path(9), path(10)
    each = OrientationRepresentation.displacements(orientation, R_d, R_e)
    assert_same(orientation.displacements(R_d, R_e), each)
    begin = orientation.displacements(R_d[:700], R_e[:700])
    rest = orientation.displacements(R_d[700:], R_e[700:], rotations_batch.sample(begin, -1))
    assert_close(rest.error, each.error[700:])
    eta = np.asarray(SignRule("hysteretic", 0.2).mutuals(R_e, R_d, None).eta)
    assert (np.diff(np.sign(eta)) != 0).sum() > 10  # the walk makes the sign flip


@pytest.mark.parametrize("name", ["euler_parameters", "angle_axis", "rotation_vector"])
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
