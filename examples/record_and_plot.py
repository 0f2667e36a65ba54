"""Record a bag while send_pose.py moves the tip, then read it and plot where the tip went.

The robot and `clik` run as for send_pose.py. The bag is a rosbag2 bag: `ros2 bag` reads it, too.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import matplotlib.pyplot as plt
import rclpy

from eulerparams_control.bags.reader import Bag

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("bag", nargs="?", default=time.strftime("bag_%H_%M_%S"), type=Path)
FOLDER = parser.parse_args().bag


def record() -> int:
    """Record all topics while the tip moves; return the exit code of what moves it."""
    rclpy.init()
    node = rclpy.create_node("record_and_plot")
    options = "eulerparams_control.bags.recorder", "--ros-args", "-p", f"output:={FOLDER}"

    def is_recorded(topic: str) -> bool:
        listening = node.get_subscriptions_info_by_topic(topic)
        return "bag_recorder" in [each.node_name for each in listening]

    with subprocess.Popen([sys.executable, "-m", *options]) as recorder:
        while not all(map(is_recorded, ("/joint_states", "/clik/pose"))):
            if recorder.poll() is not None:
                sys.exit("the recorder has ended")
            time.sleep(0.1)
        moved = subprocess.run([sys.executable, Path(__file__).with_name("send_pose.py")])
        recorder.terminate()  # it finishes its file
    return moved.returncode


def main() -> None:
    """Record and plot."""
    code, bag = record(), Bag(FOLDER)
    messages = [each.message for each in bag.messages(["/clik/pose"])]
    t = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages]
    figure, axes = plt.subplots(layout="constrained")
    for name in "xyz":
        begin = getattr(messages[0].pose.position, name)
        moved = [1e3 * (getattr(m.pose.position, name) - begin) for m in messages]
        axes.plot([each - t[0] for each in t], moved, label=name)
    axes.set(xlabel="time [s]", ylabel="way of the tip [mm]")
    axes.legend()
    figure.savefig(FOLDER / "tip.png")
    print(f"{len(messages)} poses in {bag.duration:.1f} s: see {FOLDER / 'tip.png'}")
    sys.exit(code)


if __name__ == "__main__":
    main()
