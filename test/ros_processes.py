"""Executables as processes in a ROS domain of their own, and a node of the test beside them.

Nothing here measures time: what is waited for is polled until it is there, and deadlines
only guard against hanging.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import rclpy
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from numpy.typing import NDArray
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from tolerances import HELD, LAW_IN_A_NODE, assert_close
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.command_line import executables
from eulerparams_control.lab.run.domains import Domain
from eulerparams_control.laws.rotations import cross
from eulerparams_control.messages.from_ros import motion_from_ros, ns_from_ros
from eulerparams_control.messages.to_ros import motion_to_ros, stamp_to_ros, wrench_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import DynamicState, Robot, RobotState
from eulerparams_control.ros.qos import QOS_LATCHED

ROOT = Path(__file__).resolve().parents[1]
# A guard against hanging, not a measure: what is waited for takes a second or two.
PATIENCE = float(os.environ.get("PATIENCE", "200"))
# The time [s] that a tick takes, whatever its stamps say.
TICK = 0.001
# An arm whose joints are all slower than this does not move [rad/s]; holding leaves 1e-13.
STANDSTILL = 1e-9
# Linux gives none of the ports of these domains to outgoing connections, and neither the
# experiments nor the other tests use them.
DOMAINS = range(219, 233)

PROGRAMS = {name: f"eulerparams_control.command_line {name}" for name in executables()} | {
    # a controller with a defect in a timer, that shows when it moves
    "clik broken in timer": "broken_node clik",
    "dynamic_control broken in timer": "broken_node dynamic_control",
}
# The arm of the tests.
UR5 = load_robot("ur5")
HOME = np.array(UR5.home)
# Limits of the tip and the joints so wide that references are followed nearly as they are.
UNSHAPED = {
    **{"max_linear_speed": 100.0, "max_linear_acceleration": 1e4, "max_linear_jerk": 1e6},
    **{"max_angular_speed": 100.0, "max_angular_acceleration": 1e4, "max_angular_jerk": 1e6},
    "max_joint_acceleration": [1e6],
}

FRAMES = {"base_frame": UR5.base_frame, "tip_frame": UR5.tip_frame}
# For a controller that is asked for what begins at once, so that the law alone is seen.
AT_ONCE = {**FRAMES, "max_joint_acceleration": [1e4]}
MODEL = Robot(UR5.urdf, UR5.base_frame, UR5.tip_frame)
# Efforts [Nm] that hold a pose: the rounding of its error, 1e-15, times gains and inertia.
HOLDING_EFFORT = 1e-9

Array = NDArray[np.float64]


def pose(q: Any) -> tuple[Array, Array]:
    """Return p (3,) and R (3, 3) of the tip of the arm at q (n,)."""
    state = MODEL.state(np.array(q), np.zeros(len(q)))
    return state.p_e, state.R_e


def reference(*frames: DesiredFrame, times: tuple[float, ...] = (0.0,)) -> Any:
    return motion_to_ros(Trajectory(times, frames), UR5.base_frame, UR5.tip_frame)


def wrench_stamped(*wrench: float, frame: str = UR5.tip_frame, stamp: Any = None) -> Any:
    """Return a message of force and moment [N, Nm], of which what is not given is 0."""
    msg = WrenchStamped()
    msg.header.frame_id = frame
    wrench_to_ros(np.array([*wrench, *[0.0] * (6 - len(wrench))]), stamp or Time(), msg)
    return msg


def assert_holds(command: Any, q: Any, within: float = HELD) -> None:
    """Assert that a command keeps the arm at rest at q (n,), where it is to ``within`` [rad]."""
    if command.effort:
        gravity = MODEL.dynamic_state(np.array(q), np.zeros(len(q))).g
        assert_close(command.effort, gravity, HOLDING_EFFORT)
    else:
        assert_close(command.position, q, within)
        assert_close(command.velocity, 0, LAW_IN_A_NODE)


def assert_may_stay(command: Any, arm: "Arm", within: float = HELD) -> None:
    """Assert that a command keeps an arm at rest where it is to ``within`` [rad]."""
    assert_holds(command, arm.q, within)


def ros_arguments(
    folder: Path, parameters: dict[str, Any] | None, files: Sequence[Path], rules: Sequence[str]
) -> list[str]:
    """Return the arguments of a command line, with a file of the parameters as the last one."""
    if parameters:
        folder.mkdir(parents=True, exist_ok=True)
        own = folder / f"{len(list(folder.iterdir()))}.yaml"
        own.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}))
        files = [*files, own]
    words = [word for file in files for word in ("--params-file", str(file))]
    return ["--ros-args", *words, *(word for rule in rules for word in ("-r", rule))]


def environment(folder: Path, domain: int) -> dict[str, str]:
    return os.environ | {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_PYTHON_CHECK_FIELDS": "1",
        "ROS_LOG_DIR": str(folder / "ros"),
        "RCUTILS_COLORIZED_OUTPUT": "0",
        # one that the caller has set wins over the source tree, so that a changed copy can be tried
        "PYTHONPATH": os.pathsep.join(
            filter(None, (os.environ.get("PYTHONPATH"), str(ROOT), str(ROOT / "test")))
        ),
        "PYTHONSAFEPATH": "1",  # or the folder that pytest is started in would win over both
        "PYTHONUNBUFFERED": "1",
        "COLUMNS": "200",
    }


class Process:
    """A child process whose output goes to files."""

    def __init__(self, command: list[str], folder: Path, name: str, env: dict[str, str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._files = [folder / f"{name}.{stream}" for stream in ("out", "err")]
        with open(self._files[0], "wb") as out, open(self._files[1], "wb") as err:
            self._child = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=out, stderr=err, env=env
            )

    @property
    def stdout(self) -> str:
        return self._files[0].read_text(errors="replace")

    @property
    def stderr(self) -> str:
        return self._files[1].read_text(errors="replace")

    @property
    def log(self) -> str:
        return self.stdout + self.stderr

    @property
    def exit_code(self) -> int | None:
        """The exit code; None while it runs."""
        return self._child.poll()

    def end(self) -> int:
        return self._child.wait(timeout=PATIENCE)

    def signal(self, number: signal.Signals) -> None:
        self._child.send_signal(number)

    def stop(self) -> int:
        """Send SIGINT; return the exit code."""
        self._child.send_signal(signal.SIGINT)
        return self.end()

    def kill(self) -> None:
        if self.exit_code is None:
            self._child.kill()
        self._child.wait()


class Graph:
    """A ROS domain: processes, and ``peer``, the node of the test in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._domain = Domain(DOMAINS)
        self.domain = self._domain.number
        self.processes: list[Process] = []
        self.peer = SpunPeer(self)

    def __enter__(self) -> "Graph":
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes:
            process.kill()
        self.peer.close()
        self._domain.release()

    def start(
        self,
        executable: str,
        parameters: dict[str, Any] | None = None,
        *,
        files: tuple[Path, ...] = (),
        namespace: str = "",
        remap: Sequence[str] = (),
    ) -> Process:
        """Start a node; ``files`` of parameters come before ``parameters``."""
        module, *words = PROGRAMS[executable].split()
        name = f"{executable.replace(' ', '_')}_{len(self.processes)}"
        rules = [f"__ns:={namespace}", *remap] if namespace else remap
        arguments = ros_arguments(self.folder / "parameters", parameters, files, rules)
        command = [sys.executable, "-m", module, *words, *arguments]
        env = environment(self.folder, self.domain)
        self.processes.append(Process(command, self.folder, name, env))
        return self.processes[-1]

    def logs(self) -> str:
        return "\n".join(f"--- exit code {p.exit_code}\n{p.log}" for p in self.processes)

    def until(self, condition: Callable[[], Any], what: str) -> Any:
        """Spin the peer until ``condition()`` is true; return what it returned."""
        deadline = time.monotonic() + PATIENCE
        while not (result := condition()):
            if time.monotonic() > deadline:
                raise AssertionError(f"{what}: has not happened; what was said:\n{self.logs()}")
            self.peer.spin_once()
        return result

    def ask(self, client: Any, request: Any) -> Any:
        """Return the response of a service."""
        self.until(client.service_is_ready, f"the service {client.srv_name}")
        future = client.call_async(request)
        self.until(future.done, f"an answer of {client.srv_name}")
        return future.result()

    def advance(self, seconds: float) -> None:
        """Time goes by itself."""

    def until_said(self, process: Process, words: str) -> None:
        self.until(lambda: words in process.log, f"'{words}' in the log")


