"""N successive samples in stacks: a loop over the functions of one, or numpy over all.

Notation: ``R``, ``R_d``, ``R_e`` (N, 3, 3) rotation matrices, NaN where there is none; ``before``
the displacement of the sample before the first, or None.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from eulerparams_control.laws.orientation import EulerSequence, OrientationRepresentation
from eulerparams_control.laws.orientation.sequences import wrap
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    angle_between,
    log,
    rotation_vector,
)


def over(function: Callable[..., Any], *stacks: Any, shape: tuple[int, ...] = ()) -> Array:
    """Return the values (N, ...) of a function, each of that shape, of one sample a stack."""
    values = [function(*samples) for samples in zip(*stacks, strict=True)]
    return np.array(values).reshape(-1, *shape)


def angles_between(R_1: Array, R_2: Array) -> Array:
    """Return the angles (N,) [rad] in [0, pi] of the rotations from R_1 to R_2."""
    return over(angle_between, R_1, R_2)


def rotation_vectors(R: Array) -> Array:
    """Return theta r (N, 3) [rad], theta in [0, pi]."""
    return over(log, R, shape=(3,))


def quaternions(Qs: Iterable[EulerParameters]) -> Array:
    """Return eta, eps (N, 4)."""
    return over(lambda Q: (Q.eta, *Q.eps.tolist()), Qs, shape=(4,))


def euler_angles(sequence: EulerSequence, R: Array, before: Array | None = None) -> Array:
    """Return the angles phi (N, 3) [rad]: at a pole gamma is that of the sample before."""
    phi, found = before, np.empty((len(R), 3))
    for i, sample in enumerate(R):
        found[i] = phi = sequence.extract(sample, phi)
    return found


def displacements(
    law: OrientationRepresentation, R_d: Array, R_e: Array, before: Any = None
) -> Iterator[Any]:
    """Yield the displacements x_de: each follows from the one before."""
    x_de = before
    for desired, actual in zip(R_d, R_e, strict=True):
        x_de = law.displacement(desired, actual, x_de)
        yield x_de


_OF_THE_QUATERNION: dict[str, Callable[[Array, Array], Array]] = {
    "angle_axis": lambda eta, eps: 2.0 * eta * eps,
    "euler_parameters": lambda _, eps: eps,
    "modified_rodrigues": lambda eta, eps: 4.0 * eps / np.where(eta == -1.0, np.nan, 1.0 + eta),
    "rodrigues": lambda eta, eps: 2.0 * eps / np.where(eta == 0.0, np.nan, eta),
    "rotation_vector": lambda eta, eps: over(rotation_vector, eta[:, 0], eps, shape=(3,)),
}
"""The error in end-effector axes of eta_de (N, 1) and eps_de_e (N, 3): seven loops take 2 s a
minute of a recording at 1 kHz, this a fifth of it."""


def errors(
    law: OrientationRepresentation, R_d: Array, R_e: Array, Q_de: Array, before: Any = None
) -> Array:
    """Return the errors (N, 3) of the displacements, Q_de (N, 4) eta_de, eps_de_e with its sign."""
    sequence = law.options.sequence
    if law.name == "euler_angles":
        phi_d = euler_angles(sequence, R_d, before and before.phi_d)
        return wrap(phi_d - euler_angles(sequence, R_e, before and before.phi_e))
    if law.name == "relative_euler_angles":
        return euler_angles(sequence, np.swapaxes(R_e, 1, 2) @ R_d, before and before.error)
    if law.name in _OF_THE_QUATERNION:
        vector = _OF_THE_QUATERNION[law.name](Q_de[:, :1], Q_de[:, 1:])
        error: Array = (R_e @ vector[..., None])[..., 0]
        return error
    return over(lambda x: x.error, displacements(law, R_d, R_e, before), shape=(3,))
