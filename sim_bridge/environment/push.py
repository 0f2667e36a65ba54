"""A push of the tool for a while, as a hand would do it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.rotations import Array
from sim_bridge.environment.forces import Force, SensorMotion, at_point
from sim_bridge.environment.keys import ORIGIN, number, vector, word

FRAMES = ("base", "tool")
"""Whose axes a push keeps to: those of the base, or of the sensor frame, which turn."""


@dataclass(frozen=True, kw_only=True)
class Push(Force, shape="push"):
    """A force and a moment, constant but for how they begin and end.

    They rise over ``ramp`` from ``start`` on, and are gone at ``end`` after falling as long:
    with s from 0 to 1 along a ramp, by 3 s^2 - 2 s^3.

    Attributes:
        force: N; (3,).
        moment: Nm; (3,).
        frame: of whose axes force and moment are, one of ``FRAMES``.
        point: where the force acts, in the sensor frame, m; (3,).
        ramp: s.
    """

    force: tuple[float, ...] = vector("N", default=ORIGIN)
    moment: tuple[float, ...] = vector("Nm", default=ORIGIN)
    frame: str = word(default="base", choices=FRAMES)
    point: tuple[float, ...] = vector("m", default=ORIGIN)
    ramp: float = number("s", default=0.0, least=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.force + self.moment):
            raise ConfigurationError("force and moment are both zero; expected one of them")
        if not self.end - self.start >= 2.0 * self.ramp:
            raise ConfigurationError(
                f"end is {self.end:g} s; expected it after start {self.start:g} s and, of "
                f"{self.ramp:g} s each, two ramps"
            )

    def exerted(self, t: float, sensor: SensorMotion) -> tuple[Array, Array]:
        """Return force and moment at the time ``t``."""
        share = self.share(t)
        force, moment, point = self._constants
        if self.frame == "tool":
            force, moment = sensor.R.dot(force), sensor.R.dot(moment)
        f, mu = at_point(share * force, sensor.R.dot(point))
        return f, mu + share * moment

    def share(self, t: float) -> float:
        """Return how much of it acts at the time ``t`` [s] where it is there, from 0 to 1."""
        edge = min(t - self.start, self.end - t)
        s = edge / self.ramp if edge < self.ramp else 1.0
        return s * s * (3.0 - 2.0 * s)

    @cached_property
    def _constants(self) -> tuple[Array, Array, Array]:
        return np.array(self.force), np.array(self.moment), np.array(self.point)
