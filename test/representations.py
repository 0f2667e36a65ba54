"""The representations of the orientation by name, and motions where their laws are regular."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from samples import Array, angle_rates, generator, rodrigues, uniform, unit_vectors, vectors
from tolerances import POLE_CLEARANCE

from eulerparams_control.laws.orientation import (
    ORIENTATIONS,
    SEQUENCES,
    EulerSequence,
    OrientationOptions,
    OrientationRepresentation,
    SignRule,
    representation,
)
from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
)

every_representation = pytest.mark.parametrize("name", ORIENTATIONS)
every_sequence = pytest.mark.parametrize("sequence", SEQUENCES)
OF_ANGLES = ("euler_angles", "relative_euler_angles")
# Those whose impedance is (59) with a moment of their own: they have V_3.
OF_THE_QUATERNION = tuple(
    name for name in ORIENTATIONS
    if issubclass(OrientationRepresentation.registry[name], RelativeQuaternionRepresentation)
)  # fmt: skip
of_the_quaternion = pytest.mark.parametrize("name", OF_THE_QUATERNION)
# f, df/dtheta and psi of the displacements f(theta) r.
FUNCTIONS = {
    "angle_axis": (math.sin, math.cos, 0.5),
    "euler_parameters": (lambda x: math.sin(x / 2), lambda x: math.cos(x / 2) / 2, 2.0),
    "modified_rodrigues": (lambda x: 4 * math.tan(x / 4), lambda x: math.cos(x / 4) ** -2, 0.5),
    "rodrigues": (lambda x: 2 * math.tan(x / 2), lambda x: math.cos(x / 2) ** -2, 0.5),
    "rotation_vector": (lambda x: x, lambda x: 1.0, 0.5),
}


def make(name, sequence="XYZ", sign="hysteretic", initial=1) -> OrientationRepresentation:
    """Return the representation of that name with those options."""
    rule = SignRule(sign, initial=initial)
    return representation(name, OrientationOptions(EulerSequence(sequence), rule))


class Motion(NamedTuple):
    """Two frames, the desired one turned by theta r off the other, with any velocities."""

    theta: float
    r: Array
    R_e: Array
    omega_d: Array
    domega_d: Array
    omega_e: Array

    @property
    def R_d(self) -> Array:
        return rodrigues(self.theta, self.r) @ self.R_e


def moving(thetas, R_es) -> list[Motion]:
    """Return motions with those angles and orientations."""
    count, axes = len(thetas), unit_vectors(len(thetas))
    velocities = (vectors(count, key) for key in range(3))
    return [Motion(*parts) for parts in zip(thetas, axes, R_es, *velocities, strict=True)]


def relative_motion(a, b):
    """Return R_a' R_b, x = R_a' (omega_b - omega_a) and dx; of frames R, omega, domega."""
    (R_a, omega_a, domega_a), (R_b, omega_b, domega_b) = a, b
    omega = omega_b - omega_a
    return R_a.T @ R_b, R_a.T @ omega, R_a.T @ (domega_b - domega_a - np.cross(omega_a, omega))


def relative_angles(sequence, a, b):
    """Return the angles of R_a' R_b and their derivatives; of frames R, omega, domega."""
    R_ab, x, dx = relative_motion(a, b)
    phi = EulerSequence(sequence).extract(R_ab)
    return phi, *angle_rates(sequence, phi, x, dx)


def difference_of_angles(sequence, a, b):
    """Return phi_b - phi_a and its derivatives; of frames R, omega, domega."""
    both = []
    for R, omega, domega in (a, b):
        phi = EulerSequence(sequence).extract(R)
        both.append((phi, *angle_rates(sequence, phi, omega, domega)))
    phi, dphi, ddphi = (of_b - of_a for of_a, of_b in zip(*both, strict=True))
    return np.angle(np.exp(1j * phi)), dphi, ddphi


def regular_motions(law, count=40) -> list[Motion]:
    """Return motions, any angle apart, that are away from the law's singularities."""
    thetas = generator(7).uniform(0, math.pi, 8 * count).tolist()
    regular = [
        motion
        for motion in moving(thetas, uniform(8 * count))
        if law.singularity_distance(motion.R_d, motion.R_e) > POLE_CLEARANCE
    ]
    assert len(regular) >= count
    return regular[:count]
