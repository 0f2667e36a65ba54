"""Nodes of the package in the test's own process, over real DDS, message by message.

No executor spins and no time passes by itself.  What a node or the test publishes is taken from
each subscription that it is for, and acted on, before ``publish`` returns to the test; timers are
called when the test lets their time pass.  So a test repeats to the bit, however busy the machine.
"""

import importlib
import io
import signal
import time
from collections import Counter, deque
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.subscription import Subscription
from ros_processes import Controlled, Peer, ros_arguments

from eulerparams_control.command_line import executables
from eulerparams_control.control.clock import steady
from eulerparams_control.errors import EulerParamsError
from eulerparams_control.lab.run.domains import Domain

# Number of messages that are handled before a condition is checked again, as a run in lock-step
# does not end by itself; and the longest time [s] until it holds.
_AT_ONCE, _LONGEST = 1000, 100.0
# Time [s] that goes by between two looks at a condition, and after which it is given up.
STEP, PATIENCE = 0.02, 200.0
# Readers without a limit of samples: one of 5000 refuses all that comes after so many messages
# of a publisher that it has missed.  It is read once, by the first node of this process.
_DDS = Path(__file__).with_name("fast_dds.xml")
# How long [s] a node may take to bring its arm to rest, as the executables have it.
_STOP_SECONDS = 3.0


def wait_for(condition, what):
    deadline = time.monotonic() + _LONGEST
    while not condition():
        assert time.monotonic() < deadline, f"{what}: has not happened within {_LONGEST:g} s"
        time.sleep(0.0005)


def taken_by(take_one, what):
    """Return the next of what is taken; wait for it."""
    found = []

    def is_there():
        found[:] = [take_one()]
        return found[0] is not None

    wait_for(is_there, what)
    return found[0]


def take(subscription):
    """Return the next message of a subscription with its info; wait for it."""

    def take_one():
        with subscription.handle:
            return subscription.handle.take_message(subscription.msg_type, subscription.raw)

    return taken_by(take_one, f"a message on {subscription.topic_name}")


def module_of(executable):
    return importlib.import_module(executables()[executable])


def class_of(executable):
    """Return the class of the node of an executable, which its module defines."""
    late = {"bag_recorder": "eulerparams_control.bags.ros.recorder_node"}  # it is imported late
    module = importlib.import_module(late.get(executable, executables()[executable]))
    kinds = (each for each in vars(module).values() if isinstance(each, type))
    return next(k for k in kinds if issubclass(k, Node) and k.__module__ == module.__name__)


@dataclass
class Ended:
    """What an executable said until it ended, and its exit code."""

    exit_code: int
    stdout: str
    stderr: str

    def end(self):
        return self.exit_code


def run_to_its_end(executable, folder, parameters=None, *, files=()):
    """Call the ``main`` of an executable that refuses its parameters, as its users start it."""
    arguments = ros_arguments(folder, parameters, files, ())
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    out, err = io.StringIO(), io.StringIO()
    domain = Domain()
    try:
        with (
            redirect_stdout(out),
            redirect_stderr(err),
            patch.dict("os.environ", {"ROS_DOMAIN_ID": str(domain.number)}),
            patch("sys.argv", [executable, *arguments]),
        ):
            code = module_of(executable).main(arguments)
    finally:
        domain.release()
        for number, handler in before.items():
            signal.signal(number, handler)
    return Ended(code, out.getvalue(), err.getvalue())


class _Log:
    """The logger of a node, which keeps what is said."""

    def __init__(self, lines):
        self._lines = lines

    def __getattr__(self, level):
        return lambda message, **_: self._lines.append(f"[{level.upper()}] {message}")


