"""A sequence in real time: the bridge, the controller and the fault injector as processes.

A node here leads the arm and listens to all that is said.  The times of messages are those at
which they were published, so that a busy listener changes nothing.  A node is killed with SIGKILL.
"""

import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from eulerparams_control.errors import InvalidMessageError, SimulationError
from eulerparams_control.lab.campaign.draws import NOTHING
from eulerparams_control.lab.campaign.operator import BEGINNING, User
from eulerparams_control.lab.campaign.plan import SequencePlan, faults_of, shaken
from eulerparams_control.lab.campaign.record import (
    KILLED,
    STARTS,
    SequenceEvent,
    SequenceRecord,
    Truth,
)
from eulerparams_control.lab.campaign.ros.from_ros import command_of, said_of, state_of
from eulerparams_control.lab.campaign.ros.to_ros import INPUTS, message_of
from eulerparams_control.lab.campaign.streams import REFERENCE, Sent
from eulerparams_control.lab.experiments.processes import Nodes
from eulerparams_control.lab.faults import TO_ROBOT, Kill
from eulerparams_control.messages.from_ros import JointStateReader, ns_from_ros
from eulerparams_control.messages.to_ros import stamp_to_ros, wrench_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.parameters.schemes import COMMANDS
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.qos import QOS_STREAM

# A message may be this late on a busy machine [s]: the oracles allow for it.
_JITTER = 0.1
_PATIENCE = 60.0  # [s] to start: a guard against hanging
_LOOK = 0.001  # [s] between two looks at what has come


def run_realtime(plan: SequencePlan, stop: threading.Event | None = None) -> SequenceRecord:
    """Run a sequence; return what was seen.

    Args:
        plan: the sequence.
        stop: set when it is to end early.

    Raises:
        SimulationError: if a node other than the controller dies, or nothing begins.
        RunStopped: if it was told to end.
    """
    with tempfile.TemporaryDirectory(prefix="faults_") as folder:
        with Nodes(Path(folder), stop) as nodes:
            sequence = _Sequence(plan, nodes)
            try:
                sequence.run()
            finally:
                sequence.close()
            nodes.stop(plan.controller)
            sequence.look_at_end()
        return sequence.record


