"""The node ``pybullet_bridge``: stands in for the robot and its force/torque sensor.

In ``realtime`` the wall clock drives; in ``lockstep`` the step to t_k+1 is made when the
command stamped t_k arrives, so that runs repeat to the bit.
"""

import math
import sys
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import ConfigurationError, InvalidMessageError, SimulationError
from eulerparams_control.events import Event, ExitCode, tell
from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.messages.to_ros import stamp_to_ros, wrench_to_ros
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.publishers import names_of_publishers
from eulerparams_control.ros.qos import QOS, QOS_LATCHED, QOS_OVERRIDES, QOS_STREAM
from eulerparams_control.ros.runtime import run
from sim_bridge.command_source import Senders
from sim_bridge.command_statistics import Tally
from sim_bridge.commands import Command, CommandInput
from sim_bridge.conduct import Conduct
from sim_bridge.environment import Environment, nest, read_environment
from sim_bridge.environment.keys import NO_TURN
from sim_bridge.message_info import NUMBER, with_info
from sim_bridge.parameters import CONTROLS, NO_SHAPE, TOOL_SHAPES, SimulatorParameters
from sim_bridge.protection import SPEED_FACTOR
from sim_bridge.pushes import PushInput
from sim_bridge.simulator import Simulator, SimulatorState
from sim_bridge.stamp_filter import StampOrder

MODES = ("realtime", "lockstep")

# Of the parameters environment.NAME.KEY, any number of them.
_ENVIRONMENT = "environment."

# Until the first command arrives in lock-step, the first state is repeated at this period [s].
_REPEAT_PERIOD = 0.05

# A stamp [s] is remembered for no longer, so that a clock that began anew is soon obeyed.
_LONGEST_MEMORY = 1.0

# In real time, more steps than this behind the wall clock are given up, not caught up.
_MAX_CATCH_UP = 50

