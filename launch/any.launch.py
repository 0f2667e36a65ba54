"""An arm, or a simulator, that takes and gives JointState; see docs/robots.md."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription

# What joint_state_topic_hardware_interface of ros2_control would talk to, by its own topics.
ONLY = {"sim": ["false"]}
ARGUMENTS = {
    "watchdog": "true",
    "topics": "{joint_states: /robot_joint_states, joint_reference: /robot_joint_command, "
    "driver_effort: /robot_joint_command}",
}


def generate_launch_description() -> LaunchDescription:
    """Return bringup, with the arguments of this arm where no others are given."""
    path = str(Path(__file__).with_name("bringup.launch.py"))
    usual = [DeclareLaunchArgument(name, default_value=of) for name, of in ARGUMENTS.items()]
    only = [DeclareLaunchArgument(n, default_value=of[0], choices=of) for n, of in ONLY.items()]
    return LaunchDescription([*usual, *only, IncludeLaunchDescription(path)])
