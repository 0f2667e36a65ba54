"""The representations of the orientation displacement; importing this registers them."""

from eulerparams_control.laws._old.orientation import (  # noqa: F401  each registers itself
    angle_axis,
    euler_angles,
    euler_parameters,
    modified_rodrigues,
    relative_euler_angles,
    rodrigues,
    rotation_vector,
)
from eulerparams_control.laws._old.orientation.base import (
    CompliantRotation,
    Lyapunov,
    OrientationOptions,
    OrientationRepresentation,
    representation,
)
from eulerparams_control.laws._old.orientation.sequences import SEQUENCES, EulerSequence
from eulerparams_control.laws._old.orientation.sign import SEPARATE, SIGNS, SignRule

ORIENTATIONS = tuple(sorted(OrientationRepresentation.registry))

__all__ = [
    "ORIENTATIONS",
    "SEPARATE",
    "SEQUENCES",
    "SIGNS",
    "CompliantRotation",
    "EulerSequence",
    "Lyapunov",
    "OrientationOptions",
    "OrientationRepresentation",
    "SignRule",
    "as_formulas",
    "representation",
]


def as_formulas(orientation):  # type: ignore[no-untyped-def]
    """Return the representation of formulas that is like an open one."""
    if isinstance(orientation, OrientationRepresentation):
        return orientation
    sequence, sign = orientation.options.sequence, orientation.options.sign
    rule = SignRule(sign.name, sign.delta, sign.initial)
    return representation(orientation.name, OrientationOptions(EulerSequence(sequence.name), rule))
