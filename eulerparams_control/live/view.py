"""State that the pages show, gathered by the node 30 times a second."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import Placement


@dataclass(frozen=True)
class View:
    """The state of the arm and of its controller, as far as they are known.

    Attributes:
        mode, cause: of the controller; "" before it has said anything.
        level: 0 well, 1 a warning, 2 an error.
        message, remedy: in words.
        robot: what is wrong with the simulated robot, in words; "" if nothing.
        trouble: a node that is gone or silent, in words; "" if none is.
        joints: positions [rad or m] by name.
        speed: of the fastest joint [rad/s or m/s].
        tip, desired, compliant: where these frames are, seen from the base.
        force: (3,) [N] on the tool, base frame.
        parameters: of the controller by name.
        stiffness: (3, 3) [N/m] along the axes of the base.
        is_simulated: whether the robot is.
        can_push: whether somebody takes ``external_wrench``.
        owner: the page that moves the arm; None if none has.
        pages: how many are open.
    """

    mode: str = ""
    cause: str = ""
    level: int = 0
    message: str = ""
    remedy: str = ""
    robot: str = ""
    trouble: str = ""
    joints: Mapping[str, float] = field(default_factory=dict)
    speed: float = 0.0
    tip: Placement | None = None
    desired: Placement | None = None
    compliant: Placement | None = None
    force: Array | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    stiffness: Array | None = None
    is_simulated: bool = False
    can_push: bool = False
    owner: int | None = None
    pages: int = 0
