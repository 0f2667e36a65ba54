"""Faults on purpose: what goes wrong between a robot and its controller, and when.

A ``Fault`` says what happens to a topic or a node, and from when to when; ``parse_fault`` reads
one from YAML.  A ``FaultStream`` does to the messages what the faults say; it is a function of
the seed and of what it is given, so that a run repeats.  ROS-free: a message is anything with
fields of numbers, and a ``header`` with a ``stamp`` where a fault changes stamps.

    faults = [parse_fault({"fault": "drop", "topic": "wrench", "at": 1.0, "for": 0.2})]
    stream = FaultStream(faults, seed=1)
    for msg in stream.on_message(t, "wrench", msg): deliver(msg)
    for topic, msg in stream.due(t): deliver(msg)    # what was held back, and is due

A fault is added as a class in ``kinds``.
"""

import eulerparams_control.lab.faults.kinds  # noqa: F401  registers them
