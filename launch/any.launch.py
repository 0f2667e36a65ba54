"""An arm, or a simulator, that takes and gives JointState; see docs/robots.md."""

from launch import LaunchDescription

from eulerparams_control.ros.arm_launch import arm_launch

# What joint_state_topic_hardware_interface of ros2_control would talk to, by its own topics.
ONLY = {"sim": ["false"]}
ARGUMENTS = {
    "watchdog": "true",
    "topics": "{joint_states: /robot_joint_states, joint_reference: /robot_joint_command, "
    "driver_effort: /robot_joint_command}",
}


def generate_launch_description() -> LaunchDescription:
    """Return bringup with the arguments of this arm."""
    return arm_launch(__file__, ARGUMENTS, ONLY)
