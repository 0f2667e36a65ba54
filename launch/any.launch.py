"""An arm, or a simulator, that takes and gives JointState: config/robots/real/any.yaml."""

from launch import LaunchDescription

from eulerparams_control.ros.arm_launch import arm_launch


def generate_launch_description() -> LaunchDescription:
    """Return bringup for this arm."""
    return arm_launch(__file__)
