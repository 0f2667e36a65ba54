"""Faults on purpose: what goes wrong between a robot and its controller, and when.

A ``Fault`` says what happens to a topic or a node, and from when to when; ``parse_fault`` reads
one from YAML.  A ``FaultStream`` does to the messages what the faults say; it is a function of
the seed and of what it is given, so that a run repeats.  ROS-free: a message is anything with
fields of numbers, and a ``header`` with a ``stamp`` where a fault changes stamps.

    faults = [parse_fault({"fault": "drop", "topic": "wrench", "at": 1.0, "for": 0.2})]
    stream = FaultStream(faults, seed=1)
    for msg in stream.on_message(t, "wrench", msg): deliver(msg)
    for topic, msg in stream.due(t): deliver(msg)    # what was held back, and is due

A fault is added in one file of this folder, with one line of import here.
"""

from eulerparams_control.lab.faults import clock, loss, nodes, order, values
from eulerparams_control.lab.faults.base import Fault, MessageFault
from eulerparams_control.lab.faults.clock import ClockJump
from eulerparams_control.lab.faults.loss import Drop, Duplicate
from eulerparams_control.lab.faults.nodes import Kill, SecondPublisher
from eulerparams_control.lab.faults.order import Delay, Reorder
from eulerparams_control.lab.faults.parsing import parse_fault, parse_faults
from eulerparams_control.lab.faults.sequences import random_faults
from eulerparams_control.lab.faults.stream import FaultStream
from eulerparams_control.lab.faults.topics import FROM_ROBOT, ROBOT, TO_CONTROLLER, TO_ROBOT, TOPICS
from eulerparams_control.lab.faults.values import Freeze, Nan, Noise, Stuck

__all__ = [
    "FROM_ROBOT",
    "ROBOT",
    "TOPICS",
    "TO_CONTROLLER",
    "TO_ROBOT",
    "ClockJump",
    "Delay",
    "Drop",
    "Duplicate",
    "Fault",
    "FaultStream",
    "Freeze",
    "Kill",
    "MessageFault",
    "Nan",
    "Noise",
    "Reorder",
    "SecondPublisher",
    "Stuck",
    "clock",
    "loss",
    "nodes",
    "order",
    "parse_fault",
    "parse_faults",
    "random_faults",
    "values",
]
