"""The node ``compliance_control``: an impedance by efforts, without a sensor of the contact."""

import sys

import numpy as np

from eulerparams_control.laws.compliance_control import ComplianceControl, effects_of
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.markers import Stiffness
from eulerparams_control.parameters.compliance_control import ComplianceParameters
from eulerparams_control.ros.control_node import ControlNode
from eulerparams_control.ros.runtime import run


class ComplianceControlNode(ControlNode):
    """Compliance control of one arm."""

    parameters_type = ComplianceParameters

    def stiffness_of(self, tick: Tick) -> Stiffness | None:
        """Return K_p at the tip."""
        scheme = self._controller.scheme if self._controller else None
        if not isinstance(scheme, ComplianceControl):
            return None
        return Stiffness(scheme.law.stiffness(tick.desired.R_d), tick.state.p_e)

    def values_of(self, tick: Tick) -> dict[str, str | int | float]:
        """Return what /diagnostics shows of a tick."""
        effects = effects_of(tick)
        return {
            "elastic force [N]": float(np.linalg.norm(effects.f)),
            "elastic moment [Nm]": float(np.linalg.norm(effects.mu)),
            "displacement [m]": float(np.linalg.norm(tick.dp_de)),
            "displacement [rad]": angle_between(tick.desired.R_d, tick.state.R_e),
            "elastic energy [J]": effects.energy,
            "stretch of the springs": tick.excess,
            "their clips lowered by": effects.lowered,
            "rate of the fastest mode [1/s]": effects.rate,
        }


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(ComplianceControlNode, args)


if __name__ == "__main__":
    sys.exit(main())
