"""The node ``clik``: kinematic control, section III; publishes ``joint_reference``."""

from eulerparams_control.parameters.clik import ClikParameters
from eulerparams_control.ros.control_node import ControlNode
from eulerparams_control.ros.runtime import run


class ClikNode(ControlNode):
    """Kinematic control of one arm."""

    parameters_type = ClikParameters


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(ClikNode, args)