class _Sequence:
    """One sequence: the processes, and the node that leads and listens."""

    def __init__(self, plan: SequencePlan, nodes: Nodes) -> None:
        self.plan, self.nodes, self.robot = plan, nodes, plan.robot.description()
        model = Robot(self.robot.urdf, self.robot.base_frame, self.robot.tip_frame)
        faults = faults_of(plan)
        self.user = User(plan, model, faults, np.array(self.robot.home))
        self.record = SequenceRecord(
            model,
            plan.max_effort_rate,
            plan.state_timeout,
            1 / plan.robot.rate,
            jitter=_JITTER,
            asked=plan.asked,
        )
        self.record.contact = plan.contact
        self._reader = JointStateReader(model.joints)
        self._kills = [fault for fault in faults if isinstance(fault, Kill)]
        self._dead: Kill | None = None
        self._life, self._origin = 1, 0.0
        self._looked = 0.0  # when the last look was
        self._stamp_ahead = 0.0  # of the clock of the robot [s] before that of the sequence
        self._answered = False  # the present life has commanded
        self._topic = COMMANDS[plan.control]
        self._connect()

    # --- the nodes ---------------------------------------------------------------------

    def _connect(self) -> None:
        self._context = Context()
        domain = int(self.nodes.environment["ROS_DOMAIN_ID"])
        no_signals = SignalHandlerOptions.NO  # they are those of who runs us
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=no_signals)
        self._node = rclpy.create_node(
            "reference",
            context=self._context,
            start_parameter_services=False,
            use_global_arguments=False,
        )
        create = self._node.create_publisher
        self._inputs = {topic: create(kind, topic, QOS_STREAM) for topic, kind in INPUTS.items()}
        self._reference = self._inputs[REFERENCE]
        self._push = create(WrenchStamped, "external_wrench", QOS_STREAM)
        self._pushed: tuple[float, ...] | None = None
        self._listening = [
            self._listen(JointState, "joint_states", self._on_truth),
            self._listen(JointState, "faulty/joint_states", self._on_state),
            self._listen(JointState, self._topic, self._on_command),
            self._listen(DiagnosticArray, "/diagnostics", self._on_diagnostics),
        ]

    def _listen(self, kind: Any, topic: str, callback: Any) -> tuple[Subscription, Any]:
        return self._node.create_subscription(kind, topic, lambda _msg: None, QOS_STREAM), callback

    def _start(self) -> None:
        frames = {"base_frame": self.robot.base_frame, "tip_frame": self.robot.tip_frame}
        faults = [str(f) for f in self.user.faults if not isinstance(f, Kill)]
        inputs = ["joint_states", "wrench", "reference"]
        self.nodes.start(
            "fault_injector",
            {
                "topics": [*inputs, self._topic],
                "faults": faults,
                "seed": self.plan.seed,
                "start_on": "reference",
            },
        )
        self.nodes.start(
            "pybullet_bridge",
            {"mode": "realtime", **self.plan.robot.bridge(self.plan.control)},
            remaps={self._topic: f"faulty/{self._topic}"},
        )
        self._wait(lambda: self.record.truth and self.record.states, "joint_states")
        self._note(STARTS)
        self.nodes.start(
            self.plan.controller,
            frames | self.plan.parameters(),
            remaps={topic: f"faulty/{topic}" for topic in inputs},
        )

    def _note(self, what: str) -> None:
        self.record.events.append(SequenceEvent(time.time(), what))

    # --- time --------------------------------------------------------------------------

    def run(self) -> None:
        """Go through the sequence."""
        self._start()
        self._wait(self._is_led, "commands, and a listener to the reference")
        self._origin = time.time()
        while not (self._is_done() or self.record.crash):
            self._do_to_nodes()
            self._lead()
            self._take_all()
            self._check()
        self.record.quiet, self.record.end = self.user.quiet, self._now
        released = self.user.quiet if self.plan.push else None
        self.record.shaken = shaken(self.user.faults, BEGINNING, released)
        self.record.disturbed = shaken(self.user.faults, BEGINNING, released, TO_ROBOT)
        self.record.tip_error = self.user.tip_error(np.array(self.record.truth[-1].q))
        self.record.shift(self._origin)
        gaps = np.diff([truth.t for truth in self.record.truth if truth.t >= 0])
        self.record.starved = max(self.record.starved, float(gaps.max()))

    def _is_done(self) -> bool:
        return self.user.is_done(self._now, np.array(self.record.truth[-1].q))

    @property
    def _now(self) -> float:
        return time.time() - self._origin

    def _is_led(self) -> bool:
        return self._answered and self._reference.get_subscription_count() > 0

    def _wait(self, condition: Any, what: str) -> None:
        deadline = time.monotonic() + _PATIENCE
        while not condition():
            self._take_all()
            self._check()
            if self.record.crash or time.monotonic() > deadline:
                raise SimulationError(
                    f"no {what} within {_PATIENCE:g} s{self.nodes.complaints(but='')}"
                )

    def _check(self) -> None:
        """Look whether all processes are there; a controller that has died is no error of ours."""
        process = self.nodes.processes.get(self.plan.controller)
        if process is not None and process.poll() is not None:
            words = self.nodes.last_words(self.plan.controller, 1)
            self.record.crash = f"it ended with {process.returncode}: {words}"
            del self.nodes.processes[self.plan.controller]
        self.nodes.check()

    def _do_to_nodes(self) -> None:
        """Kill the controller, and start it again; nothing goes on until it commands again."""
        t = self._now - BEGINNING
        if self._dead is None and self._kills and t >= self._kills[0].at:
            self._dead = self._kills.pop(0)
            self.nodes.kill(self.plan.controller)
            self._note(KILLED)
        if self._dead is not None and t >= self._dead.end:
            self.nodes.start_again(self.plan.controller)
            self._life, self._answered, self._dead = self._life + 1, False, None
            self._note(STARTS)
        if self._dead is not None or not self._answered:
            self.user.quiet = max(self.user.quiet, self._now)

    # --- messages ----------------------------------------------------------------------

    def _lead(self) -> None:
        q = np.array(self.record.truth[-1].q)
        sent = list(self.user.motions(self._now, q))
        if self.plan.motion == NOTHING and not self.user.has_begun and self._now >= BEGINNING:
            self.user.has_begun = True  # where the arm is: it begins the time of the injector
            sent = [Sent(REFERENCE, Trajectory([0.0], [DesiredFrame(*self.user.pose(q))]))]
        for each in sent:
            stamp = round(1e9 * self._stamp_ahead)
            self._inputs[each.topic].publish(message_of(each, self.robot, stamp))
            if each.note:
                self._note(each.note)
        push = self.user.push(self._now)
        if push != self._pushed:
            self._pushed = push
            msg = WrenchStamped()
            msg.header.frame_id = self.robot.sensor_frame
            wrench_to_ros(np.array(push or [0.0] * 6), stamp_to_ros(0), msg)
            self._push.publish(msg)

    def _take_all(self) -> None:
        """Take what has come; wait a little if nothing has."""
        found, now = False, time.time()
        if self._origin:
            self.record.starved = max(self.record.starved, now - self._looked)
        self._looked = now
        for subscription, callback in self._listening:
            with subscription.handle:
                while taken := subscription.handle.take_message(subscription.msg_type, False):
                    found = True
                    msg, info = taken
                    callback(info["source_timestamp"] / 1e9, msg)
        if not found:
            time.sleep(_LOOK)

    def _on_truth(self, t: float, msg: Any) -> None:
        self._stamp_ahead = ns_from_ros(msg.header.stamp) / 1e9 - (t - self._origin)
        try:
            _, q, dq = self._reader.from_ros(msg)
        except InvalidMessageError as error:
            raise SimulationError(f"the robot itself is wrong: {error}") from error
        self.record.truth.append(Truth(t, tuple(q.tolist()), tuple(dq.tolist())))

    def _on_state(self, t: float, msg: Any) -> None:
        self.record.states.append(state_of(t, msg, self._reader))

    def _on_command(self, t: float, msg: Any) -> None:
        self._answered = True
        self.record.commands.append(command_of(t, self._life, msg))

    def _on_diagnostics(self, t: float, msg: Any) -> None:
        for status in msg.status:
            if status.name == self.plan.controller:
                self.record.said.append(said_of(t, status))

    def look_at_end(self) -> None:
        """See how the controller ended when it was told to."""
        if self.record.crash:
            return
        code = self.nodes.processes[self.plan.controller].returncode
        if code != 0:
            words = self.nodes.last_words(self.plan.controller, 1)
            self.record.crash = f"told to end, it ended with {code}: {words}"

    def close(self) -> None:
        """End the node that leads and listens."""
        self._node.destroy_node()
        self._context.try_shutdown()
