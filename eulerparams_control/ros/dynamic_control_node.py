"""The node ``dynamic_control``: section IV; publishes ``joint_effort``."""

from eulerparams_control.parameters.dynamic_control import DynamicParameters
from eulerparams_control.ros.control_node import ControlNode
from eulerparams_control.ros.runtime import run


class DynamicControlNode(ControlNode):
    """Dynamic control of one arm."""

    parameters_type = DynamicParameters


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(DynamicControlNode, args)
