"""The impedance that the recorded node impedance_control was told."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from eulerparams_control.errors import BagError, ConfigurationError, RobotError
from eulerparams_control.impedance import Impedance, damping_of_ratio, symmetric_matrix
from eulerparams_control.motion import AT_ORIGIN, Placement
from eulerparams_control.robot import Robot

IMPEDANCE_NODE = "impedance_control"


def impedance_node(parameters: Mapping[str, Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Return the parameters of the node impedance_control; None if it did not run.

    Args:
        parameters: of the recorded nodes, by node and name.
    """
    for name, node in parameters.items():
        if name.rsplit("/", 1)[-1] == IMPEDANCE_NODE:
            return node
    return None


def translational_impedance(node: Mapping[str, Any]) -> Impedance:
    """Return M_p, D_p, K_p of (52); raises BagError if the parameters do not give them."""
    return _impedance(node, "p")


def rotational_impedance(node: Mapping[str, Any]) -> Impedance:
    """Return M_o, D_o, K_o of (59); raises BagError if the parameters do not give them."""
    return _impedance(node, "o")


def _impedance(node: Mapping[str, Any], part: str) -> Impedance:
    try:
        M = symmetric_matrix(f"M_{part}", node[f"M_{part}"])
        K = symmetric_matrix(f"K_{part}", node[f"K_{part}"], node.get(f"K_{part}_axes") or ())
        if node.get(f"D_{part}"):
            D = symmetric_matrix(f"D_{part}", node[f"D_{part}"])
        else:
            D = damping_of_ratio(M, K, float(node[f"damping_ratio_{part}"]))
        return Impedance(M, D, K)
    except (KeyError, TypeError, ValueError, ConfigurationError) as error:
        raise BagError(f"the parameters of {IMPEDANCE_NODE} give no impedance: {error}") from error


def centre_of_compliance(node: Mapping[str, Any], robot: Robot) -> Placement:
    """Return the centre of compliance seen from the tip; raises BagError if it is none."""
    offset = np.array(node.get("compliance_offset") or (0.0,) * 3, dtype=float)
    link = str(node.get("compliance_frame") or robot.tip_frame)
    if link == robot.tip_frame and not offset.any():
        return AT_ORIGIN
    try:
        place = robot.placement(link)
        return Placement(place.R, place.p + place.R @ offset)
    except (ValueError, RobotError) as error:
        raise BagError(f"the parameters of {IMPEDANCE_NODE} give no centre: {error}") from error
