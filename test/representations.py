"""The representations of the orientation by name, and frames where their laws are regular."""

import math

import pytest
from samples import Array, uniform
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

# Those whose law is not the same seen from another base frame.
DEPENDS_ON_THE_BASE = {"euler_angles"}

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


def regular_pairs(law, count=40) -> list[tuple[Array, Array]]:
    """Return pairs (R_d, R_e), any angle apart, that are away from the law's singularities."""
    pairs = zip(uniform(8 * count), uniform(8 * count, key=1), strict=True)
    regular = [pair for pair in pairs if law.singularity_distance(*pair) > POLE_CLEARANCE]
    assert len(regular) >= count
    return regular[:count]
