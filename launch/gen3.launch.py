"""A Kinova Gen3 behind ros2_kortex, which takes positions: config/robots/real/gen3.yaml."""

from launch import LaunchDescription

from eulerparams_control.ros.arm_launch import arm_launch


def generate_launch_description() -> LaunchDescription:
    """Return bringup for this arm."""
    return arm_launch(__file__)