# One of two controllers has gone when it has been silent for so long [s].
_QUIET = 5.0

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
    protective_speed: float = parameter(
        SPEED_FACTOR,
        "times its speed limit, a joint makes the robot stop, in torque control with limits",
        bounds=(1.0, 1000.0),
    )
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
    external_wrench_timeout: float = parameter(
        0.0, "a push that is not repeated ends after; 0: never", unit="s", bounds=(0.0, 3600.0)
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
        self.error: SimulationError | None = None
        self._health = diagnostics.Health(self)
        p = self._params = declare(self, BridgeParameters, prefixes=(_ENVIRONMENT,))
        environment = declare_environment(self)
        self._robot = load_robot(p.urdf or p.robot)
        self._simulator = Simulator(self._robot, p.simulator(environment))
        self._reset()
        position = p.control == "position"
        self._drive: Callable[..., None] = (
            self._simulator.command_position if position else self._simulator.command_effort
        )
        self._is_lockstep = p.mode == "lockstep"
        self._reader = CommandInput(self._robot.joints, p.control)
        self._senders = Senders(p.command_timeout, _QUIET, at_once=self._is_lockstep)
        self._order = StampOrder(min(p.command_timeout, _LONGEST_MEMORY))
        self._lost = 0  # steps that were given up
        self._push = PushInput(self._robot.sensor_frame, p.external_wrench_timeout)
        self._delayed: deque[Command] = deque()
        self._heard = self._answered = False
        self._stamp = 0  # of the present state [ns]
        self._tally = Tally(steady())
        self._conduct = Conduct(self._health, self._halt, self._reader.topic)
        self._health.check = self._check
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
        self._commands = self.create_subscription(
            JointState,
            self._reader.topic,
            with_info(self._on_command),
            QOS,
            qos_overriding_options=QOS_OVERRIDES,
        )
        self.create_subscription(WrenchStamped, "external_wrench", self._on_external_wrench, QOS)

    def _start(self) -> None:
        self._description_publisher.publish(String(data=self._robot.urdf))
        p = self._params
        self._conduct.start(f"{self._robot.name} in {p.mode}, {p.control} control, {p.rate:g} Hz")
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        if self._is_lockstep:
            self.create_timer(_REPEAT_PERIOD, self._watch_lockstep, clock=clock)
        else:
            self._started = steady()
            self.create_timer(1.0 / self._params.rate, self._keep_up, clock=clock)
        tell(Event.READY)

    # --- time --------------------------------------------------------------------------

    def _watch_lockstep(self) -> None:
        """Repeat the first state until it is answered; give up on a silent controller."""
        if not self._answered:
            there = self._state_publisher.get_subscription_count()
            self._heard = there >= self._params.wait_for_subscribers
            self._publish_state()
            return
        silence = steady() - self._tally.last
        if silence > self._params.lockstep_timeout:
            rejected = self._conduct.rejected
            self._fail(
                SimulationError(
                    f"no command for the state stamped {self._state.t:.3f} s within "
                    f"{self._params.lockstep_timeout:g} s; is the controller alive and active?"
                    + (f" The last command was rejected: {rejected}" if rejected else ""),
                    ExitCode.STALLED,
                )
            )

    def _keep_up(self) -> None:
        """Make the steps that are due by the wall clock.

        Those that are given up are missing in the stamps: no state is older than it says.
        """
        passed = int((steady() - self._started) * self._params.rate)
        due = passed - self._state.step - self._lost
        if due > _MAX_CATCH_UP:
            self._conduct.count("steps given up", due - 1)
            self._health.complain(
                f"{due} steps behind the wall clock: slower than real time", about="slow"
            )
            self._lost += due - 1
            due = 1
        for _ in range(due):
            self._brake_on_silence()
            self._step()

    def _step(self) -> None:
        if self.done:
            return
        if self._push.is_over(self._now()):
            self._simulator.set_external_wrench(None)
            self._conduct.count("external_wrench timed out")
        try:
            self._simulator.step()
        except SimulationError as error:
            self._fail(error)  # it cannot be brought to rest
            return
        self._state = self._simulator.read()
        self._publish_state()
        if self._simulator.violation:
            if not self._simulator.is_pushed:
                self._push.forget()
            self._conduct.stop(self._simulator.violation)
        elif self._conduct.is_stopping and self._simulator.is_standing:
            self._conduct.stand()
        self._report_progress()
        duration = self._params.duration
        if duration > 0 and not self._is_lockstep and self._state.t >= duration:
            self.done = True

    # --- messages ----------------------------------------------------------------------

    def _publish_state(self) -> None:
        state = self._state
        self._stamp = round((state.step + self._lost) * 1e9 / self._params.rate)
        stamp = stamp_to_ros(self._stamp)
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

    def _on_command(self, msg: JointState, info: Mapping[str, Any]) -> None:
        heeded = self._senders.hear(info[NUMBER], self._now())
        stamp = ns_from_ros(msg.header.stamp)
        if self._is_lockstep and not (self._heard and stamp == self._stamp):
            return  # it does not answer the present state, or not all subscribers have got that
        if self._senders.contested != self._conduct.is_contested:
            self._judge_senders()
        try:
            command = self._reader.from_ros(msg)
        except InvalidMessageError as error:
            self._conduct.reject(error)
            return
        if self._may_take(stamp, heeded=heeded):
            self._take(command, stamp)
        elif self._is_lockstep:
            self._tally.last = steady()  # time goes on, though the robot stands
        if self._is_lockstep:
            self._answered = True
            self._advance()

    def _may_take(self, stamp: int, *, heeded: bool) -> bool:
        """Whether a good command may act; count it if not."""
        if not heeded:
            self._conduct.count("commands of a second controller")
        elif self._conduct.is_stopping:
            self._conduct.count("commands refused in a stop")
        elif not self._is_lockstep and self._order.is_late(stamp, self._now()):
            self._conduct.count("commands out of order")
        else:
            return True
        return False

    def _take(self, command: Command, stamp: int) -> None:
        self._tally.take(steady(), self._stamp - stamp if stamp else 0)
        if self._conduct.is_braked:
            self._conduct.obey()
            tell(Event.COMMANDED)
        self._delayed.append(command)
        if len(self._delayed) <= self._params.command_delay:
            return
        self._drive(*self._delayed.popleft())
        if self._simulator.clipped is not None:
            self._conduct.clip(str(self._simulator.clipped))

    def _advance(self) -> None:
        """Step in lock-step, unless this was the end."""
        duration = self._params.duration
        if duration > 0 and self._state.step >= math.floor(duration * self._params.rate + 0.5):
            self.done = True
        else:
            self._step()

    def _report_progress(self) -> None:
        """Say how far a run of limited duration is, ten times."""
        steps = round(self._params.duration * self._params.rate)
        if steps and self._state.step % max(1, steps // 10) == 0:
            self.get_logger().info(f"simulated {self._state.t:g} s of {self._params.duration:g} s")
            tell(Event.PROGRESS, t=self._state.t)

    def _on_external_wrench(self, msg: WrenchStamped) -> None:
        try:
            wrench = self._push.from_ros(msg, self._now(), has_stamps=self._is_lockstep)
        except InvalidMessageError as error:
            self._health.reject("external_wrench", error)
        else:
            self._simulator.set_external_wrench(wrench)

    # --- what is wrong -------------------------------------------------------------------

    def _now(self) -> float:
        """Return the time by which messages age [s]: steady, or simulated in lock-step."""
        return self._state.t if self._is_lockstep else steady()

    def _fail(self, error: SimulationError) -> None:
        """End the node; :func:`run` says the error, for rclpy shouts what a callback raises."""
        self._health.set(diagnostics.ERROR, str(error))
        self.error, self.done = error, True

    def _halt(self) -> None:
        self._simulator.brake()
        self._delayed.clear()

    def _brake_on_silence(self) -> None:
        if self._conduct.is_braked:
            return
        if steady() - self._tally.last > self._params.command_timeout:
            self._conduct.brake(
                f"no command for {self._params.command_timeout:g} s: braked",
                "see whether the controller is alive and active; the next command is taken",
            )

    def _judge_senders(self) -> None:
        """Brake because two controllers command, or go on because one of them has gone."""
        if self._senders.contested:
            self._conduct.contest(self._names_of_senders())
        else:
            self._conduct.settle()

    def _names_of_senders(self) -> list[str]:
        """Return the names of the nodes that publish commands, one a publisher."""
        names = names_of_publishers(self, self._commands.topic_name)
        return sorted(name or "one whose name is not known yet" for name in names)

    def _check(self) -> None:
        """Bring the report up to date, once a second."""
        self._health.values.update(self._tally.report(steady(), self._state.t))
        self._senders.review(self._now())
        self._senders.see(self._names_of_senders())
        if self._senders.contested or self._conduct.is_contested:
            self._judge_senders()  # by now the graph may know more of their names
        self._conduct.review()

    def at_rest(self) -> bool:
        """Brake, and return whether the robot stands; in lock-step time stands still anyway."""
        if not self.done and not self._conduct.is_braked:
            self._conduct.brake("ending: braked", "")
        return self.done or self._is_lockstep or self._simulator.is_standing

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
