"""Control nodes and the recorder as processes of their own, against bare rclpy echos.

A driver publishes joint_states at 1 kHz to one of them after the other, in blocks, so that noise
meets all alike.
"""

import gc
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from mcap.reader import make_reader
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rows import Row
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from timing import cpu_time

from eulerparams_control.events import Event
from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.lab.run.processes import Nodes
from eulerparams_control.parameters.fields import fields_of
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.robot.catalogue import load_robot

PERIOD, STEP = 1e-3, 1_000_000  # [s], [ns]
MESSAGES, BLOCK, WARM_UP = 4000, 250, 1000
NODES = {name: c.command for name, c in CONTROLLERS.items() if c.executables == (name,)}
"""The nodes, and the topic on which each answers."""
SENSING = [name for name in NODES if "wrench" in CONTROLLERS[name].inputs]
ECHO, RAW_ECHO = "echo", "raw_echo"
PARAMETERS = {"tip_frame": "tool0", "state_timeout": 10.0}  # others have their turn meanwhile
NO_SIGNALS = SignalHandlerOptions.NO
PRIORITY = "realtime_priority"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BARE_START = "import numpy, pinocchio, rclpy; rclpy.init(); rclpy.create_node('bare')"
TOPICS = 10  # of the recorder
UR5 = load_robot("ur5")


class Session(NamedTuple):
    """Processes in a ROS domain of their own, and what drives them: a node of this process."""

    folder: Path
    nodes: Nodes
    driver: Node
    executor: EventsExecutor

    def spin_until(self, due: float) -> None:
        """Take messages until a time [s] of the steady clock."""
        while (left := due - time.perf_counter()) > 0:
            self.executor.spin_once(timeout_sec=left)


@contextmanager
def session() -> Iterator[Session]:
    with tempfile.TemporaryDirectory() as folder, Nodes(Path(folder)) as nodes:
        context, domain = Context(), int(nodes.environment["ROS_DOMAIN_ID"])
        rclpy.init(context=context, domain_id=domain, signal_handler_options=NO_SIGNALS)
        driver, executor = Node("driver", context=context), EventsExecutor(context=context)
        executor.add_node(driver)
        gc.collect()
        gc.freeze()  # as the nodes do
        try:
            yield Session(Path(folder), nodes, driver, executor)
        finally:
            gc.unfreeze()
            executor.shutdown()
            driver.destroy_node()
            context.try_shutdown()


@contextmanager
def echo(session: Session, kind: str = ECHO, namespace: str = ECHO) -> Iterator[int]:
    """Run an echo; yield its process id."""
    command = [sys.executable, __file__, kind, "--ros-args", "-r", f"__ns:=/{namespace}"]
    process = subprocess.Popen(command, env=session.nodes.environment)
    try:
        yield process.pid
    finally:
        process.terminate()
        process.wait()


def run_echo(kind: str) -> None:
    """Run the least that a node can do: copy a message it received into one it sends."""
    rclpy.init(signal_handler_options=NO_SIGNALS)
    executor, node, reply, stopped = EventsExecutor(), Node("echo"), JointState(), []
    publisher = node.create_publisher(JointState, "joint_reference", 10)

    def answer(msg: JointState) -> None:
        reply.header.stamp = msg.header.stamp
        reply.name, reply.position, reply.velocity = msg.name, msg.position, msg.velocity
        publisher.publish(reply)

    raw = kind == RAW_ECHO
    take = publisher.publish if raw else answer
    node.create_subscription(JointState, "joint_states", take, 10, raw=raw)
    executor.add_node(node)
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))
    while not stopped:
        executor.spin_once(timeout_sec=0.05)


