"""A Kinova Gen3 behind ros2_kortex, which takes positions; see docs/robots.md."""

import json

from launch import LaunchDescription

from eulerparams_control.ros.arm_launch import arm_launch

# The limits of kortex_description are 0.8727 rad/s; those of its URDF 1.3963 and 1.2218.
CLIK = {"velocity_scale": 0.62, "max_joint_acceleration": [1.0]}

# The last two need a sensor of yours.
ONLY = {"sim": ["false"], "controller": ["clik", "admittance", "push_test"]}
ARGUMENTS = {
    "base_frame": "base_link",
    "tip_frame": "end_effector_link",
    "position_controller": "joint_trajectory_controller",
    "parameters": json.dumps({"clik": CLIK}),
}


def generate_launch_description() -> LaunchDescription:
    """Return bringup with the arguments of this arm."""
    return arm_launch(__file__, ARGUMENTS, ONLY)
