"""A KUKA LBR behind lbr_fri_ros2_stack, which takes positions; see docs/robots.md."""

import json

from launch import LaunchDescription

from eulerparams_control.ros.arm_launch import arm_launch

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
    """Return bringup with the arguments of this arm."""
    return arm_launch(__file__, ARGUMENTS, ONLY)
