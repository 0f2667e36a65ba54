"""A KUKA LBR behind lbr_fri_ros2_stack, which takes positions: config/robots/real/iiwa.yaml."""

from launch import LaunchDescription

from eulerparams_control.ros.arm_launch import arm_launch


def generate_launch_description() -> LaunchDescription:
    """Return bringup for this arm."""
    return arm_launch(__file__)
