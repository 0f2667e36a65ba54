"""Real nodes in processes of their own, and a tester that talks to them over DDS."""

import os
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from eulerparams_control.experiments.processes import Nodes

DEADLINE = 90.0  # [s] until something that has to happen must have happened: slow machines
QUIET = 0.4  # [s] of listening before "nothing came" is believed


class Tester:
    """A node of this process in the domain of the processes under test."""

    __test__ = False  # no test class, whatever its name begins with

    def __init__(self, folder):
        self.nodes = Nodes(folder)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self.context = Context()
        rclpy.init(context=self.context, domain_id=int(self.nodes.environment["ROS_DOMAIN_ID"]))
        self.node = Node("tester", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.diagnostics = []
        self.listen(DiagnosticArray, "/diagnostics", self.diagnostics)

    def close(self):
        with self.nodes:
            pass
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def listen(self, kind, topic, into, latched=False):
        qos = QoSProfile(depth=1000)
        if latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        return self.node.create_subscription(kind, topic, into.append, qos)

    def publisher(self, kind, topic, latched=False):
        qos = QoSProfile(depth=100)
        if latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        return self.node.create_publisher(kind, topic, qos)

    def spin(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def until(self, condition, what, again=lambda: None):
        """Spin until a condition holds; call ``again`` in between, to repeat a message say."""
        deadline = time.monotonic() + DEADLINE
        while not condition():
            again()
            self.executor.spin_once(timeout_sec=0.05)
            assert time.monotonic() < deadline, f"waited in vain for: {what}"

    def call(self, kind, service, request):
        """Call a service and return its answer."""
        client = self.node.create_client(kind, service)
        self.until(client.service_is_ready, f"the service {service}")
        future = client.call_async(request)
        self.until(future.done, f"an answer of {service}")
        self.node.destroy_client(client)
        return future.result()

    def reported(self, text):
        """Return whether some diagnostics mention a text."""
        return any(
            text in status.message or any(text in f"{v.key}: {v.value}" for v in status.values)
            for array in self.diagnostics
            for status in array.status
        )


class FakeRobot:
    """Publishes robot_description and joint_states as a robot driver would."""

    def __init__(self, tester, robot, namespace=""):
        self.tester, self.robot = tester, robot
        self.names, self.q = list(robot.joints), list(robot.home)
        self.states = tester.publisher(JointState, f"{namespace}/joint_states")
        self.description = tester.publisher(String, f"{namespace}/robot_description", latched=True)
        self.description.publish(String(data=robot.urdf))
        self.number = 0

    def message(self, ms=None, **changes):
        self.number = self.number + 1 if ms is None else ms
        msg = JointState(name=self.names, position=self.q, velocity=[0.0] * len(self.q))
        msg.header.stamp.sec, rest = divmod(self.number, 1000)
        msg.header.stamp.nanosec = rest * 1_000_000
        for name, value in changes.items():
            setattr(msg, name, value)
        return msg

    def send(self, ms=None, **changes):
        """Publish a state; each without ``ms`` is a millisecond later than the one before."""
        self.states.publish(self.message(ms, **changes))


def stamp(msg):
    return msg.header.stamp.sec * 1000 + msg.header.stamp.nanosec // 1_000_000
