"""Stream poses at 20 Hz, as a camera or a planner would: a circle of 5 cm, smoothly followed.

The robot and `clik` run as for send_pose.py.
"""

import argparse
import copy
import math
import os
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException

RATE, RADIUS, PERIOD = 20.0, 0.05, 6.0


def main() -> None:
    """Stream one turn; end with 1 if the tip is not led along it."""
    rclpy.init()
    node, poses = rclpy.create_node("stream_poses"), []
    node.create_subscription(PoseStamped, "clik/pose", poses.append, 10)
    target = node.create_publisher(PoseStamped, "target_pose", 10)
    print(f"waiting for clik; ROS_DOMAIN_ID is {os.environ.get('ROS_DOMAIN_ID', 0)}", flush=True)
    end = time.monotonic() + 30.0
    while not (poses and target.get_subscription_count()):
        rclpy.spin_once(node, timeout_sec=0.1)
        if time.monotonic() > end:
            sys.exit("clik has not published a pose within 30 s: is it active, in this domain?")
    start, lags = copy.deepcopy(poses[-1]), []
    start.header.stamp.sec = start.header.stamp.nanosec = 0  # each counts from its receipt
    centre = start.pose.position.x - RADIUS, start.pose.position.y

    def send() -> None:
        angle = 2 * math.pi * len(lags) / (RATE * PERIOD)
        goal, at = copy.deepcopy(start), poses[-1].pose.position
        goal.pose.position.x = centre[0] + RADIUS * math.cos(angle)
        goal.pose.position.y = centre[1] + RADIUS * math.sin(angle)
        target.publish(goal)
        lags.append(math.dist((goal.pose.position.x, goal.pose.position.y), (at.x, at.y)))

    node.create_timer(1 / RATE, send)
    while len(lags) <= RATE * PERIOD:
        rclpy.spin_once(node, timeout_sec=0.1)
    radius = math.dist((poses[-1].pose.position.x, poses[-1].pose.position.y), centre)
    print(f"the tip was {1e3 * max(lags):.0f} mm behind at most; radius {1e3 * radius:.1f} mm")
    sys.exit(max(lags) > RADIUS)  # a tip that stays is 100 mm behind


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_known_args()
    try:
        main()
    except (KeyboardInterrupt, ExternalShutdownException):
        sys.exit(130)
