"""The robot of a sequence in lock-step: simulated, and as careful as the bridge.

It refuses commands that are not finite, holds the last one, brakes without one, clips to its
limits, and makes a protective stop where a joint is far beyond them.  It is stepped by hand.
"""

from collections.abc import Sequence
from typing import Any

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.lab.campaign.record import COMMAND_TIMEOUT
from eulerparams_control.messages.from_ros import CommandReader
from eulerparams_control.robot.catalogue import RobotDescription
from sim_bridge.simulator import Simulator, SimulatorParameters, SimulatorState

_STEPS = 4  # of the simulation in a period of joint_states

PROTECTIVE_SPEED = 1.5
"""A joint this many times as fast as its limit makes the robot stop by itself."""


class BrakingArm:
    """A simulated arm that takes commands as messages.

    Args:
        robot: which.
        control: "position" or "torque".
        rate: [Hz] of joint_states.

    Attributes:
        state: what its sensors measure now.
        refused: how many commands it refused.
        stops: how many protective stops it made.
    """

    def __init__(self, robot: RobotDescription, control: str, rate: float) -> None:
        self._control = control
        parameters = SimulatorParameters(
            rate=_STEPS * rate, control=control, protective_speed=PROTECTIVE_SPEED
        )
        self._simulator = Simulator(robot, parameters)
        self._reader = CommandReader(robot.joints, control)
        self._silence, self._period = 0.0, 1.0 / rate
        self.refused = self.stops = 0
        self._is_stopping = False
        self.state: SimulatorState = self._simulator.read()

    def obey(self, msg: Any) -> None:
        """Take a command, or refuse it."""
        if self._is_stopping:
            self.refused += 1
            return
        try:
            if self._control == "position":
                self._simulator.command_position(*self._reader.position_from_ros(msg))
            else:
                self._simulator.command_effort(self._reader.effort_from_ros(msg))
        except InvalidMessageError:
            self.refused += 1
            return
        self._silence = 0.0

    def push(self, wrench: Sequence[float] | None) -> None:
        """Push the tool with a wrench (6,) [N, Nm] from now on; None is no longer."""
        self._simulator.set_external_wrench(wrench)

    def step(self) -> None:
        """Go on to the next joint_states."""
        self._silence += self._period
        if self._silence > COMMAND_TIMEOUT + self._period / 2:
            self._simulator.brake()
        for _ in range(_STEPS):
            self._simulator.step()
            self._protect()
        self.state = self._simulator.read()

    def _protect(self) -> None:
        """Brake where a joint is out of control, until the arm stands."""
        if self._is_stopping:
            self._is_stopping = not self._simulator.is_standing
        elif self._simulator.violation:
            self._simulator.brake()
            self.stops, self._is_stopping = self.stops + 1, True

    def close(self) -> None:
        """End the simulation."""
        self._simulator.close()