class Peer:
    """The node of the test in a domain: what it hears, and what it asks of other nodes."""

    node: Any

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self._clients: dict[str, Any] = {}
        self._diagnostics: list[Any] | None = None
        self.received = 0  # messages, of all lists

    def publisher(self, kind: Any, topic: str, *, latched: bool = False) -> Any:
        return self.node.create_publisher(kind, topic, QOS_LATCHED if latched else 100)

    def sender(self, kind: Any, topic: str) -> Any:
        """Return a publisher that somebody listens to."""
        publisher = self.publisher(kind, topic)
        self.graph.until(publisher.get_subscription_count, f"a subscriber of {topic}")
        return publisher

    def listen(self, kind: Any, topic: str, *, latched: bool = False) -> list[Any]:
        """Return a list to which each message is appended."""
        messages: list[Any] = []

        def keep(msg: Any) -> None:
            self.received += 1
            messages.append(msg)

        self.node.create_subscription(kind, topic, keep, QOS_LATCHED if latched else 5000)
        return messages

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Return the response of a service of a node."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
        return self.graph.ask(self._clients[service], request)

    def set_at_once(self, node: str, **wanted: Any) -> bool:
        """Set parameters of a node, all or none; return whether they were taken."""
        parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in wanted.items()]
        request = SetParametersAtomically.Request(parameters=parameters)
        service = f"{node}/set_parameters_atomically"
        return bool(self.call(SetParametersAtomically, service, request).result.successful)

    def trigger(self, service: str) -> Any:
        """Return the response of a service that is asked for nothing but to act."""
        return self.call(Trigger, service, Trigger.Request())

    def set_parameters(self, node: str, **wanted: Any) -> list[str]:
        """Set parameters of a node, each for itself; return the reasons of refusals."""
        parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in wanted.items()]
        request = SetParameters.Request(parameters=parameters)
        results = self.call(SetParameters, f"{node}/set_parameters", request).results
        return [result.reason for result in results if not result.successful]

    def get_parameters(self, node: str, *names: str) -> list[Any]:
        request = GetParameters.Request(names=list(names))
        found = self.call(GetParameters, f"{node}/get_parameters", request).values
        return [parameter_value_to_python(value) for value in found]

    def change_state(self, node: str, transition: str) -> bool:
        """Ask for a transition of a lifecycle node by its label; return whether it was made."""
        number = getattr(Transition, f"TRANSITION_{transition.upper()}")
        request = ChangeState.Request(transition=Transition(id=number))
        return bool(self.call(ChangeState, f"{node}/change_state", request).success)

    def lifecycle_state(self, node: str) -> str:
        request = GetState.Request()
        return str(self.call(GetState, f"{node}/get_state", request).current_state.label)

    def status(
        self,
        node: str,
        condition: Callable[[Any], Any] = bool,
        meanwhile: Callable[[], Any] = lambda: None,
    ) -> Any:
        """Return the next status of a node on /diagnostics that meets a condition."""
        if self._diagnostics is None:
            self._diagnostics = self.listen(DiagnosticArray, "/diagnostics")
        heard = self._diagnostics
        heard.clear()

        def found() -> Any:
            meanwhile()
            of_node = (s for msg in heard for s in msg.status if s.name == node)
            return next(filter(condition, of_node), None)

        return self.graph.until(found, f"diagnostics of {node}")

    def counter(self, node: str, name: str, at_least: int = 0) -> int:
        """Return a counter on /diagnostics, as soon as it has reached a value."""
        status = self.status(node, lambda status: int(values(status).get(name, 0)) >= at_least)
        return int(values(status).get(name, 0))


