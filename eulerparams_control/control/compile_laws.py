"""Compile the formulas beforehand: of all schemes, with all representations, and what maps them.

Whoever starts a node first has it done for what that node uses; an installation for many users
or an image does it at once.
"""

import argparse
import sys
import time

import numpy as np

from eulerparams_control.control.controller import Controller
from eulerparams_control.control.options import ControllerOptions
from eulerparams_control.laws._old.compiled import IS_COMPILED, cache_folder
from eulerparams_control.laws._old.orientation import ORIENTATIONS, representation
from eulerparams_control.laws._old.orientation.sequences import extract, pole_distance
from eulerparams_control.laws._old.rotations import (
    angle_between,
    exp,
    log,
    matrix,
    quaternion,
    rotation_vector,
)
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

# What recordings are analysed with.
_MAPPED = (angle_between, exp, log, matrix, quaternion, rotation_vector, extract, pole_distance)


def main(args: list[str] | None = None) -> int:
    """Compile, and say where and for how long; return the exit code."""
    parser = argparse.ArgumentParser(prog="compile_laws", description="Compile the formulas.")
    parser.add_argument("--schemes", nargs="+", choices=schemes(), default=schemes())
    parser.add_argument("--orientations", nargs="+", choices=ORIENTATIONS, default=ORIENTATIONS)
    asked = parser.parse_args(args)
    if not IS_COMPILED:
        print("nothing to compile: numba is not installed, or EULERPARAMS_PLAIN is set")
        return 0
    started, arm = time.perf_counter(), load_robot("ur5")
    robot, home = Robot(arm.urdf, arm.base_frame, arm.tip_frame), np.array(arm.home)
    displacements = (representation(name).laws.displacement for name in ORIENTATIONS)
    elastic = (getattr(representation(name), "elastic", None) for name in asked.orientations)
    energies = (each.energy for each in elastic if each is not None)
    for formula in (*_MAPPED, *displacements, *energies):
        formula.prepare()
    state = robot.state(home, np.zeros_like(home))
    inverse_kinematics(robot, DesiredFrame(state.p_e, state.R_e), home)
    for orientation in asked.orientations:
        for name in asked.schemes:
            parameters = schemes()[name].parameters(orientation=orientation)
            Controller(parameters.make_scheme(robot), ControllerOptions(), home)
    print(f"formulas compiled in {time.perf_counter() - started:.0f} s, kept in {cache_folder()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
