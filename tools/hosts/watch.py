"""Listens on one host and writes a line of JSON for each thing that it hears.

    watch.py {robot|controller}

    {"t": ..., "speed": ...}                   joint_states: the fastest joint, of its limit
    {"t": ..., "command": ...}                 a command: its stamp [s]
    {"t": ..., "who": ..., "says": ..., "level": ..., "values": {...}}   a status of /diagnostics

t [s] is when it was published, by the clock of the machine, which both hosts have.
"""

import json
import sys
from contextlib import suppress
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from sensor_msgs.msg import JointState

from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.qos import QOS_STREAM

_SENT, _RECEIVED = "source_timestamp", "received_timestamp"


class Watch:
    """What is heard on a host."""

    def __init__(self, host: str) -> None:
        self.node = rclpy.create_node(f"watch_{host}", start_parameter_services=False)
        arm = load_robot("ur5")
        self._limits = Robot(arm.urdf, arm.base_frame, arm.tip_frame).limits.velocity
        self._listen(DiagnosticArray, "/diagnostics", self._on_diagnostics)
        if host == "robot":
            self._listen(JointState, "joint_states", self._on_state)
            self._listen(JointState, "joint_reference", self._on_command)

    def _listen(self, kind: Any, topic: str, callback: Any) -> None:
        self.node.create_subscription(kind, topic, callback, QOS_STREAM)

    def _on_state(self, msg: JointState, info: Any) -> None:
        fastest = np.abs(np.array(msg.velocity[: len(self._limits)]) / self._limits).max()
        _write(info[_SENT], speed=float(fastest), stamp=ns_from_ros(msg.header.stamp) / 1e9)

    def _on_command(self, msg: JointState, info: Any) -> None:
        _write(info[_RECEIVED], command=ns_from_ros(msg.header.stamp) / 1e9)

    def _on_diagnostics(self, msg: DiagnosticArray, info: Any) -> None:
        for status in msg.status:
            values = {pair.key: pair.value for pair in status.values}
            level = int.from_bytes(status.level, "little")
            _write(info[_SENT], who=status.name, says=status.message, level=level, values=values)


def _write(t: int, **what: Any) -> None:
    print(json.dumps({"t": t / 1e9, **what}), flush=True)


def main() -> int:
    """Listen until the process is ended."""
    rclpy.init()
    executor = SingleThreadedExecutor()
    executor.add_node(Watch(sys.argv[1]).node)
    with suppress(ExternalShutdownException):
        while rclpy.ok():
            executor.spin_once(timeout_sec=1.0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
