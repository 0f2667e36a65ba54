"""Universal Robots behind their ROS 2 driver; see docs/robots.md."""

import json

from launch import LaunchDescription

from eulerparams_control.ros.arm_launch import arm_launch

GENTLE = {"max_joint_acceleration": [5.0]}  # [rad/s^2], as the driver's configuration of MoveIt

# direct_torque of the robot adds gravity and friction itself. `effort` of joint_states is currents,
# which are not looked at where gravity is not compensated here.
EFFORTS = {**GENTLE, "compensate_gravity": False}

# The force at the TCP, without the payload that is set on the robot. Its frame, tool0_controller,
# is none of the URDF: the TCP that is set on the robot has to be the flange.
SENSOR = {"wrench_frame": "tool0", "wrench_sign": 1, "compensate_tool_weight": False}

ONLY = {"sim": ["false"]}
ARGUMENTS = {
    "base_frame": "base_link",
    "tip_frame": "tool0",
    "position_controller": "forward_position_controller",  # or scaled_joint_trajectory_controller
    "effort_controller": "forward_effort_controller",
    "topics": "{wrench: force_torque_sensor_broadcaster/wrench}",
    "parameters": json.dumps(
        {
            "clik": GENTLE,
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
