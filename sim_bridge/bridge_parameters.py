"""Parameters of the node ``pybullet_bridge``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.parameters.real_time import RealTimeParameters
from sim_bridge.drive_modes import DrivePolicy, OnSilence
from sim_bridge.environment import Environment
from sim_bridge.parameters import SimulatedParameters, SimulatorParameters

REALTIME, LOCKSTEP = MODES = ("realtime", "lockstep")


@dataclass(frozen=True)
class BridgeParameters(SimulatedParameters, RealTimeParameters):
    """Parameters of the node ``pybullet_bridge``."""

    robot: str = parameter("ur5", "name of a robot of config/robots, or path of such a file")
    urdf: str = parameter("", "path of a URDF to take instead of a robot of the catalogue")
    mode: str = parameter("realtime", "what drives the time", choices=MODES)
    clock_rate: float = parameter(100.0, "messages of /clock", unit="Hz", bounds=(1.0, 10000.0))
    duration: float = parameter(0.0, "ends after; 0 runs on", unit="s", bounds=(0.0, 1e6))
    initial_positions: tuple[float, ...] = parameter((), "of the joints; empty: home", unit="rad")
    command_delay: int = parameter(0, "steps until a command acts", bounds=(0, 1000))
    command_timeout: float = parameter(
        0.1, "without commands the robot brakes after", unit="s", bounds=(0.001, 60.0)
    )
    on_silence: str = parameter(
        OnSilence.BRAKE.value,
        "brake after command_timeout, or hold_last: the last command acts for ever, as with "
        "forward_command_controller",
        choices=[choice.value for choice in OnSilence],
    )
    max_joint_acceleration: tuple[float, ...] = parameter(
        (),
        "that positions and speeds of commands may ask for, else a protective stop until "
        "~/unlock; one, or one a joint; 0 or empty: any",
        unit="rad/s^2",
        bounds=(0.0, 1e6),
    )
    external_wrench_timeout: float = parameter(
        0.0, "a push that is not repeated ends after; 0: never", unit="s", bounds=(0.0, 3600.0)
    )
    max_command_age: float = parameter(
        0.0,
        "in real time, time stands still while commands answer states older than this; 0: never",
        unit="s",
        bounds=(0.0, 1.0),
    )
    lockstep_timeout: float = parameter(
        10.0, "without a command the run ends after", unit="s", bounds=(0.1, 3600.0)
    )
    wait_for_subscribers: int = parameter(
        0, "of joint_states, before the first step in lock-step", bounds=(0, 100)
    )

    def simulator(self, environment: Environment | None = None) -> SimulatorParameters:
        """Return what concerns the simulator, with what is around the robot."""
        values = {field.name: getattr(self, field.name) for field in fields(SimulatedParameters)}
        return SimulatorParameters(**values, environment=environment or {})

    def policy(self) -> DrivePolicy:
        """Return how patient the robot is."""
        return DrivePolicy(
            self.command_timeout,
            self.command_delay,
            self.external_wrench_timeout or math.inf,
            changes_at_once=self.mode == LOCKSTEP,
            on_silence=OnSilence(self.on_silence),
            max_joint_acceleration=self.max_joint_acceleration,
        )

    def first_positions(self, joints: Sequence[str]) -> tuple[float, ...] | None:
        """Return where the joints begin; None is at home.

        Raises:
            ConfigurationError: if it is not one for each of the joints.
        """
        q = self.initial_positions
        if q and len(q) != len(joints):
            raise ConfigurationError(
                f"initial_positions has {len(q)} values; expected {len(joints)} for "
                f"{', '.join(joints)}"
            )
        return q or None
