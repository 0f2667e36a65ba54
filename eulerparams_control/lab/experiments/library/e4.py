"""E4 (b): CLIK (23) with rates of the desired angles from their differences, through the pole."""

from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.experiments.library._arms import STEP_NS, T1, clik, ur5
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.orientation import OrientationRepresentation, representation
from eulerparams_control.laws.orientation.euler_angles import EulerAnglesRepresentation
from eulerparams_control.laws.rotations import Array

_K = 100.0  # [1/s]
_STEP = STEP_NS / 1e9  # [s]
_JUMP = 100.0  # times the speed of Euler parameters: no motion of the path


class DifferencedDisplacement(NamedTuple):
    """Angles as in (22), and phi_d of the sample before; at the first that of now."""

    phi_d: Array
    phi_e: Array
    error: Array
    before: Array


class DifferencedAngles(EulerAnglesRepresentation):
    """Euler angles whose desired rates are differences of phi_d, as a planner of angles has them.

    Of no use but to show what it does, so it is not in the registry.
    """

    def displacement(self, R_d: Array, R_e: Array, previous: Any = None) -> Any:
        """Return the angles, and phi_d of the sample before."""
        phi_d, phi_e, error = super().displacement(R_d, R_e, previous)
        before = phi_d if previous is None else previous.phi_d
        return DifferencedDisplacement(phi_d, phi_e, error, before)

    def velocity(self, x_de: Any, omega_d: Array, k_Po: float) -> Array:
        """Return T(phi_e) (dphi_d + k_Po (phi_d - phi_e)), eq. (23), dphi_d by differences."""
        dphi_d = (x_de.phi_d - x_de.before) / _STEP
        return self.options.sequence.T(x_de.phi_e) @ (dphi_d + k_Po * x_de.error)


def run() -> Result:
    """Return the joint speeds that both laws ask for on T1 with delta = 0."""
    differenced = joint_speeds(DifferencedAngles())
    parameters = joint_speeds(representation("euler_parameters")).max()
    first = differenced[np.argmax(differenced > _JUMP * parameters)]
    numbers = {
        "differenced_jump": (first, "first jump of the joint speed, dphi_d by differences"),
        "differenced_speed": (differenced.max(), "largest joint speed, dphi_d by differences"),
        "parameters_speed": (parameters, "largest joint speed with Euler parameters"),
    }
    ratio = Number(float(differenced.max() / parameters), "joint speed with dphi_d by differences")
    found = {name: Number(float(value), text, "rad/s") for name, (value, text) in numbers.items()}
    return Result(found | {"differenced_ratio": ratio})


def joint_speeds(law: OrientationRepresentation) -> Array:
    """Return the largest joint speed [rad/s] of each tick of CLIK on T1, through the pole."""
    robot, home = ur5()
    motion = T1(delta=0.0)
    q_0 = inverse_kinematics(robot, motion.frames[0], home)
    ticks = clik(robot, law, (_K, _K), q_0, motion, 5.0)
    speeds = (tick.command.dq for tick in ticks)
    return np.array([np.abs(dq).max() for dq in speeds if dq is not None])
