"""N samples in stacks: a loop over the functions of one sample.

Notation: ``R`` (N, 3, 3) rotation matrices, NaN where there is none.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from eulerparams_control.laws.orientation import EulerSequence, OrientationRepresentation
from eulerparams_control.laws.rotations import Array, angle_between, log, quaternion


def over(function: Callable[..., Any], *stacks: Any, shape: tuple[int, ...] = ()) -> Array:
    """Return the values (N, ...) of a function of one sample of each stack.

    Args:
        function: returns an array of ``shape``.
        stacks: N samples each.
        shape: of one value.
    """
    values = [function(*samples) for samples in zip(*stacks, strict=True)]
    return np.array(values).reshape(-1, *shape)


def angles_between(R_1: Array, R_2: Array) -> Array:
    """Return the angles (N,) [rad] in [0, pi] of the rotations from R_1 to R_2."""
    return over(angle_between, R_1, R_2)


def rotation_vectors(R: Array) -> Array:
    """Return theta r (N, 3) [rad], theta in [0, pi]."""
    return over(log, R, shape=(3,))


def quaternions(R: Array) -> Array:
    """Return eta, eps (N, 4) with eta >= 0."""
    parts = map(quaternion, R)
    return over(lambda Q: (Q.eta, *Q.eps.tolist()), parts, shape=(4,))


def euler_angles(sequence: EulerSequence, R: Array) -> Array:
    """Return the angles phi (N, 3) [rad] of successive rotations: at a pole gamma is kept."""
    phi, found = np.zeros(3), np.empty((len(R), 3))
    for i, sample in enumerate(R):
        found[i] = phi = sequence.extract(sample, phi)
    return found


def displacements(
    law: OrientationRepresentation, R_d: Array, R_e: Array, before: Any = None
) -> list[Any]:
    """Return the displacements x_de of N successive samples: each follows from the one before."""
    x_de, found = before, []
    for desired, actual in zip(R_d, R_e, strict=True):
        x_de = law.displacement(desired, actual, x_de)
        found.append(x_de)
    return found
