"""The node ``fault_injector``: relays the topics between robot and controller, with faults.

It takes each topic and gives it on as ``faulty/TOPIC``, as it came or as its faults leave it:

    ros2 run eulerparams_control fault_injector --ros-args --params-file config/fault_injector.yaml
    ros2 run eulerparams_control clik --ros-args -r joint_states:=faulty/joint_states
        -r reference:=faulty/reference
    ros2 run eulerparams_control pybullet_bridge --ros-args
        -r joint_reference:=faulty/joint_reference

The robot takes its commands from ``faulty/joint_reference`` or ``faulty/joint_effort``: where it
cannot be told so, leave these topics out.  The messages are those of ``command_type:
joint_state``.  ROS parameters have no lists of groups, so each fault is one line of flow-style
YAML, ``"{fault: drop, topic: wrench, at: 1.0, for: 0.3}"``; see ``eulerparams_control.lab.faults``.
"""

import sys
from array import array
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

import rclpy
import yaml
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import ConfigurationError
from eulerparams_control.events import Event, tell
from eulerparams_control.lab.faults import (
    FAULTY,
    TOPICS,
    Corrupt,
    Duplicate,
    FaultStream,
    MessageFault,
    parse_fault,
)
from eulerparams_control.lab.run.yaml_checks import known
from eulerparams_control.messages.keys import WorkMode
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.qos import QOS_STREAM, overridable
from eulerparams_control.ros.runtime import run

SECOND = "second_publisher"  # the node that publishes to the topic of another
TYPES: dict[str, type] = dict.fromkeys(TOPICS, JointState)
TYPES |= {"wrench": WrenchStamped, "reference": MultiDOFJointTrajectory}
_STEADY = Clock(clock_type=ClockType.STEADY_TIME)
_TICK = 0.002  # [s] between two looks at what is due
_MEET = 0.05  # [s] between two looks at who listens


@dataclass(frozen=True)
class InjectorParameters:
    """Parameters of the node ``fault_injector``."""

    topics: tuple[str, ...] = parameter(TOPICS, "that are given on", choices=TOPICS)
    faults: tuple[str, ...] = parameter((), "each as flow-style YAML")
    seed: int = parameter(0, "of what is random", bounds=(0, 2**31 - 1))
    start_on: str = parameter(
        "", "topic whose first message begins the time of the faults; empty: at once",
        choices=("", *TOPICS),
    )  # fmt: skip

    def parse(self, text: str) -> MessageFault:
        """Return a fault; raises ConfigurationError if it is impossible here."""
        try:
            fault = parse_fault(yaml.safe_load(text))
            if not isinstance(fault, MessageFault):
                raise ConfigurationError("nodes are killed by the experiment that has started them")
            known("topic among the parameter 'topics'", fault.topic, self.topics)
            if isinstance(fault, Corrupt) and fault.field:
                _check_field(fault.field, TYPES[fault.topic]())
        except (yaml.YAMLError, ConfigurationError) as error:
            what = "no YAML: " if isinstance(error, yaml.YAMLError) else ""
            raise ConfigurationError(f"parameter 'faults': {text!r}: {what}{error}") from error
        return fault


def _check_field(path: str, msg: Any) -> None:
    """Raise ConfigurationError unless a message has the field of a path such as wrench.force."""
    for part in path.split("."):
        fields: dict[str, str] = getattr(msg, "get_fields_and_field_types", dict)()
        known("field", part.split("[")[0], fields)
        msg = getattr(msg, part.split("[")[0])
        if isinstance(msg, list | array):
            return  # what is in it is not known before


