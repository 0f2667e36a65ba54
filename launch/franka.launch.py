"""A Franka behind franka_ros2, with the hand: efforts without gravity; see docs/robots.md."""

import json

from launch import LaunchDescription

from eulerparams_control.ros.arm_launch import arm_launch

WRENCH = "/franka_robot_state_broadcaster/external_wrench_in_stiffness_frame"

# The robot adds gravity and friction itself, and limits efforts to 1000 Nm/s.
LIMITS = {"max_effort_rate": [900.0], "max_joint_acceleration": [10.0]}
EFFORTS = {**LIMITS, "compensate_gravity": False}

# What the robot exerts is positive; the hand and the load that are set in Desk are not in it.
SENSOR = {
    "wrench_frame": "fr3_hand_tcp",
    "wrench_sign": -1,
    "compensate_tool_weight": False,
    "compensate_tool_inertia": False,
    f"qos_overrides.{WRENCH}.subscription.reliability": "best_effort",
}

TAKES = ["compliance_control", "dynamic_control", "impedance_control", "push_test"]
ONLY = {"sim": ["false"], "controller": TAKES}
ARGUMENTS = {
    "base_frame": "fr3_link0",
    "tip_frame": "fr3_hand_tcp",
    "effort_controller": "forward_effort_controller",
    # joint_states itself has 30 Hz
    "topics": f"{{joint_states: /franka/joint_states, wrench: {WRENCH}}}",
    "parameters": json.dumps(
        {
            "compliance_control": EFFORTS,
            "dynamic_control": EFFORTS,
            "impedance_control": {**EFFORTS, **SENSOR},
            "watchdog": {"compensate_gravity": False},
        }
    ),
}


def generate_launch_description() -> LaunchDescription:
    """Return bringup with the arguments of this arm."""
    return arm_launch(__file__, ARGUMENTS, ONLY)
