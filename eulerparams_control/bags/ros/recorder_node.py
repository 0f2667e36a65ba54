"""The node ``bag_recorder``: messages as they come, serialised, into a bag.

``bag_recorder --recover BAG`` makes a whole bag beside a killed recording, as far as it goes.
"""

import dataclasses
import importlib
import time
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

from eulerparams_control.bags.format import PARAMETERS_ATTACHMENT, Topic
from eulerparams_control.bags.ros.remote_parameters import RemoteParameters
from eulerparams_control.bags.writer import BagWriter, message_definition
from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.events import Event, tell
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.publishers import UNKNOWN_NAME

_TICK_SECONDS = 0.1
_REMIND_SECONDS = 2.0
_PUBLISHERS_SECONDS = 1.0
_NAME_SECONDS = 5.0  # a publisher that is no node's has no name


@dataclasses.dataclass(frozen=True)
class RecorderParameters:
    """Parameters of ``bag_recorder``."""

    output: str = parameter("", "folder of the bag, which must not exist; empty: rosbag2_<time>")
    topics: tuple[str, ...] = parameter((), "topics to record; empty: all that appear")
    include_hidden: bool = parameter(
        False, "whether 'all' means /rosout and topics with a leading _ in their name, too"
    )
    depth: int = parameter(
        10000, "how many messages of a topic may wait to be stored", bounds=(1, 1_000_000)
    )


class BagRecorder(Node):
    """Records until it is closed.

    With a list of topics it waits until each has a publisher, and the nodes of these have told
    their parameters, then subscribes to all of them at once; without one it takes every topic as
    it appears.

    Raises:
        BagError: if the folder exists; later, if the disk is full.
        ConfigurationError: if a parameter is unknown or impossible.
    """

    parameters_type = RecorderParameters

    def __init__(self) -> None:
        super().__init__("bag_recorder")
        self.done = False
        self._options = declare(self, self.parameters_type)
        self._wanted = [_resolved(self, name) for name in self._options.topics]
        self._bag = BagWriter(self._options.output or time.strftime("rosbag2_%Y_%m_%d-%H_%M_%S"))
        self._recorded: dict[str, Subscription] = {}
        self._refused: set[str] = set()
        self._nameless: dict[tuple[int, ...], float] = {}  # publishers, and when they were seen
        self._lost = 0
        self._error: BagError | None = None
        self._node_parameters = RemoteParameters(self)
        self._stored_parameters = ""
        self._reminded = time.monotonic()
        self._step: Callable[[], None] = self._await_publishers if self._wanted else self._discover
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_TICK_SECONDS, self._tick, clock=steady)
        self.create_timer(_PUBLISHERS_SECONDS, self._ask_publishers, clock=steady)

    def close(self) -> None:
        """Finish the bag and log what it holds.

        Raises:
            BagError: if it could not be recorded or made whole.
        """
        for subscription in self._recorded.values():
            self._drain(subscription)
        if self._error is None:
            self._store_parameters()
        self._bag.close()
        if self._error is not None:
            raise self._error
        contents = self._bag.contents
        megabytes = sum(file.stat().st_size for file in self._bag.folder.iterdir()) / 1e6
        self.get_logger().info(
            f"recorded {contents.message_count} messages on {len(contents.topics)} topics, "
            f"{megabytes:.1f} MB, {self._lost} lost, in {self._bag.folder}"
        )

    def _tick(self) -> None:
        try:
            self._step()
            self._node_parameters.advance()
            if self._node_parameters.ready:
                self._store_parameters()
            self._bag.flush()
        except BagError as error:
            self._fail(error)

    def _fail(self, error: BagError) -> None:
        """End the node; ``close`` raises ``error``, for rclpy shouts what a callback raises."""
        self._error = error
        self.done = True

    def _await_publishers(self) -> None:
        offers = {name: self._offers_of(name) for name in self._wanted}
        missing = [name for name, publishers in offers.items() if not publishers]
        seen = [info for publishers in offers.values() for info in publishers]
        self._ask(seen)
        # else a short run would be over before its nodes have told their parameters
        if not (missing or self._await_names(seen) or self._node_parameters.awaited):
            for name, publishers in offers.items():
                self._record(name, publishers)
            self._step = self._await_matches
        self._remind(missing)

    def _await_matches(self) -> None:
        missing = [name for name, sub in self._recorded.items() if not sub.get_publisher_count()]
        if not missing:
            count = len(self._recorded)
            self.get_logger().info(f"recording {count} topics to {self._bag.folder}")
            tell(Event.READY)
            self._step = lambda: None
        self._remind(missing)

    def _await_names(self, publishers: list[TopicEndpointInfo]) -> bool:
        """Return whether the node of one of them may soon be known by its name."""
        now = time.monotonic()
        nameless = [tuple(i.endpoint_gid) for i in publishers if i.node_name == UNKNOWN_NAME]
        return any(now - self._nameless.setdefault(gid, now) < _NAME_SECONDS for gid in nameless)

    def _remind(self, missing: list[str]) -> None:
        if missing and time.monotonic() - self._reminded > _REMIND_SECONDS:
            self._reminded = time.monotonic()
            self.get_logger().info(f"waiting for a publisher of {', '.join(missing)}")

    def _discover(self) -> None:
        for name, _ in self.get_topic_names_and_types():
            hidden = name == "/rosout" or topic_or_service_is_hidden(name)
            if name in self._recorded or (hidden and not self._options.include_hidden):
                continue
            publishers = self._offers_of(name)
            if publishers and name not in self._refused:
                self._record_if_possible(name, publishers)

    def _record_if_possible(self, name: str, publishers: list[TopicEndpointInfo]) -> None:
        try:
            self._record(name, publishers)
            self.get_logger().info(f"recording {name} to {self._bag.folder}")
        except MessageTypeError as error:
            self._refused.add(name)
            self.get_logger().warning(f"left out: {error}")

    def _offers_of(self, name: str) -> list[TopicEndpointInfo]:
        """Return what is known of the publishers of a topic, besides this node."""
        own = (self.get_name(), self.get_namespace())
        publishers = self.get_publishers_info_by_topic(name)
        return [info for info in publishers if (info.node_name, info.node_namespace) != own]

    def _record(self, name: str, publishers: list[TopicEndpointInfo]) -> None:
        """Subscribe to a topic with the best QoS that all its publishers offer."""
        message_type = _type_of(name, publishers)
        message_class = _message_class(message_type)
        profiles = tuple(_profile(info.qos_profile) for info in publishers)
        self._bag.add_topic(Topic(name, message_type, _hash_of(publishers), profiles))
        subscription = self.create_subscription(
            message_class,
            name,
            self._storing(name),
            _adapted_qos(publishers, self._options.depth),
            event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_lost),
            raw=True,
        )
        # Asks for the info. A callback of two arguments would, too, but ends the executor.
        subscription._callback_type = Subscription.CallbackType.WithMessageInfo
        self._recorded[name] = subscription
        self._ask(publishers)

    def _storing(self, name: str) -> Callable[..., None]:
        """Return the callback of a topic; it runs for every message, so it does little."""
        write = self._bag.write

        def store(*received: Any) -> None:
            # rclpy's EventsExecutor passes (message, info) as one argument, others as two
            data, info = received if len(received) == 2 else received[0]
            try:
                write(name, data, info["received_timestamp"], info["source_timestamp"])
            except BagError as error:
                self._fail(error)

        return store

    def _drain(self, subscription: Subscription) -> None:
        """Store what has arrived but was not handed over when the executor stopped."""
        handle = subscription.handle
        with handle:
            for _ in range(self._options.depth):
                received = handle.take_message(subscription.msg_type, subscription.raw)
                if received is None or self._error is not None:
                    break
                subscription.callback(received)

    def _on_lost(self, event: Any) -> None:
        self._lost += event.total_count_change

    def _ask_publishers(self) -> None:
        for name in self._recorded:
            self._ask(self._offers_of(name))

    def _ask(self, publishers: list[TopicEndpointInfo]) -> None:
        """Ask the nodes of these publishers for their parameters."""
        self._node_parameters.ask(
            f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            for info in publishers
            if not info.node_name.startswith("_")  # hidden, or its name has not arrived yet
        )

    def _store_parameters(self) -> None:
        text = self._node_parameters.text()
        if text != self._stored_parameters:
            self._bag.attach(PARAMETERS_ATTACHMENT, text)
            self._stored_parameters = text


