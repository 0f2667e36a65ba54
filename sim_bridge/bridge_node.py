"""The node ``pybullet_bridge``: stands in for the robot and its force/torque sensor.

In ``realtime`` the wall clock drives; in ``lockstep`` the step to t_k+1 is made when the
command stamped t_k arrives, so that runs repeat to the bit.
"""

import math
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from eulerparams_control.catalogue import load_robot
from eulerparams_control.errors import ConfigurationError, InvalidMessageError, SimulationError
from eulerparams_control.messages import CommandReader, ns_from_ros, wrench_from_ros
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.conversions import stamp_to_ros, wrench_to_ros
from eulerparams_control.ros.parameters import declare, parameter
from eulerparams_control.ros.qos import QOS, QOS_LATCHED, QOS_OVERRIDES, QOS_STREAM
from eulerparams_control.ros.runtime import run
from sim_bridge.environment import Environment, nest, read_environment
from sim_bridge.environment.keys import NO_TURN
from sim_bridge.parameters import CONTROLS, NO_SHAPE, TOOL_SHAPES, SimulatorParameters
from sim_bridge.simulator import Simulator, SimulatorState

MODES = ("realtime", "lockstep")

# Of the parameters environment.NAME.KEY, any number of them.
_ENVIRONMENT = "environment."

# Until the first command arrives in lock-step, the first state is repeated at this period [s].
_REPEAT_PERIOD = 0.05

# In real time, more steps than this behind the wall clock are given up, not caught up.
_MAX_CATCH_UP = 50

# The last messages are given this long to reach their readers at the end.
_LINGER = Duration(seconds=1.0)


@dataclass(frozen=True)
class BridgeParameters:
    """Parameters of the node ``pybullet_bridge``."""

    robot: str = parameter("ur5", "name of a robot of config/robots")
    urdf: str = parameter("", "path of a URDF to take instead of a robot of the catalogue")
    mode: str = parameter("realtime", "what drives the time", choices=MODES)
    control: str = parameter("position", "what a command is", choices=CONTROLS)
    rate: float = parameter(1000.0, "steps per second", unit="Hz", bounds=(10.0, 10000.0))
    clock_rate: float = parameter(100.0, "messages of /clock", unit="Hz", bounds=(1.0, 10000.0))
    duration: float = parameter(0.0, "ends after; 0 runs on", unit="s", bounds=(0.0, 1e6))
    gui: bool = parameter(False, "open PyBullet's window")
    initial_positions: tuple[float, ...] = parameter((), "of the joints; empty: home", unit="rad")
    servo_bandwidth: float = parameter(
        100.0, "of the joint servo in position control", unit="rad/s", bounds=(0.1, 10000.0)
    )
    enforce_limits: bool = parameter(True, "clip commands to the limits of the URDF")
    gravity: tuple[float, ...] = parameter((0.0, 0.0, -9.81), "in the base frame", unit="m/s^2")
    tool_mass: float = parameter(0.0, "beyond the sensor", unit="kg", bounds=(0.0, 1000.0))
    tool_com: tuple[float, ...] = parameter((0.0, 0.0, 0.0), "in the sensor frame", unit="m")
    tool_inertia: tuple[float, ...] = parameter(
        (0.0,) * 6, "xx, xy, xz, yy, yz, zz about the centre of mass", unit="kg m^2"
    )
    tool_shape: str = parameter(
        NO_SHAPE, "of the tool, which touches what is around it", choices=TOOL_SHAPES
    )
    tool_size: tuple[float, ...] = parameter(
        (), "radius of a sphere; x, y, z; radius, length of a cylinder or a capsule", unit="m"
    )
    tool_position: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "of the shape in the sensor frame", unit="m"
    )
    tool_orientation: tuple[float, ...] = parameter(
        NO_TURN, "of the shape in the sensor frame, x, y, z, w"
    )
    collide_links: bool = parameter(False, "let the links touch what is around them too")
    friction_viscous: tuple[float, ...] = parameter(
        (), "one, or one a joint; empty: damping of the URDF", unit="Nm s/rad"
    )
    friction_coulomb: tuple[float, ...] = parameter(
        (), "one, or one a joint; empty: friction of the URDF", unit="Nm"
    )
    noise_position: float = parameter(0.0, "standard deviation", unit="rad", bounds=(0.0, 1.0))
    noise_velocity: float = parameter(0.0, "standard deviation", unit="rad/s", bounds=(0.0, 10.0))
    encoder_resolution: int = parameter(
        0, "counts per turn of the encoders; 0: exact", bounds=(0, 2**31 - 1)
    )
    velocity_cutoff: float = parameter(
        0.0,
        "of the filter that derives velocities from positions; 0: as simulated",
        unit="Hz",
        bounds=(0.0, 5000.0),
    )
    noise_force: float = parameter(0.0, "standard deviation", unit="N", bounds=(0.0, 1000.0))
    noise_torque: float = parameter(0.0, "standard deviation", unit="Nm", bounds=(0.0, 1000.0))
    wrench_bias: tuple[float, ...] = parameter((0.0,) * 6, "of the sensor", unit="N, Nm")
    seed: int = parameter(0, "of the noise", bounds=(0, 2**31 - 1))
    disturbance_effort: tuple[float, ...] = parameter(
        (), "on the joints, which do not report it; one, or one a joint; empty: none", unit="Nm"
    )
    command_delay: int = parameter(0, "steps until a command acts", bounds=(0, 1000))
    command_timeout: float = parameter(
        0.1, "without commands the robot brakes after", unit="s", bounds=(0.001, 60.0)
    )
    lockstep_timeout: float = parameter(
        10.0, "without a command the run ends after", unit="s", bounds=(0.1, 3600.0)
    )
    wait_for_subscribers: int = parameter(
        0, "of joint_states, before the first step in lock-step", bounds=(0, 100)
    )

    def simulator(self, environment: Environment | None = None) -> SimulatorParameters:
        """Return what concerns the simulator, with what is around the robot."""
        names = SimulatorParameters.__dataclass_fields__.keys() & self.__dataclass_fields__.keys()
        values = {name: getattr(self, name) for name in names}
        return SimulatorParameters(**values, environment=environment or {})


