"""A push of the tool for a while, as a hand would do it."""

import math
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
    with s from 0 to 1 along a ramp, by 3 s^2 - 2 s^3.  Without a ramp they act in the steps
    from t_k on with start <= t_k < end.

    Attributes:
        force: N; (3,).
        moment: Nm; (3,).
        frame: of whose axes force and moment are, one of ``FRAMES``.
        point: where the force acts, in the sensor frame, m; (3,).
        start, end: s; an infinite end is none.
        ramp: s.
    """

    force: tuple[float, ...] = vector("N", default=ORIGIN)
    moment: tuple[float, ...] = vector("Nm", default=ORIGIN)
    frame: str = word(default="base", choices=FRAMES)
    point: tuple[float, ...] = vector("m", default=ORIGIN)
    start: float = number("s", default=0.0, least=0.0)
    end: float = number("s", default=math.inf, least=0.0, endless=True)
    ramp: float = number("s", default=0.0, least=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.force + self.moment):
            raise ConfigurationError("force and moment are both zero; expected one of them")
        if not self.end - self.start >= max(2.0 * self.ramp, math.ulp(0.0)):
            raise ConfigurationError(
                f"end is {self.end:g} s; expected it after start {self.start:g} s and, of "
                f"{self.ramp:g} s each, two ramps"
            )

    def exerted(self, t: float, sensor: SensorMotion) -> tuple[Array, Array]:
        """Return force and moment at the time ``t``."""
        share = self.share(t)
        if share == 0.0:
            return np.zeros(3), np.zeros(3)
        force, moment, point = self._constants
        if self.frame == "tool":
            force, moment = sensor.R.dot(force), sensor.R.dot(moment)
        f, mu = at_point(share * force, sensor.R.dot(point))
        return f, mu + share * moment

    def share(self, t: float) -> float:
        """Return how much of it acts at the time ``t`` [s], from 0 to 1."""
        if not self.start <= t < self.end:
            return 0.0
        edge = min(t - self.start, self.end - t)
        s = edge / self.ramp if edge < self.ramp else 1.0
        return s * s * (3.0 - 2.0 * s)

    @cached_property
    def _constants(self) -> tuple[Array, Array, Array]:
        return np.array(self.force), np.array(self.moment), np.array(self.point)
