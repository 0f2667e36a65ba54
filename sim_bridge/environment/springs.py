"""Springs from an anchor in the world to the tool, which pull and push alike."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.rotations import Array, cross, exp, log
from sim_bridge.environment.forces import Force, SensorMotion, at_point
from sim_bridge.environment.keys import NO_TURN, ORIGIN, number, quaternion, rotation, vector


@dataclass(frozen=True, kw_only=True)
class Spring(Force, shape="spring"):
    """A translational spring from ``position`` to the point p of the tool.

    f = K (position - p) - D dp, with K = U diag(stiffness) U', D = U diag(damping) U' and U
    the rotation matrix of ``orientation``.

    Attributes:
        position: of the anchor, m; (3,).
        orientation: of the axes of stiffness and damping, x, y, z, w.
        stiffness: one number or 3, N/m.
        damping: one number or 3, Ns/m.
        point: p in the sensor frame, m; (3,).
    """

    position: tuple[float, ...] = vector("m")
    orientation: tuple[float, ...] = quaternion(default=NO_TURN)
    stiffness: tuple[float, ...] = vector("N/m", one=True, least=0.0)
    damping: tuple[float, ...] = vector("Ns/m", one=True, least=0.0, default=0.0)
    point: tuple[float, ...] = vector("m", default=ORIGIN)

    def exerted(self, t: float, sensor: SensorMotion) -> tuple[Array, Array]:
        """Return the force, and its moment about the sensor's origin."""
        anchor, point, K, D = self._constants
        arm = sensor.R.dot(point)
        dp = sensor.v + cross(sensor.omega, arm)
        return at_point(K.dot(anchor - sensor.p - arm) - D.dot(dp), arm)

    @cached_property
    def _constants(self) -> tuple[Array, Array, Array, Array]:
        K, D = (_along(self.orientation, values) for values in (self.stiffness, self.damping))
        return np.array(self.position), np.array(self.point), K, D


@dataclass(frozen=True, kw_only=True)
class TorsionSpring(Force, shape="torsion_spring"):
    """A rotational spring that turns the sensor frame to ``orientation``.

    mu = K x - D omega, with x the rotation vector of R_a R' (base axes, angle from 0 to pi), R_a
    the rotation matrix of ``orientation``, R that of the sensor frame, and K, D as of a
    :class:`Spring`.  At the angle pi the moment changes its sign.

    As a hand that leads the tool it turns R_a: R_a = R(orientation) exp(a),
    a = share (offset + amplitude sin(2 pi turns s + phase)).  ``share`` rises from 0 to 1 over
    ``ramp`` from ``start`` on, s from 0 to 1 after it, and ``share`` falls over ``ramp`` until
    ``end``, each by 3 u^2 - 2 u^3: a path that is closed if ``turns`` is a whole number, which a
    negative one goes around the other way.

    Attributes:
        orientation: of the sensor frame at rest, and of the axes of stiffness and damping,
            x, y, z, w.
        stiffness: one number or 3, Nm/rad.
        damping: one number or 3, Nms/rad.
        offset, amplitude, phase: of the path, rad; (3,).
        turns: how often it is gone around.
        ramp: s.
    """

    orientation: tuple[float, ...] = quaternion()
    stiffness: tuple[float, ...] = vector("Nm/rad", one=True, least=0.0)
    damping: tuple[float, ...] = vector("Nms/rad", one=True, least=0.0, default=0.0)
    offset: tuple[float, ...] = vector("rad", default=ORIGIN)
    amplitude: tuple[float, ...] = vector("rad", default=ORIGIN)
    phase: tuple[float, ...] = vector("rad", default=ORIGIN)
    turns: float = number(default=1.0)
    ramp: float = number("s", default=1.0, above=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        is_led = any(self.offset + self.amplitude)
        if is_led and not 2.0 * self.ramp < self.end - self.start < math.inf:
            raise ConfigurationError(
                f"end is {self.end:g} s; expected it after start {self.start:g} s and, of "
                f"{self.ramp:g} s each, two ramps, and finite"
            )

    def exerted(self, t: float, sensor: SensorMotion) -> tuple[Array, Array]:
        """Return no force, and the moment."""
        R_a, K, D = self._constants
        if any(self.offset + self.amplitude):
            R_a = R_a.dot(exp(self._led(t)))
        x = log(R_a.dot(sensor.R.T))
        return np.zeros(3), K.dot(x) - D.dot(sensor.omega)

    def _led(self, t: float) -> Array:
        """Return a (3,) [rad] at the time ``t``."""
        since, left = t - self.start, self.end - t
        share = _smooth(min(since, left) / self.ramp)
        s = _smooth((since - self.ramp) / (self.end - self.start - 2.0 * self.ramp))
        offset, amplitude, phase = map(np.array, (self.offset, self.amplitude, self.phase))
        a: Array = share * (offset + amplitude * np.sin(2.0 * np.pi * self.turns * s + phase))
        return a

    @cached_property
    def _constants(self) -> tuple[Array, Array, Array]:
        K, D = (_along(self.orientation, values) for values in (self.stiffness, self.damping))
        return rotation(self.orientation), K, D


def _smooth(u: float) -> float:
    """Return 3 u^2 - 2 u^3 of u kept between 0 and 1."""
    u = min(max(u, 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)


def _along(orientation: Sequence[float], values: Sequence[float]) -> Array:
    """Return U diag(values) U', (3, 3)."""
    U = rotation(orientation)
    return U @ np.diag(values) @ U.T
