"""The parameters of other nodes, asked for while they run."""

import time
from collections.abc import Generator, Iterable, Iterator
from typing import Any

from rcl_interfaces.msg import ParameterEvent, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events

from eulerparams_control.bags.format import dump_yaml

_PATIENCE_SECONDS = 5.0  # for nodes that do not answer
_RETRY_SECONDS = 1.0  # an answer sent before both ends have met is lost
_LONGEST_DESCRIPTION = 10_000  # characters; a longer URDF is left out, its topic has it


class RemoteParameters:
    """Parameters of the nodes, as they answer, kept up to date by their events.

    Args:
        node: the node that asks.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._answers: dict[str, dict[str, Any]] = {}
        self._queries: dict[str, Iterator[None]] = {}
        self._deadline = 0.0
        self._fresh = False  # whether text() would show answers that it has not shown
        self._subscription = node.create_subscription(
            ParameterEvent, "/parameter_events", self._on_event, qos_profile_parameter_events
        )

    @property
    def awaited(self) -> bool:
        """Whether a node is left that might answer soon."""
        return bool(self._queries) and time.monotonic() <= self._deadline

    @property
    def ready(self) -> bool:
        """Whether there are new answers, and none is awaited."""
        return self._fresh and not self.awaited

    def ask(self, nodes: Iterable[str]) -> None:
        """Begin to ask the nodes of these full names that were not asked yet."""
        for name in nodes:
            if name not in self._answers and name not in self._queries:
                self._queries[name] = self._query(name)
                self._deadline = time.monotonic() + _PATIENCE_SECONDS

    def advance(self) -> None:
        """Take what has arrived; to be called again and again, it never waits."""
        for name, query in list(self._queries.items()):
            next(query, None)
            if name in self._answers:
                del self._queries[name]

    def text(self) -> str:
        """Return all answers as ``ros2 param dump`` writes them; empty if there are none."""
        self._fresh = False
        dump = {node: {"ros__parameters": _nested(self._answers[node])} for node in self._answers}
        return dump_yaml(dump) if dump else ""

    def _query(self, node: str) -> Iterator[None]:
        lister = self._node.create_client(ListParameters, f"{node}/list_parameters")
        getter = self._node.create_client(GetParameters, f"{node}/get_parameters")
        names = (yield from _call(lister, ListParameters.Request())).result.names
        values = (yield from _call(getter, GetParameters.Request(names=names))).values
        self._answers[node] = {}
        self._fresh = True
        self._update(node, zip(names, values, strict=False))
        self._node.destroy_client(lister)
        self._node.destroy_client(getter)

    def _on_event(self, event: ParameterEvent) -> None:
        if event.node in self._answers:
            changes = [*event.new_parameters, *event.changed_parameters]
            self._update(event.node, ((change.name, change.value) for change in changes))
            for deleted in event.deleted_parameters:
                self._answers[event.node].pop(deleted.name, None)

    def _update(self, node: str, parameters: Iterable[tuple[str, ParameterValue]]) -> None:
        for name, message in parameters:
            value = _plain(message)
            if not (name == "robot_description" and len(str(value)) > _LONGEST_DESCRIPTION):
                self._answers[node][name] = value


def _call(client: Client, request: Any) -> Generator[None, None, Any]:
    """Yield until the service has answered; return the answer."""
    while True:
        while not client.service_is_ready():
            yield
        future = client.call_async(request)
        deadline = time.monotonic() + _RETRY_SECONDS
        while time.monotonic() < deadline:
            yield
            if future.done():
                return future.result()
        client.remove_pending_request(future)


def _plain(message: ParameterValue) -> Any:
    value = parameter_value_to_python(message)
    if isinstance(value, list):
        return [item[0] if isinstance(item, bytes) else item for item in value]
    return value


def _nested(parameters: dict[str, Any]) -> dict[str, Any]:
    """Return ``{"a.b": 1}`` as ``{"a": {"b": 1}}``; a name that is also a group stays flat."""
    tree: dict[str, Any] = {}
    for name, value in sorted(parameters.items()):
        branch, (head, dot, rest) = tree, name.partition(".")
        while dot and isinstance(branch.setdefault(head, {}), dict):
            branch, (head, dot, rest) = branch[head], rest.partition(".")
        branch[head + dot + rest] = value
    return tree