class InProcess:
    """Goes beside the class of a node: its world learns what it makes and publishes."""

    world: "World"
    log: list[str]

    def get_logger(self):
        return _Log(self.log)

    def create_publisher(self, *args, **keywords):
        return self.world.watch(super().create_publisher(*args, **keywords))

    def create_subscription(self, *args, **keywords):
        subscription = super().create_subscription(*args, **keywords)
        self.world.begin(self, subscription)
        return subscription

    def destroy_subscription(self, subscription):
        self.world.change()
        return bool(super().destroy_subscription(subscription))

    def destroy_node(self):
        self.world.forget(self)
        super().destroy_node()
        vars(self).clear()  # what is left in cycles would keep the ports of the domain

    def create_timer(self, period, callback, **keywords):
        timer = super().create_timer(period, callback, **keywords, autostart=False)
        self.world.timers.append(_Timer(self, timer, period, self.world.now + period))
        return timer


@dataclass
class _Timer:
    """A timer of a node, and when it is due by the clock of the world [s]."""

    node: Any
    timer: Any
    period: float
    due: float


@dataclass
class Running:
    """A node in a world, with what a process would have: a log, and an exit code in the end."""

    world: "World"
    name: str
    node: Any = None
    lines: list[str] = field(default_factory=list)
    stdout: str = ""
    stderr: str = ""
    exit_code: int | None = None

    @property
    def log(self):
        return "\n".join([*self.lines, self.stdout, self.stderr])

    def end(self):
        self.world.until(lambda: self.exit_code is not None, f"the end of {self.name}")
        assert self.exit_code is not None
        return self.exit_code

    def kill(self):
        """Destroy the node without warning."""
        self.exit_code = -9
        self.node.destroy_node()

    def stop(self, meanwhile=lambda: None):
        """End the node as a signal does, while something goes on; return the exit code."""
        deadline = self.world.now + _STOP_SECONDS
        at_rest = getattr(self.node, "at_rest", lambda: True)
        while not self.world.act(at_rest) and self.world.now < deadline:
            meanwhile()
            self.world.advance(STEP)
        self.finish()
        assert self.exit_code is not None
        return self.exit_code

    def finish(self, error=None):
        """End the node as the runtime does when it is done, or has failed."""
        out, err = io.StringIO(), io.StringIO()
        node = self.node
        if error is not None:
            self.stderr += f"error: {error}\n"
        self.exit_code = error.exit_code if error is not None else 0
        self.world.act(getattr(node, "close", lambda: None))
        if hasattr(node, "finish") and self.exit_code == 0:
            with redirect_stdout(out), redirect_stderr(err):
                self.exit_code = node.finish()
            self.stdout, self.stderr = self.stdout + out.getvalue(), self.stderr + err.getvalue()
        node.destroy_node()

    def review(self):
        if self.exit_code is None and getattr(self.node, "done", False):
            self.finish(getattr(self.node, "error", None))


