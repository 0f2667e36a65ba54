"""A Franka FR3 behind franka_ros2, with the hand: efforts: config/robots/real/franka.yaml."""

from launch import LaunchDescription

from eulerparams_control.ros.arm_launch import arm_launch


def generate_launch_description() -> LaunchDescription:
    """Return bringup for this arm."""
    return arm_launch(__file__)
