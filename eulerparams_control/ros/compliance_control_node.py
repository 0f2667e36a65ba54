"""The node ``compliance_control``: an impedance by efforts, without a sensor of the contact."""

from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState

from eulerparams_control.control.controller import Controller
from eulerparams_control.laws.compliance_control import ComplianceControl
from eulerparams_control.laws.elasticity import Elasticity
from eulerparams_control.laws.rotations import Array, angle_between
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.to_ros import springs_to_ros
from eulerparams_control.parameters.compliance_control import ComplianceParameters
from eulerparams_control.ros.commands import ImpedancePublisher
from eulerparams_control.ros.control_node import ControlNode
from eulerparams_control.ros.diagnostics import Values
from eulerparams_control.ros.runtime import run
from eulerparams_control.ros.target_wrench import TargetWrench
from eulerparams_control.ros.targets import Topics


class ComplianceControlNode(ControlNode):
    """Compliance control of one arm."""

    parameters_type = ComplianceParameters

    def _subscribe(self) -> None:
        self._pressing = TargetWrench(self._input)
        self._impedance = ImpedancePublisher[tuple[Elasticity, float]](self, _springs_to_ros)
        super()._subscribe()

    def leaders(self) -> Topics:
        """Return the topic that leads the force of the arm."""
        return {"target_wrench": (WrenchStamped, self._pressing.take)}

    def observe(self, t: int, q: Array, dq: Array) -> None:
        """Let the tool exert what counts for the state."""
        self._pressing.exert(self._controller, t, self._params.target_timeout)

    def review(self, controller: Controller, stamp: Any) -> None:
        """Publish the springs."""
        if stamp is not None and isinstance(controller.scheme, ComplianceControl):
            self._impedance.show(stamp, controller.scheme.springs)

    def values_of(self, scheme: ComplianceControl, tick: Tick) -> Values:
        """Return what /diagnostics shows of a tick."""
        return {
            "force fed forward [N]": float(np.linalg.norm(scheme.fed)),
            "displacement [m]": float(np.linalg.norm(tick.dp_de)),
            "displacement [rad]": angle_between(tick.desired.R_d, tick.state.R_e),
            "elastic energy [J]": tick.effects.energy,
            "their clips lowered by": tick.effects.lowered,
        }


def _springs_to_ros(springs: tuple[Elasticity, float], stamp: Time) -> JointState:
    elasticity, clip_share = springs  # the latter: the part of where its clips are stated
    clips = clip_share * elasticity.clip_position, clip_share * elasticity.clip_rotation
    return springs_to_ros(elasticity.K_p, elasticity.K_o, clips, stamp)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(ComplianceControlNode, args)