class World:
    """A ROS domain with nodes in this process, and ``peer``, the node of the test.

    Attributes:
        now: the steady clock of all its nodes [s]; it goes on when the test says so.
        timers: of all nodes.
    """

    step = STEP

    def __init__(self, folder):
        self.folder = folder
        self._domain = Domain()
        self.domain = self._domain.number
        self.now = 1000.0
        self.timers = []
        self.running = []
        self._nodes = []
        self._publishers = []
        self._sent = Counter()  # messages by the id of a publisher
        self._waiting = deque()
        self._outstanding = Counter()  # by the id of a subscription
        self._is_acting = False
        self._has_changed = False
        self._routes = {}
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=self.domain)
        with patch.dict("os.environ", {"FASTRTPS_DEFAULT_PROFILES_FILE": str(_DDS)}):
            self.peer = WorldPeer(self)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        try:
            for node in list(self._nodes):
                node.destroy_node()
            self.context.try_shutdown()
            self.context.destroy()
        finally:
            steady.go_by()
            self._domain.release()

    # --- nodes -------------------------------------------------------------------------

    def start(self, executable, parameters=None, *, files=(), namespace="", remap=()):
        """Make the node of an executable; ``files`` of parameters come before ``parameters``."""
        rules = [f"__ns:={namespace}", *remap] if namespace else remap
        arguments = ros_arguments(self.folder, parameters, files, rules)
        running = Running(self, executable)
        self.running.append(running)
        try:
            running.node = self.make(class_of(executable), running.lines, cli_args=arguments)
        except EulerParamsError as error:
            running.stderr += f"error: {error}\n"
            running.exit_code = error.exit_code
        running.review()
        return running

    def make(self, kind, lines, *args, cli_args=None, **given):
        """Return a node of a class in this world, which logs to ``lines``."""
        initialize = Node.__init__

        def with_context(node, name, **keywords):
            keywords |= {"context": self.context, "cli_args": cli_args}
            initialize(node, name, **keywords)
            self._nodes.append(node)
            self.change()

        made = type(kind.__name__, (InProcess, kind), {"world": self, "log": lines})
        with patch.object(Node, "__init__", with_context):
            node = self.act(lambda: made(*args, **given))
        return node

    def create_node(self, name, **_):
        """Return a plain node in this world, as ``rclpy.create_node`` does."""
        return self.make(Node, [], name)

    def forget(self, node):
        self._nodes.remove(node)
        self.timers = [each for each in self.timers if each.node is not node]
        gone = set(map(id, node.publishers))
        self._publishers = [each for each in self._publishers if id(each) not in gone]
        self.change()

    def logs(self):
        return "\n".join(f"--- {each.name}: {each.exit_code}\n{each.log}" for each in self.running)

    # --- messages ----------------------------------------------------------------------

    def watch(self, publisher):
        """Let what a publisher sends be acted on."""
        send, count = publisher.publish, publisher.get_subscription_count

        def settled_count():
            least, words = len(self._listeners(publisher)), "the subscribers of"
            wait_for(lambda: count() >= least, f"{words} {publisher.topic_name}")
            return int(count())

        def publish(msg):
            settled_count()
            send(msg)
            self._sent[id(publisher)] += 1
            for node, subscription in self._listeners(publisher):
                self._expect(node, subscription)
            self.act()

        publisher.publish, publisher.get_subscription_count = publish, settled_count
        self._publishers.append(publisher)
        self.change()
        return publisher

    def begin(self, node, subscription):
        """Expect what was sent before a subscription to a latched topic."""
        for publisher in self._publishers:
            is_latched = subscription.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
            if is_latched and _match(publisher, subscription):
                for _ in range(min(self._sent[id(publisher)], publisher.qos_profile.depth)):
                    self._expect(node, subscription)
        self.change()
        self.act()

    def change(self):
        """Note that publishers or subscriptions come or go."""
        self._has_changed = True
        self._routes.clear()

    def act(self, callback=lambda: None):
        """Call something of a node, and then let all messages be acted on; return its result."""
        steady.go_by(lambda: self.now)
        if self._is_acting:
            return callback()
        self._is_acting = True
        try:
            result = callback()
            self._settle()
        finally:
            self._is_acting = False
        for running in self.running:
            running.review()
        return result

    def _listeners(self, publisher):
        """Return the subscriptions that a publisher is heard by, with their nodes."""
        if id(publisher) not in self._routes:
            heard = [(n, s) for n in self._nodes for s in n.subscriptions if _match(publisher, s)]
            self._routes[id(publisher)] = heard
        return self._routes[id(publisher)]

    def _expect(self, node, subscription):
        """Expect one message more, of those that its queue holds."""
        if self._outstanding[id(subscription)] < subscription.qos_profile.depth:
            self._outstanding[id(subscription)] += 1
            self._waiting.append((node, subscription))

    def _settle(self):
        self._see_changes()
        for _ in range(_AT_ONCE):
            if not self._waiting:
                break
            node, subscription = self._waiting.popleft()
            self._outstanding[id(subscription)] -= 1
            if node in self._nodes and subscription in node.subscriptions:
                self._deliver(node, subscription)
                self._see_changes()

    def _deliver(self, node, subscription):
        msg, info = take(subscription)
        with self._failing(node):
            if subscription._callback_type is Subscription.CallbackType.MessageOnly:
                subscription.callback(msg)
            else:
                subscription.callback(msg, info)

    @contextmanager
    def _failing(self, node):
        """End a node by an error of the package, as the runtime does."""
        try:
            yield
        except EulerParamsError as error:
            running = next(each for each in self.running if each.node is node)
            running.finish(error)

    def _see_changes(self):
        """Wait until the graph shows the publishers and subscriptions that there are."""
        if not self._has_changed or not self._nodes:
            return
        self._has_changed = False
        there = Counter(p.topic_name for n in self._nodes for p in n.publishers)
        for topic, count in there.items():
            wait_for(
                lambda t=topic, c=count: self._nodes[0].count_publishers(t) == c,
                f"{count} publishers of {topic}",
            )

    # --- services ----------------------------------------------------------------------

    def ask(self, client, request):
        """Let a service of a node answer a client; return the response."""
        wait_for(client.service_is_ready, f"service {client.srv_name}")
        name, words = client.srv_name.strip("/"), f"a message of {client.srv_name}"
        services = (service for node in self._nodes for service in node.services)
        service = next(s for s in services if s.service_name.strip("/") == name)
        kind = service.srv_type

        def taken(take_one, index):
            def whole():
                found = take_one()
                return found if found is not None and found[index] is not None else None

            return taken_by(whole, words)

        client.handle.send_request(request)
        asked, header = taken(lambda: service.handle.service_take_request(kind.Request), 1)
        response = self.act(lambda: service.callback(asked, kind.Response()))
        service.send_response(response, header)
        return taken(lambda: client.handle.take_response(kind.Response), 0)[1]

    # --- time --------------------------------------------------------------------------

    def advance(self, seconds):
        """Let time pass, and call the timers that are due meanwhile, in their order."""
        end = self.now + seconds
        while True:
            self.timers = [each for each in self.timers if each.timer in each.node.timers]
            due = min(self.timers, key=lambda each: each.due, default=None)
            if due is None or due.due > end:
                break
            self.now = max(self.now, due.due)
            due.due += due.period
            self.act(lambda d=due: self._call(d))
        self.now = end

    def _call(self, due):
        with self._failing(due.node):
            due.timer.callback()

    def until(self, condition, what):
        """Let time pass until ``condition()`` is true; return what it returned."""
        deadline = time.monotonic() + _LONGEST
        for _ in range(round(PATIENCE / STEP)):
            while not (result := condition()) and self._waiting:
                self.act()
                assert time.monotonic() < deadline, f"{what}: takes too long\n{self.logs()}"
            if result:
                return result
            self.advance(STEP)
        raise AssertionError(f"{what}: has not happened; what was said:\n{self.logs()}")

    def until_said(self, running, words):
        self.until(lambda: words in running.log, f"'{words}' in the log")


def each_once(parameters):
    """Return a fixture that starts controllers by name, each once and in a world of its own."""

    @pytest.fixture(scope="module")
    def shared(tmp_path_factory):
        with ExitStack() as stack:

            @cache
            def start(executable):
                world = stack.enter_context(World(tmp_path_factory.mktemp(executable)))
                return Controlled(world, executable, parameters(executable))

            yield start

    return shared


class WorldPeer(Peer):
    """The node of the test in a world."""

    def __init__(self, world):
        super().__init__(world)
        self.node = self.another_node("peer")

    def another_node(self, name):
        return self.graph.create_node(name)


def _match(publisher, subscription):
    """Return whether DDS gives a subscription what a publisher sends."""
    sends, takes = publisher.qos_profile, subscription.qos_profile
    best, volatile = ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE
    return (
        publisher.topic_name == subscription.topic_name
        and not (sends.reliability == best != takes.reliability)
        and not (sends.durability == volatile != takes.durability)
    )
