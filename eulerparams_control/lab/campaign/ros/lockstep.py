"""A sequence in lock-step: the real control node and a simulated arm, over DDS in one process.

The arm is stepped by hand, and the steady clock of the controller is the time of the sequence,
so that a sequence repeats to the bit and takes no longer than its computations.
"""

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.control.clock import steady
from eulerparams_control.control.senders import UNNUMBERED
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.lab.campaign.plan import SequencePlan, faults_of, shaken
from eulerparams_control.lab.campaign.record import (
    KILLED,
    STARTS,
    STOPS,
    Command,
    Said,
    SequenceEvent,
    SequenceRecord,
    State,
    Truth,
)
from eulerparams_control.lab.campaign.ros.in_process_dds import (
    Counting,
    Crash,
    act,
    call,
    deliver,
    drain,
    subscription_of,
    take,
    until,
)
from eulerparams_control.lab.campaign.user import (
    BEGINNING,
    REFERENCE,
    TARGET_POSE,
    TARGET_TWIST,
    Sent,
    User,
)
from eulerparams_control.lab.faults.base import TO_ROBOT
from eulerparams_control.lab.faults.kinds import Kill, SecondPublisher
from eulerparams_control.lab.faults.stream import FaultStream
from eulerparams_control.messages.from_ros import JointStateReader, ns_from_ros
from eulerparams_control.messages.keys import CAUSE, MODE
from eulerparams_control.messages.to_ros import (
    error_to_ros,
    motion_to_ros,
    pose_to_ros,
    stamp_to_ros,
    wrench_to_ros,
)
from eulerparams_control.parameters.schemes import COMMANDS, schemes
from eulerparams_control.robot.catalogue import RobotDescription
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.control_node import node_class
from eulerparams_control.ros.qos import QOS_LATCHED, QOS_STREAM
from sim_bridge.drive import STOPS as PROTECTIVE_STOPS
from sim_bridge.drive import Drive
from sim_bridge.drive_modes import DriveCause, DriveMode
from sim_bridge.simulator import Simulator

INPUTS = {
    REFERENCE: MultiDOFJointTrajectory,
    TARGET_POSE: PoseStamped,
    TARGET_TWIST: TwistStamped,
}
"""Topics by which an arm is led, and their types."""

# The clock of the robot shows this [ns] when the sequence begins, so that it can be set back.
_BEGINNING = 1_000_000_000_000

# How often [s] the controller looks at the ages of what it heard, and says how it is.
_WATCH, _SAY = 0.02, 1.0


@cache
def _counted(controller: str) -> type[Any]:
    """Return the class of the node of a scheme, counted."""
    node = node_class(schemes()[controller])
    return type(node.__name__, (Counting, node), {})


@contextmanager
def _ros(parameters: dict[str, Any], domain: int) -> Iterator[None]:
    """Initialise ROS in a domain, with the parameters of the controller."""
    words = [word for item in parameters.items() for word in ("-p", f"{item[0]}:={item[1]}")]
    args = ["--ros-args", *words, "--log-level", "fatal"]
    no_signals = SignalHandlerOptions.NO  # they are those of who runs us
    rclpy.init(args=args, domain_id=domain, signal_handler_options=no_signals)
    try:
        yield
    finally:
        rclpy.try_shutdown()
        steady.go_by()


def run_lockstep(plan: SequencePlan, domain: int) -> SequenceRecord:
    """Run a sequence; return its record."""
    robot = plan.robot.description()
    frames = {"base_frame": robot.base_frame, "tip_frame": robot.tip_frame}
    with _ros(frames | plan.parameters(), domain):
        sequence = _Sequence(plan)
        try:
            sequence.run()
        finally:
            sequence.close()
    return sequence.record