class FaultInjectorNode(Node):
    """Relays topics, with faults."""

    parameters_type = InjectorParameters

    def __init__(self) -> None:
        super().__init__("fault_injector")
        self.done = False
        self._health = diagnostics.Health(self)
        p = self._params = declare(self, self.parameters_type)
        self._faults = tuple(map(p.parse, p.faults))
        if p.start_on:
            known("topic in start_on; topics", p.start_on, p.topics)
        self._stream = FaultStream(self._faults, p.seed)
        self._active: set[MessageFault] = set()
        self._seconds: dict[MessageFault, ExitStack] = {}
        self._started: float | None = None
        self._last: dict[str, bytes] = {}
        self._outputs: dict[str, Publisher] = {
            topic: self.create_publisher(TYPES[topic], FAULTY + topic, QOS_STREAM)
            for topic in p.topics
        }
        self._unheard = list(p.topics)
        self.create_timer(_MEET, self._meet, clock=_STEADY)
        self.create_timer(_TICK, self._tick, clock=_STEADY)
        text = f"{len(self._faults)} faults to come"
        self._health.set(diagnostics.OK, text, mode=WorkMode.READY)
        if not p.start_on:
            self._start()

    def _start(self) -> None:
        self._started = steady.now()
        self.get_logger().info("the time of the faults begins")
        tell(Event.READY)

    @property
    def _now(self) -> float:
        """The time since the start [s]; before it below all times of faults."""
        return -1.0 if self._started is None else steady.now() - self._started

    def _meet(self) -> None:
        """Subscribe to a topic once its relay has a subscriber: nothing sent once is lost."""
        for topic in list(self._unheard):
            if self._outputs[topic].get_subscription_count():
                self._unheard.remove(topic)
                qos, on_message = overridable(QOS_STREAM), partial(self._on_message, topic)
                self.create_subscription(TYPES[topic], topic, on_message, **qos, raw=True)

    def _on_message(self, topic: str, serialized: bytes) -> None:
        if self._started is None and topic == self._params.start_on:
            self._start()
        t = self._now
        self._last[topic] = serialized
        if not self._stream.touches(t, topic):
            self._outputs[topic].publish(serialized)  # raw: nothing is decoded
            return
        self._health.count(f"{topic} at which a fault was at work")
        msg = deserialize_message(serialized, TYPES[topic])
        for out in self._stream.on_message(t, topic, msg):
            self._outputs[topic].publish(out)

    def _tick(self) -> None:
        t = self._now
        for topic, msg in self._stream.due(t):
            self._outputs[topic].publish(msg)
        active = {fault for fault in self._faults if fault.at <= t < fault.end}
        if active != self._active:
            self._begin_and_end(t, active)

    def _begin_and_end(self, t: float, active: set[MessageFault]) -> None:
        for fault in self._faults:
            if fault in active ^ self._active:
                self.get_logger().info(f"{'begins' if fault in active else 'ends'}: {fault}")
        for fault in active - self._active:
            if isinstance(fault, Duplicate) and fault.rate:
                self._seconds[fault] = self._second_publisher(fault)
        for fault in self._seconds.keys() - active:
            self._seconds.pop(fault).close()
        self._active = active
        at_work = ", ".join(f"{f.name} on {f.topic}" for f in self._faults if f in active)
        if at_work:
            self._health.set(diagnostics.WARN, f"at work: {at_work}", mode=WorkMode.WORKING)
        else:
            to_come = sum(fault.at > t for fault in self._faults)
            mode = WorkMode.READY if to_come else WorkMode.DONE
            self._health.set(diagnostics.OK, f"no fault at work, {to_come} to come", mode=mode)

    def _second_publisher(self, fault: Duplicate) -> ExitStack:
        """Let a node of its own publish the last message of a topic again; return its end."""
        node = rclpy.create_node(
            SECOND,
            context=self.context,
            namespace=self.get_namespace(),
            use_global_arguments=False,  # its name is its own
            start_parameter_services=False,
        )
        topic = self._outputs[fault.topic].topic_name
        publisher = node.create_publisher(TYPES[fault.topic], topic, QOS_STREAM)

        def publish() -> None:
            if fault.topic in self._last:
                publisher.publish(self._last[fault.topic])

        end = ExitStack()
        end.callback(node.destroy_node)
        end.callback(self.destroy_timer, self.create_timer(1 / fault.rate, publish, clock=_STEADY))
        return end

    def close(self) -> None:
        """End the second publishers."""
        for second in self._seconds.values():
            second.close()


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(FaultInjectorNode, args)


if __name__ == "__main__":
    sys.exit(main())
