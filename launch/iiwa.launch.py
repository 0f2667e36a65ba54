"""A KUKA LBR behind lbr_fri_ros2_stack, which takes positions; see docs/robots.md."""

import json
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription

# At the 100 Hz that the driver has by itself: the rate has to be twice the gain, or more.
CLIK = {"k_Pp": 20.0, "k_Po": 20.0, "max_joint_acceleration": [10.0]}

# Estimated by the driver of the torques that remain when the load that is set in Sunrise is out.
SENSOR = {"wrench_sign": 1, "compensate_tool_weight": False, "compensate_tool_inertia": False}

ONLY = {"sim": ["false"], "controller": ["clik", "admittance", "push_test"]}
ARGUMENTS = {
    "namespace": "lbr",
    "base_frame": "lbr_link_0",
    "tip_frame": "lbr_link_ee",
    "position_controller": "forward_position_controller",  # or joint_trajectory_controller
    "topics": "{wrench: force_torque_broadcaster/wrench}",
    "parameters": json.dumps({"clik": CLIK, "impedance_control": SENSOR}),
}


def generate_launch_description() -> LaunchDescription:
    """Return bringup, with the arguments of this arm where no others are given."""
    path = str(Path(__file__).with_name("bringup.launch.py"))
    usual = [DeclareLaunchArgument(name, default_value=of) for name, of in ARGUMENTS.items()]
    only = [DeclareLaunchArgument(n, default_value=of[0], choices=of) for n, of in ONLY.items()]
    return LaunchDescription([*usual, *only, IncludeLaunchDescription(path)])
