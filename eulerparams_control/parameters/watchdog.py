"""Parameters of the node ``watchdog``."""

from dataclasses import dataclass

import numpy as np

from eulerparams_control.parameters.efforts import require_size
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.robot.robot import Robot, Tool


@dataclass(frozen=True)
class WatchdogParameters:
    """Parameters of the node ``watchdog``."""

    robot_description: str = parameter("", "URDF; empty: from the topic robot_description")
    base_frame: str = parameter("", "link that carries the arm; empty: the root link")
    tip_frame: str = parameter("tool0", "link at its end")
    joints: tuple[str, ...] = parameter((), "active joints; empty: all from base to tip")
    command_type: str = parameter(
        "forward", "message type for the driver", choices=("joint_state", "forward")
    )
    timeout: float = parameter(
        0.05, "silence of the controller that brakes the arm", unit="s", bounds=(0.002, 10.0)
    )
    state_timeout: float = parameter(
        0.1, "gap of joint_states that leaves gravity only", unit="s", bounds=(0.002, 10.0)
    )
    damping: float = parameter(
        20.0, "each speed falls by e within its inverse", unit="1/s", bounds=(0.1, 200.0)
    )
    max_effort_rate: float = parameter(
        1000.0, "at which braking begins and ends", unit="Nm/s", bounds=(100.0, 1e9)
    )
    compensate_gravity: bool = parameter(True, "false: the robot does it itself")
    tool_mass: float = parameter(0.0, "that the URDF lacks", unit="kg", bounds=(0.0, 1000.0))
    tool_com: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "its centre of mass in the tip frame", unit="m"
    )

    def robot(self, urdf: str) -> Robot:
        """Return the robot of a URDF with its tool.

        Raises:
            ConfigurationError: if the tool's centre has not three numbers.
            RobotError: if the URDF lacks a frame or a joint.
        """
        require_size("tool_com", self.tool_com, 3)
        tool = Tool(self.tool_mass, np.array(self.tool_com), np.zeros((3, 3)))
        return Robot(urdf, self.base_frame, self.tip_frame, self.joints, tool=tool)
