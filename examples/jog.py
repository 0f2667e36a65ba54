"""Jog: the tip moves along x of the base by 5 cm/s for 2 s, and stops as nothing comes any more.

The robot and `clik` run as for send_pose.py.
"""

import argparse
import os
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.executors import ExternalShutdownException

SPEED, LASTS, RATE = 0.05, 2.0, 50.0


def main() -> None:
    """Jog; end with 1 if the tip does not go there, or does not stop."""
    rclpy.init()
    node, poses = rclpy.create_node("jog"), []
    node.create_subscription(PoseStamped, "clik/pose", poses.append, 10)
    target = node.create_publisher(TwistStamped, "target_twist", 10)

    def spin(seconds: float) -> float:
        """Let time pass; return where the tip is along x [m]."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.01)
        return float(poses[-1].pose.position.x)

    print(f"waiting for clik; ROS_DOMAIN_ID is {os.environ.get('ROS_DOMAIN_ID', 0)}", flush=True)
    end = time.monotonic() + 30.0
    while not (poses and target.get_subscription_count()):
        if time.monotonic() > end:
            sys.exit("clik has not published a pose within 30 s: is it active, in this domain?")
        rclpy.spin_once(node, timeout_sec=0.1)
    begin, twist = spin(0.5), TwistStamped()
    twist.header.frame_id = poses[-1].header.frame_id
    twist.twist.linear.x = SPEED
    end = time.monotonic() + LASTS
    while time.monotonic() < end:
        target.publish(twist)
        spin(1 / RATE)
    moved = spin(1.0) - begin
    stays = abs(spin(0.5) - begin - moved)
    print(f"the tip went {1e3 * moved:.0f} mm, and stayed there within {1e3 * stays:.3f} mm")
    sys.exit(not (0.5 < moved / (SPEED * LASTS) < 2.0 and stays < 1e-4))


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_known_args()
    try:
        main()
    except (KeyboardInterrupt, ExternalShutdownException):
        sys.exit(130)
