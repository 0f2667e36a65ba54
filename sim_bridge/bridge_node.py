"""The node ``pybullet_bridge``: stands in for the robot and its force/torque sensor.

In ``realtime`` the wall clock drives; in ``lockstep`` the step to t_k+1 is made when the
command stamped t_k arrives, so that runs repeat to the bit.  Its surroundings are parameters
``environment.NAME.KEY``, see docs/contact.md.
"""

import math
import sys
from collections.abc import Mapping, Sequence
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
from std_srvs.srv import Trigger

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import InvalidMessageError, SimulationError, kind_of
from eulerparams_control.events import Event, tell
from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.messages.to_ros import stamp_to_ros, wrench_to_ros
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.message_info import NUMBER, deserialized, with_info
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.publishers import names_of_publishers
from eulerparams_control.ros.qos import QOS, QOS_LATCHED, QOS_STREAM, overridable
from eulerparams_control.ros.real_time import claim
from eulerparams_control.ros.runtime import run
from sim_bridge.bridge_parameters import LOCKSTEP, BridgeParameters
from sim_bridge.commands import push_from_ros
from sim_bridge.drive import Drive
from sim_bridge.drive_modes import DriveMode, DriveReply, DriveStatus
from sim_bridge.drive_words import UNLOCK, DriveWords
from sim_bridge.environment import Environment, nest, read_environment
from sim_bridge.pacing import LockStep, WallClock
from sim_bridge.simulator import Simulator, SimulatorState

# Of the parameters environment.NAME.KEY, any number of them.
_ENVIRONMENT = "environment."

# Until the first command arrives in lock-step, the first state is repeated at this period [s].
_REPEAT_PERIOD = 0.05

# In real time the sensor is as restless as real ones [N, Nm]: one that repeats itself is stuck.
_DITHER, _DITHERS = 1e-9, 1000

