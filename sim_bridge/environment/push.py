"""A push of the tool for a while, as a hand would do it."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.rotations import Array, cross, norm
from sim_bridge.environment.forces import Force, SensorMotion, at_point
from sim_bridge.environment.keys import ORIGIN, number, vector, word

FRAMES = ("base", "tool")
"""Whose axes a push keeps to: those of the base, or of the sensor frame, which turn."""

_LEAST = 1e-9  # [N] of a force that has a direction


@dataclass(frozen=True, kw_only=True)
class Push(Force, shape="push"):
    """A force and a moment, constant but for how they begin and end.

    They rise over ``ramp`` from ``start`` on, and are gone at ``end`` after falling over ``fall``:
    with s from 0 to 1 along a ramp, by 3 s^2 - 2 s^3.

    Attributes:
        force: N; (3,).
        moment: Nm; (3,).
        frame: of whose axes force and moment are, one of ``FRAMES``.
        point: where the force acts, in the sensor frame, m; (3,).
        ramp: s.
        fall: s; as long as ``ramp`` if it is negative.
        fastest: m/s; the force falls to 0 there, with the speed along it of where it acts: no hand
            is faster, and it resists what moves against it.
    """

    force: tuple[float, ...] = vector("N", default=ORIGIN)
    moment: tuple[float, ...] = vector("Nm", default=ORIGIN)
    frame: str = word(default="base", choices=FRAMES)
    point: tuple[float, ...] = vector("m", default=ORIGIN)
    ramp: float = number("s", default=0.0, least=0.0)
    fall: float = number("s", default=-1.0)
    fastest: float = number("m/s", default=math.inf, above=0.0, endless=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fall < 0.0:
            object.__setattr__(self, "fall", self.ramp)
        if not any(self.force + self.moment):
            raise ConfigurationError("force and moment are both zero; expected one of them")
        if not self.end - self.start >= self.ramp + self.fall:
            raise ConfigurationError(
                f"end is {self.end:g} s; expected it after start {self.start:g} s and the ramps, "
                f"{self.ramp:g} s and {self.fall:g} s"
            )

    def exerted(self, t: float, sensor: SensorMotion) -> tuple[Array, Array]:
        """Return force and moment at the time ``t``."""
        share = self.share(t)
        force, moment, point = self._constants
        if self.frame == "tool":
            force, moment = sensor.R.dot(force), sensor.R.dot(moment)
        arm = sensor.R.dot(point)
        f, mu = at_point(self._left(force, sensor, arm) * share * force, arm)
        return f, mu + share * moment

    def _left(self, force: Array, sensor: SensorMotion, arm: Array) -> float:
        """Return the part of a force (3,) that is left where it acts on what moves."""
        if self.fastest == math.inf:
            return 1.0
        speed = float(force.dot(sensor.v + cross(sensor.omega, arm))) / max(norm(force), _LEAST)
        return max(0.0, 1.0 - speed / self.fastest)

    def share(self, t: float) -> float:
        """Return how much of it acts at the time ``t`` [s] where it is there, from 0 to 1."""
        rises, falls = t - self.start, self.end - t
        s = rises / self.ramp if rises < self.ramp else 1.0
        s = min(s, falls / self.fall) if falls < self.fall else s
        return s * s * (3.0 - 2.0 * s)

    @cached_property
    def _constants(self) -> tuple[Array, Array, Array]:
        return np.array(self.force), np.array(self.moment), np.array(self.point)
