"""Which controller ran, and what it was told, from the parameters in a bag."""

import math
from collections.abc import Mapping
from typing import Any

from eulerparams_control.errors import BagError, ConfigurationError, RobotError
from eulerparams_control.laws.impedance_matrices import Impedance, impedance_of
from eulerparams_control.laws.orientation import EulerSequence, OrientationOptions, SignRule
from eulerparams_control.motion.frames import Placement
from eulerparams_control.robot.robot import Robot

type Parameters = Mapping[str, Mapping[str, Any]]
"""By node and name."""

IMPEDANCE_NODE = "impedance_control"


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


def impedance_node(parameters: Mapping[str, Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Return the parameters of the node impedance_control; None if it did not run.

    Args:
        parameters: of the recorded nodes, by node and name.
    """
    found = node_of(parameters, IMPEDANCE_NODE)
    return found and found[1]


def translational_impedance(node: Mapping[str, Any]) -> Impedance:
    """Return M_p, D_p, K_p of (52); raises BagError if the parameters do not give them."""
    return _impedance(node, "p")


def rotational_impedance(node: Mapping[str, Any]) -> Impedance:
    """Return M_o, D_o, K_o of (59); raises BagError if the parameters do not give them."""
    return _impedance(node, "o")


def _impedance(node: Mapping[str, Any], part: str) -> Impedance:
    try:
        return impedance_of(
            part,
            node[f"M_{part}"],
            node.get(f"D_{part}") or (),
            node[f"K_{part}"],
            node.get(f"K_{part}_axes") or (),
            float(node.get(f"damping_ratio_{part}", math.nan)),
        )
    except (KeyError, TypeError, ValueError, ConfigurationError) as error:
        raise BagError(f"the parameters of {IMPEDANCE_NODE} give no impedance: {error}") from error


def centre_of_compliance(node: Mapping[str, Any], robot: Robot) -> Placement:
    """Return the centre of compliance seen from the tip; raises BagError if it is none."""
    offset = node.get("compliance_offset") or (0.0,) * 3
    try:
        return robot.placement(str(node.get("compliance_frame") or ""), offset)
    except (TypeError, ValueError, RobotError) as error:
        raise BagError(f"the parameters of {IMPEDANCE_NODE} give no centre: {error}") from error