class Answers:
    """What a node, or an echo, makes of joint_states.

    Attributes:
        times: of its round trips [us].
        sent: how many states it was sent.
        cpu: processor time that it took for them [s].
        gap: longest time between two answers of a block [ms].
    """

    def __init__(self, session: Session, name: str, pid: int, topic: str = "") -> None:
        self._session, self._pid, create = session, pid, session.driver.create_publisher
        description = create(String, f"{name}/robot_description", LATCHED)
        description.publish(String(data=UR5.urdf))
        self._state = JointState(name=list(UR5.joints), position=list(UR5.home))
        self._state.velocity = [0.0] * len(UR5.joints)
        self._wrench = WrenchStamped()
        self._wrench.header.frame_id = UR5.sensor_frame
        self._states = create(JointState, f"{name}/joint_states", 10)
        self._wrenches = create(WrenchStamped, f"{name}/wrench", 10) if name in SENSING else None
        topic = topic or f"{name}/{NODES.get(name, 'joint_reference')}"
        session.driver.create_subscription(JointState, topic, self._answer, 1000, raw=True)
        self.clear()

    def clear(self) -> None:
        """Forget what was measured."""
        self.times: list[float] = []
        self.sent, self.cpu, self.gap, self._last = 0, 0.0, 0.0, 0
        self._waiting: dict[bytes, int] = {}  # when they were sent [ns], by stamp

    def warm_up(self, count: int) -> "Answers":
        """Send states until one is answered, then ``count`` more; forget them."""
        deadline = time.monotonic() + 120  # all may be compiled first
        while not self.times and time.monotonic() < deadline:
            self.drive(10, 0.0)
        self.drive(count)
        self.clear()
        return self

    def drive(self, count: int = BLOCK, patience: float = 0.5) -> None:
        """Send a block of so many states; wait for their answers for a time [s]."""
        begin, stamp, cpu = time.perf_counter(), time.time_ns(), cpu_time(self._pid)
        self._last = 0
        for i in range(count):
            self._session.spin_until(begin + i * PERIOD)
            self._send(stamp + i * STEP)
        deadline = time.perf_counter() + patience
        while self._waiting and time.perf_counter() < deadline:
            self._session.executor.spin_once(timeout_sec=0.005)
        self._waiting.clear()
        self.cpu += cpu_time(self._pid) - cpu

    def _send(self, stamp: int) -> None:
        header = self._state.header.stamp
        header.sec, header.nanosec = divmod(stamp, 10**9)
        self.expect(struct.pack("<iI", header.sec, header.nanosec), time.time_ns())
        if self._wrenches is not None:
            self._wrench.header.stamp = header
            self._wrench.wrench.force.x = 1e-12 * header.nanosec  # one that repeats itself is stuck
            self._wrenches.publish(self._wrench)
        self._states.publish(self._state)

    def expect(self, stamp: bytes, sent: int) -> None:
        """Expect an answer to a state that was sent then [ns]."""
        self._waiting[stamp] = sent
        self.sent += 1

    def _answer(self, data: bytes) -> None:
        if (sent := self._waiting.pop(data[4:12], None)) is not None:
            now = time.time_ns()
            self.times.append((now - sent) / 1e3)
            self.gap = max(self.gap, (now - (self._last or now)) / 1e6)
            self._last = now

    def p(self, percent: float) -> float:
        """Return a percentile of the round trips [us]."""
        return float(np.percentile(self.times, percent))

    def __str__(self) -> str:
        return f"p99.9 {self.p(99.9):.0f} us, longest gap {self.gap:.1f} ms"

    @property
    def cpu_each(self) -> float:
        """The processor time for a message [s]."""
        return self.cpu / self.sent


