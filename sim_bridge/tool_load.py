"""The wrench that a carried body exerts on a force/torque sensor."""

import numpy as np

from eulerparams_control.laws.rotations import Array, S
from sim_bridge.environment import SensorMotion
from sim_bridge.urdf import Body


class Load:
    """Weight and inertia of a rigid body, as its sensor feels them.

    The momentum balance of the body over a step of length dt, p its momentum and L its
    angular momentum about the centre of mass c (world axes), gives what it exerts on
    the sensor:

        f = m g - (p - p_previous) / dt,    mu = c x f - (L - L_previous) / dt.

    Args:
        body: in the sensor frame.
        gravity: world frame, m/s^2; (3,).
        dt: length of a step, s.
    """

    def __init__(self, body: Body, gravity: Array, dt: float) -> None:
        one, zero, S_c = np.eye(3), np.zeros((3, 3)), S(body.com)
        # (v, omega) of the sensor frame to (p, L)
        self._inertia = np.block([[body.mass * one, -body.mass * S_c], [zero, body.inertia]])
        self._shift = np.block([[one, zero], [S_c, one]])  # moments about c to about the sensor
        self._weight = body.mass * gravity
        self._dt = dt
        self._momentum = np.zeros((2, 3))

    def reset(self) -> None:
        """Start at rest."""
        self._momentum = np.zeros((2, 3))

    def wrench(self, sensor: SensorMotion) -> Array:
        """Return force and moment (6,) on the sensor, in its axes about its origin.

        Args:
            sensor: how it lies and moves after the step.
        """
        R, twist = sensor.R, np.array([sensor.v, sensor.omega])
        momentum = self._inertia.dot(twist.dot(R).ravel()).reshape(2, 3).dot(R.T)
        force = (self._momentum - momentum) / self._dt
        self._momentum = momentum
        force[0] += self._weight
        wrench: Array = self._shift.dot(force.dot(R).ravel())
        return wrench