class MessageTypeError(BagError):
    """The type of a topic is not one that can be recorded."""


def _resolved(node: Node, name: str) -> str:
    try:
        return str(node.resolve_topic_name(name))
    except (InvalidTopicNameException, RuntimeError) as error:  # either, as the fault is
        raise ConfigurationError(f"parameter 'topics': '{name}' is no topic name") from error


def _type_of(name: str, publishers: list[TopicEndpointInfo]) -> str:
    types = sorted({info.topic_type for info in publishers})
    if len(types) > 1:
        raise MessageTypeError(f"{name} has publishers of several types: {', '.join(types)}")
    return types[0]


def _hash_of(publishers: list[TopicEndpointInfo]) -> str:
    """Return the type hash; empty if the publishers are of a ROS without hashes."""
    hashes = (str(info.topic_type_hash) for info in publishers)
    return next((text for text in hashes if text.startswith("RIHS")), "")


def _message_class(message_type: str) -> type:
    package, _, name = message_type.partition("/msg/")
    try:
        message_definition(message_type)
        found: type = getattr(importlib.import_module(f"{package}.msg"), name)
    except (BagError, ImportError, AttributeError) as error:
        raise MessageTypeError(f"{message_type} is not installed here: {error}") from error
    return found


def _profile(qos: QoSProfile) -> dict[str, Any]:
    """Return a QoS profile in the words of metadata version 9."""

    def duration(value: Duration) -> dict[str, int]:
        sec, nsec = divmod(value.nanoseconds, 10**9)
        return {"sec": sec, "nsec": nsec}

    return {
        "history": qos.history.name.lower(),
        "depth": qos.depth,
        "reliability": qos.reliability.name.lower(),
        "durability": qos.durability.name.lower(),
        "deadline": duration(qos.deadline),
        "lifespan": duration(qos.lifespan),
        "liveliness": qos.liveliness.name.lower(),
        "liveliness_lease_duration": duration(qos.liveliness_lease_duration),
        "avoid_ros_namespace_conventions": False,
    }


def _adapted_qos(publishers: list[TopicEndpointInfo], depth: int) -> QoSProfile:
    """Return what every publisher can serve: reliable, latched, only if all of them are."""
    offers = [info.qos_profile for info in publishers]
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
