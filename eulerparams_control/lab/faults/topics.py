"""The topics between a robot, its controller and what leads it."""

from eulerparams_control.parameters.schemes import COMMANDS

FROM_ROBOT = ("joint_states", "wrench")
TO_CONTROLLER = (*FROM_ROBOT, "reference")
TO_ROBOT = tuple(COMMANDS.values())
TOPICS = (*TO_CONTROLLER, *TO_ROBOT)
"""Those that a fault can be on."""

ROBOT = "robot"
"""In the place of a topic: all of those that come from the robot, together."""
