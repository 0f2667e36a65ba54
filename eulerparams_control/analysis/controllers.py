"""Which controller ran, and what it was told, from the parameters in a bag."""

from collections.abc import Mapping
from typing import Any

from eulerparams_control.laws.orientation import (
    EulerSequence,
    OrientationOptions,
    SignRule,
)

type Parameters = Mapping[str, Mapping[str, Any]]
"""By node and name."""


def node_of(parameters: Parameters, *names: str) -> tuple[str, Mapping[str, Any]] | None:
    """Return name and parameters of the first node of one of some names; None if none ran.

    Args:
        parameters: of the recorded nodes.
        names: of executables.
    """
    found = ((node.rsplit("/", 1)[-1], values) for node, values in parameters.items())
    return next(((name, values) for name, values in found if name in names), None)


def options_of(parameters: Parameters) -> OrientationOptions:
    """Return what the controller was told of its representation; the defaults if none ran.

    Raises:
        ConfigurationError, TypeError, ValueError: if that is impossible.
    """
    keys = {"orientation", "euler_sequence"}
    node = next((values for values in parameters.values() if keys & values.keys()), {})
    return OrientationOptions(EulerSequence(str(node.get("euler_sequence", "XYZ"))), _sign(node))


def _sign(node: Mapping[str, Any]) -> SignRule:
    """Return the rule for the sign of the quaternion; what is not stated has its default."""
    rule = SignRule()
    return SignRule(
        str(node.get("quaternion_sign", rule.name)),
        float(node.get("hysteresis", rule.delta)),
        int(node.get("quaternion_initial_sign", rule.initial)),
    )
