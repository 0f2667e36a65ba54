"""Streams the set-points of a slow circle, one point each with its twist, at 50 Hz.

It runs on the controller's host.  The circle begins where the arm is at home.
"""

import sys
import time

import numpy as np
import rclpy
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.messages.to_ros import motion_to_ros
from eulerparams_control.motion.trajectories import Circle, Trajectory
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.qos import QOS

RATE = 50.0  # [Hz]
PERIOD, TURNS = 3.0, 60.0  # [s] of a turn, and how many: longer than the run
RADIUS = 0.02  # [m]: set-points on it are never farther than max_jump_position from each other


def main() -> int:
    """Stream until the end of the circle."""
    arm = load_robot("ur5")
    robot = Robot(arm.urdf, arm.base_frame, arm.tip_frame)
    home = robot.state(np.array(arm.home), np.zeros(len(arm.home)))
    path = Circle(RADIUS, np.array([1.0, 0.0, 0.0]), PERIOD, TURNS).trajectory(home.p_e, home.R_e)
    rclpy.init()
    node = rclpy.create_node("set_points", start_parameter_services=False)
    publisher = node.create_publisher(MultiDOFJointTrajectory, "reference", QOS)
    while not publisher.get_subscription_count():
        time.sleep(0.02)
    begin = time.monotonic()
    while (t := time.monotonic() - begin) < path.duration:
        point = Trajectory([0.0], [path.sample(t)])
        publisher.publish(motion_to_ros(point, arm.base_frame, arm.tip_frame))
        time.sleep(1 / RATE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
