"""Commands of every scheme and representation along a motion, in a file: FILE."""

import sys

import numpy as np

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.trajectories import Circle
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

STEPS, MS = 24, 1_000_000


def commands(arm, robot, info, orientation):
    """Return the commands (STEPS, ...) while the arm goes along a circle, a bit beside it.

    In the middle the representation changes.
    """
    scheme = info.parameters(orientation=orientation).make_scheme(robot)
    controller = Controller(scheme, ControllerOptions(), np.array(arm.home))
    frame = scheme.start_frame()
    circle = Circle(0.1, np.array([1.0, 0.3, 0.0]), 2.0, 1.0, 0.5, 0.5)
    controller.follow(circle.trajectory(frame.p_d, frame.R_d), None)
    rows, rng, dq = [], np.random.default_rng(0), 0.05 * np.ones(robot.n)
    for k in range(STEPS):
        if "wrench" in info.inputs:
            wrench = 5.0 * rng.normal(size=6)
            scheme.sense(SensedWrench(wrench, robot.placement(arm.sensor_frame)))
        q = np.array(arm.home) + 1e-3 * k * dq
        if k == STEPS // 2:
            other = ORIENTATIONS[ORIENTATIONS.index(orientation) - 1]
            scheme.change(info.parameters(orientation=other))
        if k == STEPS - 5:
            controller.halt()
        command = controller.step((k + 1) * 4 * MS, q, dq, now=4e-3 * (k + 1))
        controller.guidance.lyapunov()
        assert command is not None
        assert not controller.fault
        told = (command.q, command.dq, command.effort)
        rows.append(np.concatenate([part for part in told if part is not None]))
    return np.array(rows)


def all_commands():
    """Return the commands by scheme and orientation."""
    ur5 = load_robot("ur5")
    model = Robot(ur5.urdf, ur5.base_frame, ur5.tip_frame)
    return {
        f"{info.name} {orientation}": commands(ur5, model, info, orientation)
        for info in schemes().values()
        for orientation in ORIENTATIONS
    }


if __name__ == "__main__":
    np.savez(sys.argv[1], **all_commands())