# The last messages are given this long to reach their readers at the end.
_LINGER = Duration(seconds=1.0)


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

    parameters_type = BridgeParameters

    def __init__(self) -> None:
        super().__init__("pybullet_bridge")
        self._health = diagnostics.Health(self)
        p = self._params = declare(self, self.parameters_type, prefixes=(_ENVIRONMENT,))
        environment = declare_environment(self)
        robot = self._robot = load_robot(p.urdf or p.robot)
        simulator = Simulator(robot, p.simulator(environment))
        self._drive = Drive(simulator, p.policy(), self._say, self._senders)
        self._health.values, self._obeyed = self._drive.values, False
        claim(p, self._health)
        now = 0.0 if p.mode == LOCKSTEP else steady.now()
        self._drive.reset(p.first_positions(robot.joints), now)
        ready = f"{robot.name} in {p.mode}, {p.control} control, {p.rate:g} Hz"
        self._words = DriveWords(ready, self._drive.topic, p.command_timeout)
        self._make_messages(simulator.joint_names)
        self._connect()
        self._say(self._drive.status)
        self._pacing = self._make_pacing()
        self._health.check = self._pacing.review
        tell(Event.READY)
        period = _REPEAT_PERIOD if p.mode == LOCKSTEP else 1.0 / p.rate
        self.create_timer(period, self._turn, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _make_pacing(self) -> WallClock | LockStep:
        p = self._params
        given = self._drive, self._publish, p.rate, p.duration
        if p.mode == LOCKSTEP:
            return LockStep(*given, timeout=p.lockstep_timeout, is_watched=self._is_watched)
        return WallClock(*given, max_command_age=p.max_command_age)

    def _make_messages(self, names: Sequence[str]) -> None:
        p = self._params
        still = [0.0] * len(names)  # as grippers are, locked at 0
        speeds = still if p.velocities else [math.nan] * len(names)
        states = JointState(name=list(names), position=still, velocity=speeds, effort=still)
        self._states, self._wrench, self._time = states, WrenchStamped(), ClockMessage()
        self._wrench.header.frame_id = self._robot.sensor_frame
        self._moving = [  # views into the message
            np.frombuffer(numbers)[: len(self._robot.joints)]
            for numbers in (states.position, states.velocity, states.effort)
        ]
        self._dither = np.random.default_rng(0).uniform(-_DITHER, _DITHER, (_DITHERS, 6))
        self._clock_every = max(1, round(p.rate / p.clock_rate))
        self._progress_every = max(1, round(p.duration * p.rate) // 10) if p.duration else 0

    def _connect(self) -> None:
        self._description_publisher = self.create_publisher(
            String, "robot_description", QOS_LATCHED
        )
        self._clock_publisher = self.create_publisher(ClockMessage, "/clock", 10)
        self._wrench_publisher = self.create_publisher(WrenchStamped, "wrench", QOS_STREAM)
        self._state_publisher = self.create_publisher(JointState, "joint_states", QOS_STREAM)
        self._commands = self.create_subscription(
            JointState,
            self._drive.topic,
            with_info(self._on_command),
            **overridable(QOS),
            raw=True,
        )
        self.create_subscription(
            WrenchStamped,
            "external_wrench",
            self._on_external_wrench,
            **overridable(QOS),
        )
        self.create_service(Trigger, UNLOCK, self._on_unlock)
        self._description_publisher.publish(String(data=self._robot.urdf))

    # --- what :func:`run` asks for -----------------------------------------------------

    @property
    def done(self) -> bool:
        """Whether the node is to end."""
        return self._pacing.done

    @property
    def error(self) -> SimulationError | None:
        """Why it ends, if it failed."""
        return self._pacing.error

    def at_rest(self) -> bool:
        """Brake, and return whether the robot is at rest."""
        return self._pacing.brake()

    def close(self) -> None:
        """Let the last messages reach their readers, then end the simulator."""
        for publisher in self.publishers:
            publisher.wait_for_all_acked(_LINGER)
        self._drive.close()

    # --- messages ----------------------------------------------------------------------

    def _publish(self, state: SimulatorState, stamp_ns: int) -> None:
        stamp = stamp_to_ros(stamp_ns)
        if state.step % self._clock_every == 0:
            self._time.clock = stamp
            self._clock_publisher.publish(self._time)
        if self._wrench_publisher.get_subscription_count():
            w = state.wrench
            if self._params.mode != LOCKSTEP:
                w = w + self._dither[state.step % _DITHERS]
            wrench_to_ros(w, stamp, self._wrench)
            self._wrench_publisher.publish(self._wrench)
        self._states.header.stamp = stamp
        for numbers, values in zip(self._moving, (state.q, state.dq, state.tau), strict=True):
            numbers[:] = values
        self._state_publisher.publish(self._states)
        if self._progress_every and state.step and state.step % self._progress_every == 0:
            tell(Event.PROGRESS, t=state.t)

    def _on_command(self, data: bytes, info: Mapping[str, Any]) -> None:
        try:
            msg = deserialized(data, JointState)
        except InvalidMessageError as error:
            self._health.reject(self._drive.topic, error)
            return
        if self._pacing.command(msg, info[NUMBER]) is DriveReply.REJECTED:
            why = self._drive.rejection
            assert why is not None
            self._health.complain(f"command rejected: {why}", error=True, about=kind_of(why))
            self._health.warn("a command rejected")

    def _on_external_wrench(self, msg: WrenchStamped) -> None:
        try:
            wrench = push_from_ros(msg, self._robot.sensor_frame)
        except InvalidMessageError as error:
            self._health.reject("external_wrench", error)
        else:
            self._pacing.push(wrench, ns_from_ros(msg.header.stamp))

    def _on_unlock(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._drive.unlock(self._pacing.now)
        response.message = self._words.describe(self._drive.status)[1]
        return response

    def _is_watched(self) -> bool:
        """Whether all who are to see the first state are there."""
        there = self._state_publisher.get_subscription_count()
        return bool(there >= self._params.wait_for_subscribers)

    def _senders(self) -> list[str]:
        """Return the names of the nodes that publish commands, one a publisher."""
        return sorted(names_of_publishers(self, self._commands.topic_name))

    # --- health ------------------------------------------------------------------------

    def _turn(self) -> None:
        if behind := self._pacing.turn():
            self._health.complain(
                f"{behind} steps behind the wall clock: slower than real time", about="slow"
            )

    def _say(self, status: DriveStatus) -> None:
        """Say what the robot does."""
        self._health.set(*self._words.describe(status), mode=status.mode, cause=status.cause)
        if status.mode is DriveMode.OBEYING and not self._obeyed:
            tell(Event.COMMANDED)
        self._obeyed = status.mode is DriveMode.OBEYING


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(BridgeNode, args)


if __name__ == "__main__":
    sys.exit(main())