class _Sequence:
    """One sequence: the arm, its user and the controller between them."""

    def __init__(self, plan: SequencePlan) -> None:
        self.plan, self.robot, self.rate = plan, plan.robot.description(), plan.robot.rate
        model = Robot(self.robot.urdf, self.robot.base_frame, self.robot.tip_frame)
        faults = faults_of(plan)
        self.t = 0.0
        steady.go_by(lambda: self.t)
        self._simulator = Simulator(self.robot, plan.robot.simulator(plan.control))
        self.arm = Drive(self._simulator, plan.robot.policy())
        self.faults = FaultStream(faults, plan.seed)
        self.user = User(plan, model, faults, self.arm.state.q)
        released = self.user.quiet if plan.push else None
        self.record = SequenceRecord(
            model,
            plan.max_effort_rate,
            plan.state_timeout,
            1 / self.rate,
            asked=plan.asked,
            contact=plan.contact,
            shaken=shaken(faults, BEGINNING, released),
            disturbed=shaken(faults, BEGINNING, released, TO_ROBOT),
        )
        self._reader = JointStateReader(model.joints)
        self._kills = [fault for fault in faults if isinstance(fault, Kill)]
        self._seconds = [fault for fault in faults if isinstance(fault, SecondPublisher)]
        self._life, self._is_unlocked = 0, False
        self.node: Any = None
        self._own: list[Node] = []
        self._second: Node | None = None
        self._last_reference: Any = None
        self._taken: dict[str, int] = {}

    def _note(self, what: str) -> None:
        self.record.events.append(SequenceEvent(self.t, what))

    # --- the nodes ---------------------------------------------------------------------

    def _make_nodes(self) -> None:
        robot, leader = _plain_node("robot"), _plain_node("reference")
        self._own = [robot, leader]
        create, listen = robot.create_publisher, robot.create_subscription
        self._description = create(String, "robot_description", QOS_LATCHED)
        self._description.publish(String(data=self.robot.urdf))
        self._topic = command = COMMANDS[self.plan.control]
        self._commands = listen(JointState, command, _never, 100)
        self._diagnostics = listen(DiagnosticArray, "/diagnostics", _never, 100)
        self._publishers = {
            "joint_states": create(JointState, "joint_states", QOS_STREAM),
            "wrench": create(WrenchStamped, "wrench", QOS_STREAM),
        } | {
            topic: leader.create_publisher(kind, topic, QOS_STREAM)
            for topic, kind in INPUTS.items()
        }
        self._start()

    def _start(self) -> None:
        """Start the controller."""
        self._life += 1
        self._note(STARTS)
        self.node = _counted(self.plan.controller)()
        for subscription in (self._commands, self._diagnostics):
            drain(subscription)
        self._taken = dict(self.node.sent)
        until(lambda: self._diagnostics.get_publisher_count() == 1, "the controller's diagnostics")
        description = subscription_of(self.node, "/robot_description")
        assert description is not None
        act(description, *take(description))
        until(lambda: self._commands.get_publisher_count() == 1, "the controller's commands")
        self._see_publishers()

    def _kill(self) -> None:
        """Kill the controller without warning."""
        self._note(KILLED)
        self.node.destroy_node()
        self.node = None
        for subscription in (self._commands, self._diagnostics):
            until(lambda s=subscription: s.get_publisher_count() == 0, "the end of the controller")
            drain(subscription)

    def _see_publishers(self) -> None:
        """Wait until the controller sees as many publishers of a reference as there are."""
        node, there = self.node, 1 + (self._second is not None)
        if node is not None:
            until(lambda: node.count_publishers("/reference") == there, "the publishers there are")

    def _come_and_go(self, wanted: bool) -> None:
        """Create or destroy the second publisher of references."""
        if self._second is None and wanted:
            self._second = _plain_node("intruder")
            self._intruder = self._second.create_publisher(INPUTS[REFERENCE], REFERENCE, QOS_STREAM)
            self._see_publishers()
            self._note("a second publisher of references comes")
        elif self._second is not None and not wanted:
            self._second.destroy_node()
            self._second = None
            self._see_publishers()
            self._note("the second publisher goes")

    # --- time --------------------------------------------------------------------------

    def run(self) -> None:
        """Run the sequence."""
        self._make_nodes()
        for step in itertools.count():
            self.t = step / self.rate
            if self.user.is_done(self.t, self.arm.state.q):
                break
            try:
                self._do_to_nodes()
                self._tick(step)
            except Crash as crash:
                self.record.crash, self.record.end = str(crash), self.t
                return
            stops = self.arm.values[PROTECTIVE_STOPS]
            for _ in range(self.plan.robot.steps):
                self.arm.step(self.t)
            if self.arm.values[PROTECTIVE_STOPS] != stops:
                self._note(STOPS)
            self._unlock()
        self.record.end = self.t
        self.record.tip_error = self.user.tip_error(self.arm.state.q)

    def _unlock(self) -> None:
        """Unlock a stopped robot once no fault acts any more, and restart the controller."""
        status = self.arm.status
        is_locked = status.mode is DriveMode.STOPPING and status.cause is DriveCause.ACCELERATION
        if not self._is_unlocked and is_locked and self.t >= self.user.quiet:
            self._is_unlocked = True
            self._note("the robot is unlocked")
            self._kill()
            self.arm.unlock(self.t)
            self._start()

    def _do_to_nodes(self) -> None:
        t = self.t - BEGINNING
        is_dead = any(kill.at <= t < kill.end for kill in self._kills)
        if self.node is not None and is_dead:
            self._kill()
        if self.node is None and not is_dead:
            self._start()
        self._come_and_go(any(second.is_active(t) for second in self._seconds))

    def _tick(self, step: int) -> None:
        state, stamp = self.arm.state, stamp_to_ros(_BEGINNING + round(step * 1e9 / self.rate))
        q, dq = self._simulator.motion
        self.record.truth.append(Truth(self.t, tuple(q.tolist()), tuple(dq.tolist())))
        self.arm.push(self.user.push(self.t))
        for topic, msg in self.faults.due(self._fault_time):
            self._pass(topic, msg)
        self._lead()
        wrench = WrenchStamped()
        wrench.header.frame_id = self.robot.sensor_frame
        wrench_to_ros(state.wrench, stamp, wrench)
        self._send("wrench", wrench)
        msg = JointState(name=list(self.robot.joints))
        msg.header.stamp = stamp
        msg.position, msg.velocity = state.q.tolist(), state.dq.tolist()
        msg.effort = state.tau.tolist()
        self._send("joint_states", msg)
        self._call_timers(step)

    @property
    def _fault_time(self) -> float:
        return max(0.0, self.t - BEGINNING)

    def _call_timers(self, step: int) -> None:
        """Call the timers of the controller."""
        if self.node is None:
            return
        if step % max(1, round(_WATCH * self.rate)) == 0:
            call(self.node.watch)
        if step % round(_SAY * self.rate) == 0:
            call(self.node._health._on_timer)
        self._hear()

    # --- messages ----------------------------------------------------------------------

    def _lead(self) -> None:
        """Send what the user sends now, and the second publisher."""
        for sent in self.user.motions(self.t, self.arm.state.q):
            msg = message_of(sent, self.robot)
            if sent.note:
                self._note(sent.note)
            if sent.topic == REFERENCE:
                self._last_reference = msg
            self._send(sent.topic, msg)
        if self._second is None or self._last_reference is None:
            return
        t = self.t - BEGINNING
        for second in self._seconds:
            period = max(1, round(self.rate / second.rate))
            if second.is_active(t) and round((t - second.at) * self.rate) % period == 0:
                deliver(self._intruder, second.message(self._last_reference), self.node)
                self._hear()

    def _send(self, topic: str, msg: Any) -> None:
        """Send a message to the controller, through its faults."""
        for found in self.faults.on_message(self._fault_time, topic, msg):
            self._pass(topic, found)

    def _pass(self, topic: str, msg: Any) -> None:
        """Deliver a message to the controller or to the arm."""
        if topic not in self._publishers:
            self.arm.command(msg, UNNUMBERED, self.t)
            return
        if deliver(self._publishers[topic], msg, self.node) and topic == "joint_states":
            self.record.states.append(state_of(self.t, msg, self._reader))
        self._hear()

    def _hear(self) -> None:
        """Take what the controller has published since the last call."""
        for msg in self._new(self._diagnostics):
            self.record.said.append(said_of(self.t, msg.status[0]))
        for msg in self._new(self._commands):
            self.record.commands.append(command_of(self.t, self._life, msg))
            for found in self.faults.on_message(self._fault_time, self._topic, msg):
                self.arm.command(found, UNNUMBERED, self.t)

    def _new(self, subscription: Subscription) -> list[Any]:
        """Return the messages of the controller that are new."""
        if self.node is None:
            return []
        topic = subscription.topic_name
        before, self._taken[topic] = self._taken.get(topic, 0), self.node.sent[topic]
        return [take(subscription)[0] for _ in range(self._taken[topic] - before)]

    def close(self) -> None:
        """End all nodes and the arm."""
        self.arm.close()
        for node in (self.node, self._second, *self._own):
            if node is not None:
                node.destroy_node()


def _plain_node(name: str) -> Node:
    return rclpy.create_node(
        name,
        use_global_arguments=False,
        start_parameter_services=False,
        enable_rosout=False,
    )


def _never(_msg: Any) -> None:
    """Messages are taken by hand."""


def message_of(sent: Sent, robot: RobotDescription) -> Any:
    """Return what a user sends as a message."""
    ns = 0 if sent.stamp is None else _BEGINNING + round(sent.stamp * 1e9)
    stamp, base = stamp_to_ros(max(0, ns)), robot.base_frame
    frame = sent.motion.frames[0]
    if sent.topic == TARGET_POSE:
        return pose_to_ros(frame.p_d, frame.R_d, stamp, base)
    if sent.topic == TARGET_TWIST:
        return error_to_ros(frame.dp_d, frame.omega_d, stamp, base)
    msg = motion_to_ros(sent.motion, base, robot.tip_frame)
    msg.header.stamp = stamp
    return msg


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