def declare_environment(node: Node) -> Environment:
    """Return what the parameters ``environment.NAME.KEY`` of a node describe, and declare them.

    Raises:
        ConfigurationError: if one is impossible or missing; names it.
    """
    given = {
        name.removeprefix(_ENVIRONMENT): override.value
        for name, override in node._parameter_overrides.items()
        if name.startswith(_ENVIRONMENT)
    }
    environment = read_environment(nest(given))
    fixed = ParameterDescriptor(read_only=True, dynamic_typing=True)
    for name, thing in environment.items():
        for key, value in thing.keys.items():
            default = list(value) if isinstance(value, tuple) else value
            node.declare_parameter(f"{_ENVIRONMENT}{name}.{key}", default, fixed)
    return environment


class BridgeNode(Node):
    """The simulated robot on its topics."""

    def __init__(self) -> None:
        super().__init__("pybullet_bridge")
        self.done = False
        self._health = diagnostics.Health(self)
        p = self._params = declare(self, BridgeParameters, prefixes=(_ENVIRONMENT,))
        environment = declare_environment(self)
        self._robot = load_robot(p.urdf or p.robot)
        self._simulator = Simulator(self._robot, p.simulator(environment))
        self._reset()
        self._reader = CommandReader(self._robot.joints, p.control)
        self._delayed: deque[Callable[[], None]] = deque()
        self._heard = self._answered = False
        self._last_command = time.monotonic()
        self._braked = True
        self._state: SimulatorState = self._simulator.read()
        self._make_messages()
        self._connect()
        self._start()

    def _reset(self) -> None:
        q = self._params.initial_positions
        if q and len(q) != len(self._robot.joints):
            raise ConfigurationError(
                f"initial_positions has {len(q)} values; expected {len(self._robot.joints)} for "
                f"{', '.join(self._robot.joints)}"
            )
        self._simulator.reset(np.array(q) if q else None)

    def _make_messages(self) -> None:
        names = self._simulator.joint_names
        self._still = [0.0] * (len(names) - len(self._robot.joints))  # grippers are locked at 0
        self._joint_states = JointState(name=list(names))
        self._wrench = WrenchStamped()
        self._wrench.header.frame_id = self._robot.sensor_frame
        self._clock_message = ClockMessage()
        self._clock_every = max(1, round(self._params.rate / self._params.clock_rate))

    def _connect(self) -> None:
        self._description_publisher = self.create_publisher(
            String, "robot_description", QOS_LATCHED
        )
        self._clock_publisher = self.create_publisher(ClockMessage, "/clock", 10)
        self._wrench_publisher = self.create_publisher(WrenchStamped, "wrench", QOS_STREAM)
        self._state_publisher = self.create_publisher(JointState, "joint_states", QOS_STREAM)
        topic = "joint_reference" if self._params.control == "position" else "joint_effort"
        self.create_subscription(
            JointState, topic, self._on_command, QOS, qos_overriding_options=QOS_OVERRIDES
        )
        self.create_subscription(WrenchStamped, "external_wrench", self._on_external_wrench, QOS)

    def _start(self) -> None:
        self._description_publisher.publish(String(data=self._robot.urdf))
        self._health.set(
            diagnostics.OK,
            f"{self._robot.name} in {self._params.mode}, {self._params.control} control, "
            f"{self._params.rate:g} Hz",
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        if self._params.mode == "lockstep":
            self.create_timer(_REPEAT_PERIOD, self._watch_lockstep, clock=steady)
        else:
            self._started = time.monotonic()
            self.create_timer(1.0 / self._params.rate, self._keep_up, clock=steady)

    # --- time --------------------------------------------------------------------------

    def _watch_lockstep(self) -> None:
        """Repeat the first state until it is answered; give up on a silent controller."""
        if not self._answered:
            there = self._state_publisher.get_subscription_count()
            self._heard = there >= self._params.wait_for_subscribers
            self._publish_state()
            return
        silence = time.monotonic() - self._last_command
        if silence > self._params.lockstep_timeout:
            raise SimulationError(
                f"no command for the state stamped {self._state.t:.3f} s within "
                f"{self._params.lockstep_timeout:g} s; is the controller alive and active?"
            )

    def _keep_up(self) -> None:
        """Make the steps that are due by the wall clock."""
        due = int((time.monotonic() - self._started) * self._params.rate) - self._state.step
        if due > _MAX_CATCH_UP:
            self._health.count("steps given up")
            self._health.complain(f"{due} steps behind the wall clock: slower than real time")
            self._started += (due - 1) / self._params.rate
            due = 1
        for _ in range(due):
            self._brake_on_silence()
            self._step()

    def _brake_on_silence(self) -> None:
        silence = time.monotonic() - self._last_command
        if not self._braked and silence > self._params.command_timeout:
            self._brake(f"no command for {self._params.command_timeout:g} s: braked")

    def _brake(self, reason: str) -> None:
        self._simulator.brake()
        self._delayed.clear()
        self._braked = True
        self._health.set(diagnostics.ERROR, reason)

    def _step(self) -> None:
        try:
            self._simulator.step()
        except SimulationError as error:
            self._health.set(diagnostics.ERROR, str(error))
            raise
        self._state = self._simulator.read()
        self._publish_state()
        self._report_progress()
        duration = self._params.duration
        if duration > 0 and self._params.mode == "realtime" and self._state.t >= duration:
            self.done = True

    # --- messages ----------------------------------------------------------------------

    def _publish_state(self) -> None:
        state = self._state
        stamp = stamp_to_ros(round(state.step * 1e9 / self._params.rate))
        if state.step % self._clock_every == 0:
            self._clock_message.clock = stamp
            self._clock_publisher.publish(self._clock_message)
        wrench_to_ros(state.wrench, stamp, self._wrench)
        self._wrench_publisher.publish(self._wrench)
        msg = self._joint_states
        msg.header.stamp = stamp
        msg.position = state.q.tolist() + self._still
        msg.velocity = state.dq.tolist() + self._still
        msg.effort = state.tau.tolist() + self._still
        self._state_publisher.publish(msg)

    def _on_command(self, msg: JointState) -> None:
        lockstep = self._params.mode == "lockstep"
        if lockstep and not self._is_answer(msg):
            return
        try:
            command = self._command(msg)
        except InvalidMessageError as error:
            self._health.count("commands rejected")
            self._health.complain(f"command rejected: {error}", error=True)
            return
        self._take(command)
        if lockstep:
            self._answered = True
            self._advance()

    def _is_answer(self, msg: JointState) -> bool:
        """Whether a command answers the present state, which all subscribers have got."""
        stamp = self._joint_states.header.stamp
        return self._heard and ns_from_ros(msg.header.stamp) == ns_from_ros(stamp)

    def _command(self, msg: JointState) -> Callable[[], None]:
        """Return what the command does to the simulator."""
        if self._params.control == "position":
            q, dq = self._reader.position_from_ros(msg)
            return lambda: self._simulator.command_position(q, dq)
        tau = self._reader.effort_from_ros(msg)
        return lambda: self._simulator.command_effort(tau)

    def _take(self, command: Callable[[], None]) -> None:
        self._last_command = time.monotonic()
        if self._braked:
            self._braked = False
            self._health.set(diagnostics.OK, "commanded")
        self._delayed.append(command)
        if len(self._delayed) > self._params.command_delay:
            self._delayed.popleft()()

    def _advance(self) -> None:
        """Step to the next stamp, or end when the duration is over."""
        duration = self._params.duration
        if duration > 0 and self._state.step >= math.floor(duration * self._params.rate + 0.5):
            self.done = True
        else:
            self._step()

    def _report_progress(self) -> None:
        """Log how far a run of limited duration is, ten times."""
        steps = round(self._params.duration * self._params.rate)
        if steps and self._state.step % max(1, steps // 10) == 0:
            self.get_logger().info(f"simulated {self._state.t:g} s of {self._params.duration:g} s")

    def _on_external_wrench(self, msg: WrenchStamped) -> None:
        try:
            self._simulator.set_external_wrench(wrench_from_ros(msg, self._robot.sensor_frame))
        except InvalidMessageError as error:
            self._health.count("external_wrench rejected")
            self._health.complain(f"external_wrench rejected: {error}", error=True)

    def close(self) -> None:
        """Let the last messages reach their readers, then end the simulator."""
        for publisher in self.publishers:
            publisher.wait_for_all_acked(_LINGER)
        self._simulator.close()


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(BridgeNode, args)


if __name__ == "__main__":
    sys.exit(main())
