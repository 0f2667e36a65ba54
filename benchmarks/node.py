"""Control nodes at 1 kHz, from joint_states to command, beside a bare echo of the same message.

Each is a process of its own; a driver publishes to one after the other, in blocks, so that noise
meets all alike.  The echo is a node of rclpy with an EventsExecutor that copies the message.
"""

import argparse
import gc
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tick import STEP, report

from eulerparams_control.lab.run.processes import Nodes
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.robot.catalogue import load_robot

PERIOD, BLOCK, WARM_UP, START = 1e-3, 250, 1000, 180.0  # [s], messages, messages, [s]
ECHO = "echo"
PARAMETERS = {"tip_frame": "tool0", "state_timeout": 10.0}  # others have their turn meanwhile
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
UR5 = load_robot("ur5")


class Session(NamedTuple):
    """Processes in a ROS domain of their own, and a node of this process that drives them."""

    nodes: Nodes
    driver: Node
    executor: EventsExecutor

    def spin_until(self, due: float) -> None:
        """Take messages until a time [s] of the steady clock."""
        while (left := due - time.perf_counter()) > 0:
            self.executor.spin_once(timeout_sec=left)


@contextmanager
def session() -> Iterator[Session]:
    with tempfile.TemporaryDirectory() as folder, Nodes(Path(folder)) as nodes:
        context, domain = Context(), int(nodes.environment["ROS_DOMAIN_ID"])
        no_signals = SignalHandlerOptions.NO
        rclpy.init(context=context, domain_id=domain, signal_handler_options=no_signals)
        driver, executor = Node("driver", context=context), EventsExecutor(context=context)
        executor.add_node(driver)
        gc.collect()
        gc.freeze()  # as the nodes do
        try:
            yield Session(nodes, driver, executor)
        finally:
            executor.shutdown()
            driver.destroy_node()
            context.try_shutdown()


def run_echo() -> None:
    """Run the least that a node can do: copy a message it received into one it sends."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    executor, node, reply, stopped = EventsExecutor(), Node(ECHO), JointState(), []
    publisher = node.create_publisher(JointState, "joint_reference", 10)

    def answer(msg: JointState) -> None:
        reply.header.stamp = msg.header.stamp
        reply.name, reply.position, reply.velocity = msg.name, msg.position, msg.velocity
        publisher.publish(reply)

    node.create_subscription(JointState, "joint_states", answer, 10)
    executor.add_node(node)
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))
    while not stopped:
        executor.spin_once(timeout_sec=0.05)


class Answers:
    """The round trips [s] of a node in the namespace of its name; states sent; processor [s]."""

    def __init__(self, here: Session, name: str, pid: int) -> None:
        self._here, self._pid, create = here, pid, here.driver.create_publisher
        description = create(String, f"{name}/robot_description", LATCHED)
        description.publish(String(data=UR5.urdf))
        self._state = JointState(name=list(UR5.joints), position=list(UR5.home))
        self._state.velocity = [0.0] * len(UR5.joints)
        self._wrench = WrenchStamped()
        self._wrench.header.frame_id = UR5.sensor_frame
        self._states = create(JointState, f"{name}/joint_states", 10)
        scheme = schemes().get(name)
        senses = scheme is not None and "wrench" in scheme.inputs
        self._wrenches = create(WrenchStamped, f"{name}/wrench", 10) if senses else None
        topic = f"{name}/{scheme.command if scheme else 'joint_reference'}"
        here.driver.create_subscription(JointState, topic, self._answer, 1000, raw=True)
        self.clear()

    def clear(self) -> None:
        self.times: list[float] = []
        self.sent, self.cpu = 0, 0.0
        self._waiting: dict[bytes, float] = {}  # when each was sent [s], by its stamp

    def warm_up(self) -> None:
        """Send states until one is answered, then some more; forget them."""
        deadline = time.monotonic() + START  # laws may be compiled first
        while not self.times and time.monotonic() < deadline:
            self.drive(10, 0.0)
        self.drive(WARM_UP)
        self.clear()

    def drive(self, count: int = BLOCK, patience: float = 0.5) -> None:
        """Send a block of states; wait for their answers for a time [s]."""
        begin, stamp, cpu = time.perf_counter(), time.time_ns(), self._clock()
        for i in range(count):
            self._here.spin_until(begin + i * PERIOD)
            self._send(stamp + i * STEP)
        deadline = time.perf_counter() + patience
        while self._waiting and time.perf_counter() < deadline:
            self._here.executor.spin_once(timeout_sec=0.005)
        self._waiting.clear()
        self.cpu += self._clock() - cpu

    def _clock(self) -> float:
        """Return the processor time [s] of the process: its clock, as Linux numbers it."""
        return time.clock_gettime((~self._pid << 3) | 2)

    def _send(self, stamp: int) -> None:
        header = self._state.header.stamp
        header.sec, header.nanosec = divmod(stamp, 10**9)
        self._waiting[struct.pack("<iI", header.sec, header.nanosec)] = time.perf_counter()
        self.sent += 1
        if self._wrenches is not None:
            self._wrench.header.stamp = header
            self._wrench.wrench.force.x = 1e-12 * header.nanosec  # one that repeats itself is stuck
            self._wrenches.publish(self._wrench)
        self._states.publish(self._state)

    def _answer(self, data: bytes) -> None:
        if (sent := self._waiting.pop(data[4:12], None)) is not None:
            self.times.append(time.perf_counter() - sent)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=4000, help="to each node")
    options = parser.parse_args()
    with session() as here:
        command = [sys.executable, __file__, ECHO, "--ros-args", "-r", f"__ns:=/{ECHO}"]
        echo = subprocess.Popen(command, env=here.nodes.environment)
        try:
            answers = {ECHO: Answers(here, ECHO, echo.pid)}
            for name in schemes():
                here.nodes.start(name, PARAMETERS, f"/{name}")
                answers[name] = Answers(here, name, here.nodes.processes[name].pid)
            for each in answers.values():
                each.warm_up()
            for _ in range(options.messages // BLOCK):
                for each in answers.values():
                    each.drive()
        finally:
            echo.terminate()
            echo.wait()
    bare = answers.pop(ECHO)
    report("node, state to command [us]",
           [(name, each.times, "echo", bare.times) for name, each in answers.items()])  # fmt: skip
    for name, each in {ECHO: bare, **answers}.items():
        print(f"{name:20} {len(each.times)} of {each.sent} states answered, "
              f"{1e6 * each.cpu / each.sent:.0f} us of processor a state")  # fmt: skip


if __name__ == "__main__":
    run_echo() if sys.argv[1:2] == [ECHO] else main()