class SpunPeer(Peer):
    """A node that talks to processes; spun only while something is waited for."""

    def __init__(self, graph: Graph) -> None:
        super().__init__(graph)
        self._context = Context()
        rclpy.init(context=self._context, domain_id=graph.domain)
        self.node = rclpy.create_node("peer", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def spin_once(self) -> None:
        self._executor.spin_once(timeout_sec=0.02)

    def catch_up(self) -> None:
        """Receive all that waits, so that what comes after it is news."""
        in_vain = 0
        while in_vain < 3:  # a turn may also serve what is no message
            before = self.received
            self._executor.spin_once(timeout_sec=0)
            in_vain = in_vain + 1 if self.received == before else 0


def values(status: Any) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


class WristSensor:
    """The force/torque sensor of an arm: says what the environment exerts on its tool.

    Attributes:
        on: whether it says anything.
        late: whether it says it after the joint_states of the same stamp, not before.
        frame: link in whose axes, and about whose origin, it measures.
        mass, com: [kg], (3,) [m] in the tip frame, of the tool whose weight and inertia it feels.
        gravity: (3,) [m/s^2].
        bias: (6,) [N, Nm] that it adds, in its frame.
        sign: -1 reports what the tool exerts on the environment.
        noise: [Nm] of its last value; without any it repeats itself, as no real one does.
    """

    def __init__(self, graph: Any, robot: Any, namespace: str = "") -> None:
        self._robot = robot
        self.on, self.late, self.noise = True, False, 0.0
        self.frame, self.sign = str(robot.tip_frame), 1.0
        self.mass, self.com, self.bias = 0.0, np.zeros(3), np.zeros(6)
        self.gravity = np.array([0.0, 0.0, -9.81])
        self.wrenches = graph.peer.publisher(WrenchStamped, f"{namespace}/wrench")

    def message(self, arm: "Arm", stamp: Any) -> Any:
        """Return what it says of the contact of an arm, and of the tool."""
        contact = arm.contact()
        tip, sensor = (self._state(link, arm) for link in (self._robot.tip_frame, self.frame))
        r, omega = tip.arm.R_e @ self.com, tip.arm.omega_e
        a = tip.arm.J @ arm.ddq + tip.dJ_dq
        a_com = a[:3] + cross(a[3:], r) + cross(omega, cross(omega, r))
        weight = self.mass * (self.gravity - a_com)
        force = contact[:3] + weight
        moment = contact[3:] + cross(r, weight)
        moment = moment + cross(tip.arm.p_e - sensor.arm.p_e, force)
        R_s = sensor.arm.R_e
        measured = np.concatenate((R_s.T @ force, R_s.T @ moment)) + self.bias
        measured[5] += self.noise * (stamp.nanosec // 1_000_000 % 7)
        return wrench_stamped(*self.sign * measured, frame=self.frame, stamp=stamp)

    def _state(self, link: str, arm: "Arm") -> DynamicState:
        model = _model(self._robot.urdf, self._robot.base_frame, link)
        return model.dynamic_state(arm.q, arm.dq)


@cache
def _model(urdf: str, base_frame: str, link: str) -> Robot:
    return Robot(urdf, base_frame, link)


class Arm:
    """Plays the robot of a controller: publishes joint_states, takes commands.

    It obeys a command at once, unless a test says where the joints are.

    Attributes:
        sensor: its force/torque sensor, whose wrench comes before the joint_states; or None.
        frames: what was received on ``compliant_frame``, if there is a sensor.
        environment: what exerts a wrench (6,) [N, Nm] on the tool, about the tip, base axes.
    """

    topic = "joint_reference"

    def __init__(self, graph: Any, robot: Any, namespace: str = "", command: Any = None) -> None:
        self.graph, self.robot = graph, robot
        self.model = _model(robot.urdf, robot.base_frame, robot.tip_frame)
        self.q = np.array(robot.home)
        self.dq = np.zeros(len(self.q))
        self.ddq = np.zeros(len(self.q))
        self.t = 1_000_000_000
        peer = graph.peer
        self.states = peer.publisher(JointState, f"{namespace}/joint_states")
        self._description = peer.publisher(String, f"{namespace}/robot_description", latched=True)
        self._description.publish(String(data=robot.urdf))
        self.commands = peer.listen(command or JointState, f"{namespace}/{self.topic}")
        self.sensor: WristSensor | None = None
        self.frames: list[Any] = []
        self.environment: Callable[[RobotState], Array] = lambda _state: np.zeros(6)
        self._namespace = namespace

    def wear_sensor(self) -> None:
        """Put on a force/torque sensor, and listen to what becomes of its wrench."""
        self.sensor = WristSensor(self.graph, self.robot, self._namespace)
        topic = f"{self._namespace}/compliant_frame"
        self.frames = self.graph.peer.listen(MultiDOFJointTrajectory, topic)

    def push(self, *wrench: float) -> None:
        """Exert force and moment [N, Nm] on the tool from now on, about the tip, base axes."""
        constant = np.array([*wrench, *[0.0] * (6 - len(wrench))])
        self.environment = lambda _state: constant

    def start_afresh(self, q: Array | None = None) -> Any:
        """Restart where nothing is left of the contact before, which is balanced at first."""
        self.start_anew(q)
        return self.start_anew(q)

    def contact(self) -> Array:
        """Return what is exerted on the tool now (6,), about the tip, base axes."""
        return self.environment(self.model.state(self.q, self.dq))

    def frame(self) -> DesiredFrame:
        """Return the compliant frame that answers the present state."""
        return self.frames_of([self.t])[0]

    def frames_of(self, stamps: Sequence[int]) -> list[DesiredFrame]:
        """Return the compliant frames that answer the states stamped so [ns]."""
        by_stamp = {ns_from_ros(msg.header.stamp): msg for msg in self.frames}
        frames = self.robot.base_frame, self.robot.tip_frame
        motions = (motion_from_ros(by_stamp[stamp], *frames, 0.0)[0] for stamp in stamps)
        return [frame for motion in motions for frame in motion.frames]

    def message(self, q: Array | None = None) -> Any:
        """Return joint_states for q, or for where the joints are, at the present stamp."""
        position = (self.q if q is None else q).tolist()
        names, velocity = list(self.robot.joints), self.dq.tolist()
        msg = JointState(name=names, position=position, velocity=velocity)
        msg.header.stamp = stamp_to_ros(self.t)
        return msg

    def send(self, msg: Any) -> None:
        """Send joint_states, and what the sensor says at the present position."""
        sensor = self.sensor if self.sensor is not None and self.sensor.on else None
        if sensor is None or sensor.late:
            self.states.publish(msg)
        if sensor is not None:
            sensor.wrenches.publish(sensor.message(self, msg.header.stamp))
        if sensor is not None and not sensor.late:
            self.states.publish(msg)

    def send_next(self, count: int = 1) -> None:
        """Send the state under the next stamps, 1 ms apart, and wait for nothing."""
        for _ in range(count):
            self.t += 1_000_000
            self.send(self.message())

    def connect(self) -> None:
        """Send the state, 5 ms apart or as time passes, until a controller answers it."""
        step = round(1e9 * getattr(self.graph, "step", 0.005))

        def answered() -> bool:
            if not self.commands:
                self.t += step
                self.send(self.message())
            return bool(self.commands)

        self.graph.until(answered, "a command for the first joint_states")
        self.start_anew()

    def start_anew(self, q: Array | None = None) -> Any:
        """Jump ahead in time, so that the controller begins to hold q (default: home)."""
        self.q = np.array(self.robot.home) if q is None else q
        self.dq = np.zeros(len(self.q))
        return self.tick(self.q, dt=10.0)

    def tick(self, q: Array | None = None, dt: float = 0.001) -> Any:
        """Advance the stamp, send the state, return its command and obey it."""
        self._pass(dt, q)
        self.t += round(dt * 1e9)
        self.graph.advance(min(max(dt, 0.0), TICK))  # a jump of the stamps is none of the time
        self.send(self.message())
        command = self.answer()
        self._obey(command)
        return command

    def ticks(self, count: int, dt: float = 0.001) -> list[Any]:
        """Tick so many times; return the commands."""
        return [self.tick(dt=dt) for _ in range(count)]

    def ticks_until(self, ended: Callable[[], bool]) -> dict[int, Array]:
        """Tick until something has ended, answered or not; return q (n,) by stamp [ns]."""
        positions: dict[int, Array] = {}

        deadline = time.monotonic() + PATIENCE
        while not ended():
            assert time.monotonic() < deadline, f"it does not end:\n{self.graph.logs()}"
            self._pass(0.001, None)
            self.send_next()
            positions[self.t] = self.q
            self.graph.until(lambda: self._answers() or ended(), "an answer or the end")
            for command in self._answers()[:1]:
                self._obey(command)
                self.commands.clear()
        return positions

    def _pass(self, dt: float, q: Array | None) -> None:
        """Let dt [s] go by, after which the joints are at q, if a test says so."""
        if q is not None:
            self.q = q

    def _obey(self, command: Any) -> None:
        self.q, self.dq = np.array(command.position), np.array(command.velocity)

    def answer(self) -> Any:
        """Return the command for the present stamp, and forget the others."""
        command = self.graph.until(self._answers, f"a command stamped {self.t}")[0]
        self.commands.clear()
        return command

    def _answers(self) -> list[Any]:
        stamp = stamp_to_ros(self.t)
        return [command for command in self.commands if command.header.stamp == stamp]


class TorqueArm(Arm):
    """An arm that takes efforts and moves as its dynamics say, eq. (32), from tick to tick."""

    topic = "joint_effort"
    _effort: Any = 0.0

    def _pass(self, dt: float, q: Array | None) -> None:
        if q is not None:
            self.q, self.ddq = q, 0.0 * q
            return
        state = self.model.dynamic_state(self.q, self.dq)
        tau = self._effort + state.arm.J.T @ self.environment(state.arm)
        self.ddq = np.linalg.solve(state.B, tau - state.C_dq - state.g)
        self.dq = self.dq + dt * self.ddq
        self.q = self.q + dt * self.dq

    def _obey(self, command: Any) -> None:
        self._effort = np.array(command.effort)


class FeelingArm(TorqueArm):
    """A torque-controlled arm with a force/torque sensor."""

    def __init__(self, *args: Any, **given: Any) -> None:
        super().__init__(*args, **given)
        self.wear_sensor()


class Controlled:
    """A controller process with its arm, and a publisher of its reference."""

    ARMS: ClassVar[dict[str, type[Arm]]] = {
        "clik": Arm,
        "dynamic_control": TorqueArm,
        "compliance_control": TorqueArm,
        "impedance_control": FeelingArm,
    }

    def __init__(
        self,
        graph: Any,
        executable: str,
        parameters: dict[str, Any],
        namespace: str = "",
        arm: type[Arm] | None = None,
    ) -> None:
        self.graph, self.peer = graph, graph.peer
        self.name = f"{namespace}/{executable.split()[0]}".lstrip("/")  # as on /diagnostics
        self.arm = (arm or self.ARMS[executable.split()[0]])(graph, UR5, namespace)
        # ages by the stamps, as the arm is played by hand: a busy machine makes no silence
        parameters = {"use_sim_time": True} | parameters
        if self.arm.sensor is not None and not parameters["use_sim_time"]:
            self.arm.sensor.noise = 1e-12
        self.process = graph.start(executable, parameters, namespace=namespace)
        self.arm.connect()
        self.references = self.peer.sender(MultiDOFJointTrajectory, f"{namespace}/reference")
        self._before: dict[str, Any] = {}

    def follow(self, msg: Any) -> None:
        """Send a reference and tick until the arm moves."""
        self.references.publish(msg)
        self.graph.until(self._moves, "a command that moves")

    def _moves(self) -> bool:
        self.arm.tick()
        return bool(np.abs(self.arm.dq).max() > STANDSTILL)

    def status(self, condition: Callable[[Any], Any] = bool) -> Any:
        """Tick until a status on /diagnostics meets a condition; return it."""
        return self.peer.status(self.name, condition, self.arm.tick)

    def change(self, **parameters: Any) -> None:
        """Set parameters, each for itself, until ``restore``."""
        names = [name for name in parameters if name not in self._before]
        found = self.peer.get_parameters(self.name, *names)
        self._before.update(zip(names, found, strict=True))
        assert self.peer.set_parameters(self.name, **parameters) == []

    def restore(self) -> None:
        """Set the parameters back that were changed, the last of them first."""
        before = dict(reversed(self._before.items()))
        assert self.peer.set_parameters(self.name, **before) == []
        self._before.clear()
