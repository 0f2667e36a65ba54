"""Shared by the library experiments: the arm of the paper's tests, T1, and CLIK on it."""

import math
from collections.abc import Iterator

import numpy as np

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.errors import SimulationError
from eulerparams_control.laws.clik import Clik
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.motion.way_points import parse_way_points
from eulerparams_control.parameters.clik import ClikParameters
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

STEP_NS = 1_000_000  # of a tick at 1 kHz
SEED = 1999


def ur5() -> tuple[Robot, Array]:
    """Return the UR5 and its home (n,)."""
    arm = load_robot("ur5")
    return Robot(arm.urdf, arm.base_frame, arm.tip_frame, arm.joints), np.array(arm.home)


def T1(delta: float, end: float = math.radians(131)) -> Trajectory:
    """Return T1: through the pole of XYZ at 90 deg, which it passes at ``delta`` [rad]."""
    beta = (math.radians(50), end, end)
    return parse_way_points(
        times=(0.0, 4.0, 5.0),
        positions=(0.485, 0.02, 0.375, 0.485, 0.12, 0.475, 0.485, 0.12, 0.475),
        orientations=[angle for b in beta for angle in (delta, b, math.pi / 2)],
        orientation_format="ZYZ",
    )


def clik(
    robot: Robot,
    law: OrientationRepresentation,
    gains: tuple[float, float],
    q_0: Array,
    motion: Trajectory,
    duration: float,
) -> Iterator[Tick]:
    """Yield the ticks of CLIK at 1 kHz, on an arm that does what it is told at once.

    Args:
        robot: the arm.
        law: the representation.
        gains: k_Pp, k_Po [1/s].
        q_0: (n,) where the arm is at the start.
        motion: the desired motion.
        duration: [s] of it.

    Raises:
        SimulationError: if the controller gives up.
    """
    k_Pp, k_Po = gains
    parameters = ClikParameters(orientation=law.name, k_Pp=k_Pp, k_Po=k_Po, enforce_limits=False)
    scheme = Clik(robot, parameters)
    scheme.orientation = law  # which may be in no registry
    options = ControllerOptions(max_jump_rotation=math.pi, require_reference=True)
    controller = Controller(scheme, options, q_0)
    controller.follow(motion, None)
    q, dq = q_0, np.zeros_like(q_0)
    for step in range(round(duration * 1e9 / STEP_NS) + 1):
        command = controller.step(step * STEP_NS, q, dq)
        if controller.fault or command is None or controller.guidance.tick_now is None:
            raise SimulationError(f"CLIK gave up at {step / 1e3:g} s: {controller.fault}")
        if command.q is not None and command.dq is not None:
            q, dq = command.q, command.dq
        yield controller.guidance.tick_now