def race(names: Sequence[str], parameters: dict[str, Any], quick: bool) -> dict[str, Answers]:
    """Return the answers of echos and nodes."""
    with ExitStack() as stack:
        here = stack.enter_context(session())
        pids = {kind: stack.enter_context(echo(here, kind, kind)) for kind in (ECHO, RAW_ECHO)}
        for name in names:
            here.nodes.start(name, PARAMETERS | parameters, f"/{name}")
            pids[name] = here.nodes.processes[name].pid
        answers = {name: Answers(here, name, pid) for name, pid in pids.items()}
        for each in answers.values():
            each.warm_up(WARM_UP // 4 if quick else WARM_UP)
        for _ in range(MESSAGES // BLOCK // (4 if quick else 1)):
            for each in answers.values():
                each.drive()
        return answers


def nodes(quick: bool) -> Iterator[Row]:
    """Yield the round trips of nodes at 1 kHz; also with realtime_priority, where they have it."""
    having = [name for name in NODES if PRIORITY in fields_of(schemes()[name].parameters)]
    runs = [("", list(NODES), {})]
    runs += [(f" with {PRIORITY}", having, {PRIORITY: 50})] if having else []
    for how, names, parameters in runs:
        answers = race(names, parameters, quick)
        echo = answers[ECHO]
        for name, each in answers.items():
            kind = f"node{' with wrench' if name in SENSING and not how else ''}{how}"
            what = f"{kind if name in NODES else 'raw echo, the floor,'} / typed echo"
            if how and name not in NODES:
                continue
            for q in (50, 99) if name != ECHO else ():
                figure = f"{each.p(q):.0f} us / {echo.p(q):.0f} us"
                if q == 99:
                    figure += f"; {each}, processor {1e6 * each.cpu_each:.0f} us a message"
                yield Row(f"{what}, p{q}", name, each.p(q) / echo.p(q), figure)
            count = len(each.times)
            what = "states answered / sent" if name in NODES else "states answered / sent, echos"
            yield Row(what, name + how, count / each.sent, f"{count} of {each.sent}")


def start(quick: bool) -> Iterator[Row]:
    """Yield the start of a node, import to first command, against imports and a bare node."""
    for name in NODES:
        times = []
        for _ in range(2 if quick else 4):  # the first one may compile
            with session() as here:
                begin = time.perf_counter()
                here.nodes.start(name, PARAMETERS, f"/{name}")
                Answers(here, name, here.nodes.processes[name].pid).warm_up(0)
                active, bare = time.perf_counter(), [sys.executable, "-c", BARE_START]
                subprocess.run(bare, env=here.nodes.environment, check=True)
                times.append((active - begin, time.perf_counter() - active))
        own, least = np.min(times, axis=0)
        what = "start to first command / numpy, pin and rclpy alone, s more"
        yield Row(what, name, own - least, f"{own:.2f} s / {least:.2f} s")


def recorder(quick: bool) -> Iterator[Row]:
    """Yield what the recorder stores of ten topics at 1 kHz, and the processor time it takes."""
    topics, count = [f"t{k}" for k in range(TOPICS)], 1000 if quick else 5000
    with session() as here, echo(here, RAW_ECHO) as raw:
        message = serialize_message(JointState(position=[0.0] * 6, velocity=[0.0] * 6))
        publishers = [here.driver.create_publisher(JointState, topic, 100) for topic in topics]
        bag = here.folder / "bag"
        here.nodes.start("bag_recorder", {"output": str(bag), "topics": topics})
        here.nodes.wait_for_event("bag_recorder", Event.READY, 30.0)
        floor = Answers(here, ECHO, raw).warm_up(100)
        floor.drive(1000)
        pid = here.nodes.processes["bag_recorder"].pid
        begin, cpu = time.perf_counter(), cpu_time(pid)
        for i in range(count):
            here.spin_until(begin + i * PERIOD)
            for publisher in publishers:
                publisher.publish(message)
        time.sleep(1.0)
        own = (cpu_time(pid) - cpu) / (TOPICS * count)
        here.nodes.stop("bag_recorder")
        with open(next(bag.glob("*.mcap")), "rb") as stream:
            stored = make_reader(stream).get_summary().statistics.message_count
    what, sent = f"recorder, {TOPICS} topics of 1 kHz", TOPICS * count
    yield Row(f"{what}: stored / sent", "", stored / sent, f"{stored} of {sent}")
    what += ": processor time of a message / raw echo"
    yield Row.of_times(what, "", own, floor.cpu_each)


if __name__ == "__main__":
    run_echo(sys.argv[1])
