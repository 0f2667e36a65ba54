"""From messages to what a record keeps of them."""

from typing import Any

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.lab.campaign.record import Command, Said, State
from eulerparams_control.messages.from_ros import JointStateReader, ns_from_ros
from eulerparams_control.messages.keys import CAUSE, MODE


def command_of(t: float, life: int, msg: Any) -> Command:
    """Return a command published at t [s]."""
    values = (tuple(map(float, part)) for part in (msg.position, msg.velocity, msg.effort))
    return Command(t, life, ns_from_ros(msg.header.stamp) / 1e9, tuple(msg.name), *values)


def state_of(t: float, msg: Any, reader: JointStateReader) -> State:
    """Return the joint_states delivered at t [s]; without values where they cannot be read."""
    stamp = ns_from_ros(msg.header.stamp) / 1e9
    try:
        _, q, dq = reader.from_ros(msg)
    except InvalidMessageError:
        return State(t, stamp, (), ())
    return State(t, stamp, tuple(q.tolist()), tuple(dq.tolist()))


def said_of(t: float, status: Any) -> Said:
    """Return what a status says that was published at t [s]."""
    values = {pair.key: pair.value for pair in status.values}
    level = int.from_bytes(status.level, "little")
    return Said(t, level, status.message, values.get(MODE, ""), values.get(CAUSE, ""))
