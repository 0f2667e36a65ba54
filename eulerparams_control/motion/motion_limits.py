"""Limits of the motion of the tip: speed, acceleration and jerk, of its point and its turning."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eulerparams_control.laws.jit import Array, f8, jit


@dataclass(frozen=True)
class MotionLimits:
    """Limits of the Euclidean norms; infinite where there is none.

    Attributes:
        linear_speed, angular_speed: [m/s], [rad/s].
        linear_acceleration, angular_acceleration: [m/s^2], [rad/s^2].
        linear_jerk, angular_jerk: [m/s^3], [rad/s^3].
    """

    linear_speed: float = math.inf
    angular_speed: float = math.inf
    linear_acceleration: float = math.inf
    angular_acceleration: float = math.inf
    linear_jerk: float = math.inf
    angular_jerk: float = math.inf

    def slowdown(self, other: "MotionLimits") -> float:
        """Return the rate of time at which a motion within other limits is within these."""
        pairs = zip(self.by_derivative.tolist(), other.by_derivative.tolist(), strict=True)
        ratios = [
            (one / before) ** (1 / power)
            for power, (now, then) in enumerate(pairs, start=1)
            for one, before in zip(now, then, strict=True)
            if math.isfinite(one)
        ]
        return min(ratios, default=1.0)

    def approach(
        self, errors: tuple[float, float], rates: tuple[float, float]
    ) -> tuple[float, float]:
        """Return how fast [m/s], [rad/s] the tip may go to what is so far away, and stop there.

        The last part, a / k^2, is left to a law of the rate k, which has the speed k e: where the
        other, sqrt(2 a e - a^2 / k^2), is as fast and brakes as hard.

        Args:
            errors: e [m], [rad], how far away it is.
            rates: k [1/s].
        """
        (e_p, e_o), (k_p, k_o) = errors, rates
        return (
            approach(e_p, k_p, self.linear_speed, self.linear_acceleration),
            approach(e_o, k_o, self.angular_speed, self.angular_acceleration),
        )

    def stop_time(self, v: Array, omega: Array) -> float:
        """Return the time [s] in which the tip stops from v (3,) [m/s], omega (3,) [rad/s].

        From more than its speeds it takes no longer than from these.
        """
        return max(
            min(math.sqrt(one @ one), speed) / a if math.isfinite(a) else 0.0
            for one, speed, a in zip((v, omega), self.speeds, self.accelerations, strict=True)
        )

    @property
    def speeds(self) -> tuple[float, float]:
        """Of the point and of the turning."""
        return self.linear_speed, self.angular_speed

    @property
    def accelerations(self) -> tuple[float, float]:
        """Of the point and of the turning."""
        return self.linear_acceleration, self.angular_acceleration

    @property
    def jerks(self) -> tuple[float, float]:
        """Of the point and of the turning."""
        return self.linear_jerk, self.angular_jerk

    @cached_property
    def by_derivative(self) -> Array:
        """(3, 2) speeds, accelerations, jerks."""
        return np.array((self.speeds, self.accelerations, self.jerks), dtype=float)


@jit(f8(f8, f8, f8, f8))
def approach(e: float, k: float, speed: float, a: float) -> float:
    """Return how fast to go to what is e away; see :meth:`MotionLimits.approach`."""
    if not k * k * e > a:
        return speed
    return min(speed, math.sqrt(2.0 * a * e - a / k * (a / k)))
