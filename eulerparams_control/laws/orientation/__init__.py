"""The representations of the orientation displacement; importing this registers them."""

from eulerparams_control.laws.orientation import (  # noqa: F401  each registers itself
    angle_axis,
    euler_angles,
    euler_parameters,
    modified_rodrigues,
    relative_euler_angles,
    rodrigues,
    rotation_vector,
)
from eulerparams_control.laws.orientation.base import (
    Lyapunov,
    OrientationOptions,
    OrientationRepresentation,
    representation,
)
from eulerparams_control.laws.orientation.sequences import SEQUENCES, EulerSequence
from eulerparams_control.laws.orientation.sign import SEPARATE, SIGNS, SignRule

ORIENTATIONS = tuple(sorted(OrientationRepresentation.registry))

__all__ = [
    "ORIENTATIONS",
    "SEPARATE",
    "SEQUENCES",
    "SIGNS",
    "EulerSequence",
    "Lyapunov",
    "OrientationOptions",
    "OrientationRepresentation",
    "SignRule",
    "representation",
]
