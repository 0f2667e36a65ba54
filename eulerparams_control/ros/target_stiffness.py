"""The input ``target_stiffness``: the stiffness that ``impedance_control`` is to have."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import WrenchStamped

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import shown
from eulerparams_control.parameters.impedance_control import ImpedanceParameters


def stiffness_from_ros(msg: WrenchStamped, frame_id: str) -> tuple[Array, Array]:
    """Return the diagonals (3,) of K_p [N/m] and K_o [Nm/rad] that a message asks for.

    Args:
        msg: the message.
        frame_id: of the axes of K_p.

    Raises:
        InvalidMessageError: if the frame is another, or a number is negative or not finite.
    """
    if msg.header.frame_id not in ("", frame_id):
        raise InvalidMessageError(
            f"its frame_id is {shown(msg.header.frame_id)}; expected {frame_id}, whose axes "
            "K_p has (translational_frame), or none"
        )
    K_p, K_o = (
        np.array([part.x, part.y, part.z]) for part in (msg.wrench.force, msg.wrench.torque)
    )
    if not (np.isfinite([K_p, K_o]).all() and min(*K_p, *K_o) >= 0.0):
        raise InvalidMessageError(
            f"K_p is {K_p.tolist()} N/m, K_o {K_o.tolist()} Nm/rad; expected finite numbers "
            "of 0 or more"
        )
    return K_p, K_o


class TargetStiffness(NamedTuple):
    """The stiffness that was asked for last, until K_p or K_o is set.

    Attributes:
        parameters: those of then.
        wanted: the same with that stiffness.
    """

    parameters: ImpedanceParameters
    wanted: ImpedanceParameters

    def kept(self, parameters: ImpedanceParameters) -> "TargetStiffness":
        """Return what stays when parameters were changed."""
        is_same = all(
            getattr(parameters, name) == getattr(self.parameters, name) for name in ("K_p", "K_o")
        )
        return self if is_same else TargetStiffness(parameters, parameters)

    def of(self, parameters: ImpedanceParameters) -> ImpedanceParameters:
        """Return parameters with that stiffness."""
        return replace(parameters, K_p=self.wanted.K_p, K_o=self.wanted.K_o)
