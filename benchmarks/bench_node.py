"""Round trip joint_states to command of the control nodes, against a bare rclpy echo.

All run as processes of their own at the same time; a driver publishes to one after the
other at 1 kHz each, so that noise meets all alike.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.lab.experiments.processes import Nodes
from eulerparams_control.robot.catalogue import load_robot

MESSAGES, WARM_UP, PERIOD = 4000, 1000, 1e-3
NODES = {name: c.command for name, c in CONTROLLERS.items() if c.executables == (name,)}
SENSING = [name for name in NODES if "wrench" in CONTROLLERS[name].inputs]
CONTESTANTS = {"echo": "joint_reference"} | NODES
"""The nodes, and the topic on which each answers."""


class Echo(Node):
    """The least that a node can do: copy a message it received into one it sends."""

    def __init__(self):
        super().__init__("echo")
        self._reply = JointState()
        self._publisher = self.create_publisher(JointState, "joint_reference", 10)
        self.create_subscription(JointState, "joint_states", self._on_message, 10)

    def _on_message(self, msg):
        self._reply.header.stamp = msg.header.stamp
        self._reply.name = msg.name
        self._reply.position = msg.position
        self._reply.velocity = msg.velocity
        self._publisher.publish(self._reply)


class Driver(Node):
    """Publishes joint_states to each contestant in turn and notes when it answers."""

    def __init__(self, robot):
        super().__init__("driver")
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._publishers_of, self._sent, self.times = {}, {}, {name: [] for name in CONTESTANTS}
        self._descriptions, self._wrenches, self.last = [], {}, 0
        self._wrench_message = WrenchStamped()
        self._wrench_message.header.frame_id = robot.sensor_frame
        self._message = JointState(name=list(robot.joints), position=list(robot.home))
        self._message.velocity = [0.0] * len(robot.joints)
        for name, topic in CONTESTANTS.items():
            description = self.create_publisher(String, f"{name}/robot_description", latched)
            description.publish(String(data=robot.urdf))
            self._descriptions.append(description)
            self._publishers_of[name] = self.create_publisher(
                JointState, f"{name}/joint_states", 10
            )
            if name in SENSING:
                self._wrenches[name] = self.create_publisher(WrenchStamped, f"{name}/wrench", 10)
            self.create_subscription(
                JointState, f"{name}/{topic}", lambda msg, n=name: self._answer(n, msg), 10
            )

    def send(self, name, number):
        """Publish the state of that number to one contestant."""
        self._message.header.stamp.sec = number // 1000
        self._message.header.stamp.nanosec = number % 1000 * 1_000_000
        self._sent[name, number] = time.perf_counter()
        if name in SENSING:
            self._wrench_message.header.stamp = self._message.header.stamp
            self._wrenches[name].publish(self._wrench_message)
        self._publishers_of[name].publish(self._message)

    def _answer(self, name, msg):
        stamp = msg.header.stamp
        sent = self._sent.pop((name, stamp.sec * 1000 + stamp.nanosec // 1_000_000), None)
        if sent is not None:
            self.times[name].append(time.perf_counter() - sent)


def drive(driver, executor, count):
    """Send ``count`` states to each contestant, at 1 kHz for each."""
    begin = time.perf_counter()
    first = driver.last + 1_000_000  # stamps of its own, though all were answered
    driver.last = first + count
    for i in range(count):
        for k, name in enumerate(CONTESTANTS):
            due = begin + (i + k / len(CONTESTANTS)) * PERIOD
            while time.perf_counter() < due:
                executor.spin_once(timeout_sec=max(0.0, due - time.perf_counter()))
            driver.send(name, first + i)
    for _ in range(100):
        executor.spin_once(timeout_sec=0.005)


def run() -> list[tuple[str, str, str]]:
    """Return rows: what, against what, ratio."""
    with tempfile.TemporaryDirectory() as folder, Nodes(Path(folder)) as nodes:
        os.environ.update({k: v for k, v in nodes.environment.items() if k.startswith("ROS_")})
        remap = ["--ros-args", "-r", "__ns:=/echo"]
        echo = subprocess.Popen([sys.executable, __file__, "--echo", *remap])
        parameters = {"tip_frame": "tool0", "state_rate": 0.0, "state_timeout": 10.0}
        for name in NODES:
            nodes.start(name, parameters, namespace=f"/{name}")
        rclpy.init()
        driver = Driver(load_robot("ur5"))
        executor = EventsExecutor()
        executor.add_node(driver)
        try:
            deadline = time.monotonic() + 30
            while not all(driver.times.values()) and time.monotonic() < deadline:
                drive(driver, executor, 50)
            drive(driver, executor, WARM_UP)
            for times in driver.times.values():
                times.clear()
            drive(driver, executor, MESSAGES)
        finally:
            echo.terminate()
            echo.wait()
    p50, p99 = (
        {name: np.percentile(driver.times[name], p) * 1e6 for name in CONTESTANTS} for p in (50, 99)
    )
    return [
        (f"node {name}, {label} ({p[name]:.0f} us)", f"bare rclpy echo ({p['echo']:.0f} us)",
         f"{p[name] / p['echo']:.2f}")
        for name in NODES
        for label, p in (("round trip p50", p50), ("round trip p99", p99))
    ]  # fmt: skip


def echo_main():
    """Run the bare echo."""
    rclpy.init()
    executor = EventsExecutor()
    executor.add_node(Echo())
    with contextlib.suppress(ExternalShutdownException):
        while rclpy.ok():
            executor.spin_once(timeout_sec=1.0)


if __name__ == "__main__":
    if "--echo" in sys.argv:
        echo_main()
    else:
        for row in run():
            print(*row, sep=" | ")
