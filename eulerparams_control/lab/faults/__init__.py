"""Faults on purpose: what goes wrong between a robot and its controller, and when.

A ``Fault`` says what happens to a topic or a node, and from when to when; ``parse_fault`` reads
one from YAML.  A ``FaultStream`` does to the messages what the faults say; it is a function of
the seed and of what it is given, so that a run repeats.  ROS-free: a message is anything with
fields of numbers, and a ``header`` with a ``stamp`` where a fault changes stamps.

    faults = [parse_fault({"fault": "drop", "topic": "wrench", "at": 1.0, "for": 0.2})]
    stream = FaultStream(faults, seed=1)
    for msg in stream.on_message(t, "wrench", msg): deliver(msg)
    for topic, msg in stream.due(t): deliver(msg)    # what was held back, and is due

A fault is added as a class in a file that is imported here.
"""

from eulerparams_control.lab.faults.base import (
    FROM_ROBOT,
    ROBOT,
    TO_CONTROLLER,
    TO_ROBOT,
    TOPICS,
    Fault,
    MessageFault,
    parse_fault,
    parse_faults,
)
from eulerparams_control.lab.faults.contents import ClockJump, Freeze, Nan, Noise, Stuck
from eulerparams_control.lab.faults.delivery import Delay, Drop, Duplicate, Reorder
from eulerparams_control.lab.faults.nodes import Kill, SecondPublisher
from eulerparams_control.lab.faults.sequences import random_faults
from eulerparams_control.lab.faults.stream import FaultStream

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
    "parse_fault",
    "parse_faults",
    "random_faults",
]
