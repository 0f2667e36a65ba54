"""Send the tip 5 cm up, and wait until it is there.

In two other terminals run the robot, or its simulation, and a controller:

    ros2 run eulerparams_control pybullet_bridge --ros-args -p robot:=ur5
    ros2 run eulerparams_control clik --ros-args -p base_frame:=base_link -p tip_frame:=tool0
"""

import argparse
import copy
import math
import os
import sys
import time
from collections.abc import Callable

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException


def distance(one: PoseStamped, other: PoseStamped) -> float:
    """Return how far [m] two poses are apart."""
    a, b = one.pose.position, other.pose.position
    return math.dist((a.x, a.y, a.z), (b.x, b.y, b.z))


def main() -> None:
    """Send the pose; end with 1 if the tip does not come there."""
    rclpy.init()
    node, poses = rclpy.create_node("send_pose"), []
    node.create_subscription(PoseStamped, "clik/pose", poses.append, 10)
    target = node.create_publisher(PoseStamped, "target_pose", 10)

    def wait(is_done: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + 30.0
        while not is_done():
            if time.monotonic() > end:
                sys.exit(f"{what} within 30 s: what does clik say in its terminal?")
            rclpy.spin_once(node, timeout_sec=0.1)

    print(f"waiting for clik; ROS_DOMAIN_ID is {os.environ.get('ROS_DOMAIN_ID', 0)}", flush=True)
    wait(lambda: bool(poses and target.get_subscription_count()), "clik has not published a pose")
    goal = copy.deepcopy(poses[-1])  # in the base frame, which its header names
    goal.header.stamp.sec = goal.header.stamp.nanosec = 0  # from now on
    goal.pose.position.z += 0.05
    target.publish(goal)
    wait(lambda: distance(poses[-1], goal) < 1e-4, "the tip has not come there")
    print(f"the tip is there, within {1e3 * distance(poses[-1], goal):.3f} mm")


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_known_args()
    try:
        main()
    except (KeyboardInterrupt, ExternalShutdownException):
        sys.exit(130)
