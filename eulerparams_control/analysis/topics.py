"""Roles of the topics of a bag, and the arms in it by their namespaces."""

from collections.abc import Mapping

from eulerparams_control.analysis.queues import Queue
from eulerparams_control.bags.reader import Bag
from eulerparams_control.errors import BagError, UnknownNameError

TYPES = {name: kind.type for name, kind in Queue.registry.items()}
TYPES["robot_description"] = "std_msgs/msg/String"
"""Topics that are read of a bag, by their names in sec. 4 of the design, with their types."""

_SHARED = ("diagnostics", "robot_description")  # one may be for all arms
_OF_A_NODE = "desired"  # below the name of a controller; of two it is not known which leads the arm


def namespaces(bag: Bag, names: Mapping[str, str]) -> list[str]:
    """Return the namespaces of the arms in a bag, "" for one that has none.

    Args:
        bag: the bag.
        names: what a topic is called in this bag, by what it is called here.

    Raises:
        BagError: if no joint_states were recorded.
    """
    if "joint_states" in names:
        return [""]
    found = sorted(topic.rpartition("/")[0] for topic in _playing(bag, "joint_states"))
    if not found:
        raise BagError(
            f"{bag.path}: no joint_states; found {', '.join(sorted(bag.topics)) or 'nothing'}; "
            "if they have another name, give it with --topic joint_states:=/NAME"
        )
    return found


def topics(bag: Bag, namespace: str, names: Mapping[str, str]) -> dict[str, str]:
    """Return the topics of an arm by what they are called here; without those not recorded.

    Raises:
        UnknownNameError: if ``names`` has a name that is none, or a topic that is not there.
        BagError: if a topic that was named has another type.
    """
    chosen = {}
    for name in TYPES:
        there = _playing(bag, name)
        own = [topic for topic in there if topic.rpartition("/")[0] == namespace]
        if name == _OF_A_NODE:
            below = [topic for topic in there if topic.rsplit("/", 2)[0] == namespace]
            own = below if len(below) == 1 else []
        if own:
            chosen[name] = own[0]
        elif len(there) == 1 and name != _OF_A_NODE and (name in _SHARED or not namespace):
            chosen[name] = there[0]
    for name, topic in names.items():
        chosen[name] = _named(bag, name, topic)
    return chosen


def _playing(bag: Bag, name: str) -> list[str]:
    """Return the topics whose last part and type are those of ``name``, and have messages."""
    return [
        topic
        for topic, info in bag.topics.items()
        if topic.rpartition("/")[2] == name and info.type == TYPES[name] and info.count
    ]


def _named(bag: Bag, name: str, topic: str) -> str:
    if name not in TYPES:
        raise UnknownNameError("topic", name, TYPES)
    if topic not in bag.topics:
        raise UnknownNameError("topic in the bag", topic, bag.topics)
    found = bag.topics[topic].type
    if found != TYPES[name]:
        raise BagError(f"{bag.path}: {topic} is {found}; expected {TYPES[name]} for {name}")
    return topic
