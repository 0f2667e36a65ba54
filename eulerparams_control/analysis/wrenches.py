"""The contact wrench at the tip over time, from the messages of the sensor."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.controllers import parameters_to_blame, recorded
from eulerparams_control.analysis.series import Series
from eulerparams_control.errors import BagError, RobotError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.robot.robot import Robot

_FELT = 1e-6  # [N], [Nm] smallest contact that is not rounding


class SensorSeries(NamedTuple):
    """Measurements of a force/torque sensor over time.

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        w: (N, 6) [N, Nm] as it came, in the frame of the same index and about its origin.
        frames: (N,) names of links.
    """

    t: Array
    w: Array
    frames: NDArray[Any]


class Wrenches(NamedTuple):
    """Contact wrench over time, of the environment on the tool: f, mu of (52), (59).

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        f: (N, 3) [N] force, base axes.
        mu: (N, 3) [Nm] moment about the origin of the tip, base axes.
    """

    t: Array
    f: Array
    mu: Array

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return f and mu (M, 3) at instants t (M,) [s], the last samples; NaN before the first."""
        index = np.searchsorted(self.t, t, side="right") - 1
        f, mu = self.f[index], self.mu[index]
        f[index < 0] = mu[index < 0] = np.nan
        return f, mu

    @property
    def is_felt(self) -> bool:
        """Whether there is more in it than rounding."""
        return bool(np.abs(self.f).max() > _FELT or np.abs(self.mu).max() > _FELT)


def at_the_tip(
    sensed: SensorSeries, measured: Series, parameters: Mapping[str, Mapping[str, Any]]
) -> Wrenches:
    """Return what a sensor said as the contact wrench at the tip.

    Without the weight of the tool and the bias that the node impedance_control was told.  Dead
    bands, the low-pass and a tare, which concern its law, are left out.

    Args:
        sensed: what the sensor said.
        measured: motion of the arm; its last state before each instant counts.
        parameters: of the recorded nodes, by node and name.

    Raises:
        BagError: if the parameters are impossible, or a frame is not fixed to the tip.
    """
    told = recorded(parameters, ImpedanceParameters) or ImpedanceParameters()
    with parameters_to_blame(told.scheme.name):
        options = told.wrench_options(measured.robot)
    w = options.sign * sensed.w - np.array(options.bias)
    f_t, mu_t = np.empty((2, len(w), 3))
    for name in dict.fromkeys(sensed.frames.tolist()):
        here = sensed.frames == name
        f_t[here], mu_t[here] = _shifted(w[here], _sensor(measured.robot, name))
    before = np.maximum(np.searchsorted(measured.t, sensed.t, side="right") - 1, 0)
    R_e = measured.R_e[before]
    if options.tool is not None and options.weight:
        weight = options.tool.mass * np.matvec(R_e.mT, np.array(options.gravity))
        f_t, mu_t = f_t - weight, mu_t - np.cross(options.tool.com, weight)
    return Wrenches(sensed.t, np.matvec(R_e, f_t), np.matvec(R_e, mu_t))


def _sensor(robot: Robot, name: str) -> Placement:
    try:
        return robot.placement(name)
    except RobotError as error:
        raise BagError(f"the wrench cannot be moved to the tip: {error}") from error


def _shifted(w: Array, sensor: Placement) -> tuple[Array, Array]:
    """Return force and moment (N, 3) of the sensor frame in the axes of the tip, about it."""
    f_t = w[:, :3] @ sensor.R.T
    return f_t, w[:, 3:] @ sensor.R.T + np.cross(sensor.p, f_t)
