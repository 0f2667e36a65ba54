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
from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.events import Event, tell
from eulerparams_control.lab.faults.base import FROM_ROBOT, ROBOT, TOPICS, Fault, parse_fault
from eulerparams_control.lab.faults.kinds import Kill, SecondPublisher
from eulerparams_control.lab.faults.stream import FaultStream
from eulerparams_control.messages.keys import WorkMode
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.qos import QOS_STREAM, overridable
from eulerparams_control.ros.runtime import run

NAME = "intruder"
"""Of the node, as those see it who list the publishers of the topic."""

FAULTY = "faulty/"
"""Prefix of the topics that it publishes."""

TYPES = {"wrench": WrenchStamped, "reference": MultiDOFJointTrajectory}
"""Of messages; those of other topics are JointState."""

_TICK = 0.002  # [s] between two looks at what is due
_MEET = 0.05  # [s] between two looks at who listens


class Intruder:
    """A node that publishes to the topic of another, with an offset.

    Args:
        beside: a node in whose context and namespace it is.
        fault: what it does.
        kind: of the messages.
        topic: its full name.
    """

    def __init__(self, beside: Node, fault: SecondPublisher, kind: Any, topic: str) -> None:
        self._fault = fault
        self._node = rclpy.create_node(
            NAME,
            context=beside.context,
            namespace=beside.get_namespace(),
            use_global_arguments=False,  # its name is its own
            start_parameter_services=False,
        )
        self._publisher = self._node.create_publisher(kind, topic, QOS_STREAM)
        self._due = fault.at

    def publish(self, t: float, last: Any) -> None:
        """Publish, if it is time to at t [s], after the last true message."""
        if t >= self._due:
            self._due = t + 1.0 / self._fault.rate
            self._publisher.publish(self._fault.message(last))

    def close(self) -> None:
        """Destroy the node."""
        self._node.destroy_node()


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

    def parsed(self) -> tuple[Fault, ...]:
        """Return the faults; raises ConfigurationError if one is impossible here."""
        return tuple(map(self._parse, self.faults))

    def _parse(self, text: str) -> Fault:
        try:
            fault = parse_fault(yaml.safe_load(text))
            if isinstance(fault, Kill):
                raise ConfigurationError("nodes are killed by the experiment that has started them")
            if fault.topic not in (*self.topics, ROBOT):
                names = self.topics
                raise UnknownNameError("topic among the parameter 'topics'", fault.topic, names)
            if fault.topic == ROBOT and not set(FROM_ROBOT) & set(self.topics):
                raise ConfigurationError(f"none of {', '.join(FROM_ROBOT)} is among 'topics'")
        except (yaml.YAMLError, ConfigurationError) as error:
            what = "no YAML: " if isinstance(error, yaml.YAMLError) else ""
            raise ConfigurationError(f"parameter 'faults': {text!r}: {what}{error}") from error
        return fault


class FaultInjectorNode(Node):
    """Relays topics, with faults."""

    parameters_type = InjectorParameters

    def __init__(self) -> None:
        super().__init__("fault_injector")
        self.done = False
        self._health = diagnostics.Health(self)
        p = self._params = declare(self, self.parameters_type)
        self._faults = p.parsed()
        if p.start_on and p.start_on not in p.topics:
            raise UnknownNameError("topic in start_on; topics", p.start_on, p.topics)
        self._stream = FaultStream(self._faults, p.seed)
        self._active: set[int] = set()  # the faults that are at work, by their number
        self._intruders: dict[int, Intruder] = {}
        self._latest: dict[str, bytes] = {}
        self._started: float | None = None
        self._outputs: dict[str, Publisher] = {
            topic: self.create_publisher(_type_of(topic), FAULTY + topic, QOS_STREAM)
            for topic in p.topics
        }
        self._unheard = list(p.topics)
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_MEET, self._meet, clock=clock)
        self.create_timer(_TICK, self._tick, clock=clock)
        text = f"{len(self._faults)} faults to come"
        self._health.set(diagnostics.OK, text, mode=WorkMode.READY)
        if not p.start_on:
            self._start()

    @property
    def _now(self) -> float:
        """The time since the start [s]; before it below all times of faults."""
        return -1.0 if self._started is None else steady.now() - self._started

    def _start(self) -> None:
        self._started = steady.now()
        self.get_logger().info("the time of the faults begins")
        tell(Event.READY)

    def _meet(self) -> None:
        """Subscribe to a topic once its relay has a subscriber: nothing sent once is lost."""
        for topic in list(self._unheard):
            if self._outputs[topic].get_subscription_count():
                self._unheard.remove(topic)
                self.create_subscription(
                    _type_of(topic),
                    topic,
                    partial(self._on_message, topic),
                    **overridable(QOS_STREAM),
                    raw=True,
                )

    # --- messages ----------------------------------------------------------------------

    def _on_message(self, topic: str, serialized: bytes) -> None:
        if self._started is None and topic == self._params.start_on:
            self._start()
        t = self._now
        self._latest[topic] = serialized
        if not self._stream.touches(t, topic):
            self._outputs[topic].publish(serialized)  # raw: nothing is decoded
            return
        self._health.count(f"{topic} at which a fault was at work")
        msg = deserialize_message(serialized, _type_of(topic))
        for out in self._stream.on_message(t, topic, msg):
            self._outputs[topic].publish(out)

    def _tick(self) -> None:
        t = self._now
        if t >= self._stream.next_due:
            for topic, msg in self._stream.due(t):
                self._outputs[topic].publish(msg)
        self._begin_and_end(t)
        for number, intruder in self._intruders.items():
            fault = self._faults[number]
            if fault.topic in self._latest:
                last = deserialize_message(self._latest[fault.topic], _type_of(fault.topic))
                intruder.publish(t, last)

    # --- faults ------------------------------------------------------------------------

    def _begin_and_end(self, t: float) -> None:
        """Report which faults begin and end."""
        active = {number for number, fault in enumerate(self._faults) if fault.is_active(t)}
        if active == self._active:
            return
        for number in sorted(active ^ self._active):
            self._change(number, begins=number in active)
        self._active = active
        if active:
            faults = [self._faults[number] for number in sorted(active)]
            at_work = ", ".join(f"{fault.name} on {fault.topic}" for fault in faults)
            self._health.set(diagnostics.WARN, f"at work: {at_work}", mode=WorkMode.WORKING)
        else:
            to_come = sum(fault.at > t for fault in self._faults)
            mode = WorkMode.READY if to_come else WorkMode.DONE
            self._health.set(diagnostics.OK, f"no fault at work, {to_come} to come", mode=mode)

    def _change(self, number: int, begins: bool) -> None:
        fault = self._faults[number]
        self.get_logger().info(f"{'begins' if begins else 'ends'}: {fault}")
        if not isinstance(fault, SecondPublisher):
            return
        if begins:
            topic = self._outputs[fault.topic].topic_name
            self._intruders[number] = Intruder(self, fault, _type_of(fault.topic), topic)
        else:
            self._intruders.pop(number).close()

    def close(self) -> None:
        """Destroy the second publishers."""
        for intruder in self._intruders.values():
            intruder.close()


def _type_of(topic: str) -> Any:
    return TYPES.get(topic, JointState)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(FaultInjectorNode, args)


if __name__ == "__main__":
    sys.exit(main())
