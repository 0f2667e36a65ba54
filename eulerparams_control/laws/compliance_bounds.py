"""How far, and how fast, the compliant frame goes from the desired one.

Notation: ``x`` (3,) [m] p_c - p_d, or [rad] theta r of R_c R_d', ``v`` [m/s, rad/s] the velocity
of the compliant relative to the desired frame, both in the base frame.  Towards the bound X of
|x| the velocity is at most r (X - |x|): the bound is reached without overshoot, and v is
continuous.
"""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.limits import POSITION_RATE
from eulerparams_control.laws.rotations import Array, EulerParameters, exp, rotation_vector
from eulerparams_control.motion.frames import DesiredFrame


@dataclass(frozen=True)
class ComplianceBounds:
    """Bounds on the compliant relative to the desired frame.

    Attributes:
        position: [m] of the displacement.
        rotation: [rad] of the displacement; pi or more: none.
        speed: [m/s], and [rad/s], of the one relative to the other.

    Raises:
        ConfigurationError: if one is not positive.
    """

    position: float = math.inf
    rotation: float = math.inf
    speed: float = math.inf

    def __post_init__(self) -> None:
        for name in ("position", "rotation", "speed"):
            if not getattr(self, name) > 0:
                raise ConfigurationError(f"{name} is {getattr(self, name)}; expected > 0")

    def keep(
        self, frame: DesiredFrame, desired: DesiredFrame, before: DesiredFrame, v: Array, dt: float
    ) -> DesiredFrame:
        """Return the compliant frame within the bounds; itself where it is.

        Args:
            frame: the compliant frame as the impedance has it now.
            desired: the desired frame now.
            before: the compliant frame dt ago.
            v: (6,) of the compliant relative to the desired frame, dt ago.
            dt: positive [s].
        """
        x = frame.p_d - desired.p_d
        dp, now = frame.dp_d - desired.dp_d, frame
        kept = self._kept(x, dp, v[:3], self.position, dt)
        if kept is not dp:
            dp_c = desired.dp_d + kept
            p_c = before.p_d + dt / 2 * (before.dp_d + dp_c)
            now = now._replace(p_d=p_c, dp_d=dp_c, ddp_d=(dp_c - before.dp_d) / dt)
        omega = frame.omega_d - desired.omega_d
        if self.rotation >= math.pi and np.linalg.norm(omega) <= self.speed:
            return now
        most = self.rotation if self.rotation < math.pi else math.inf
        x = rotation_vector(EulerParameters.from_R(frame.R_d @ desired.R_d.T))
        kept = self._kept(x, omega, v[3:], most, dt)
        if kept is not omega:
            omega_c = desired.omega_d + kept
            R_c = exp(dt / 2 * (before.omega_d + omega_c)) @ before.R_d
            domega_c = (omega_c - before.omega_d) / dt
            now = now._replace(R_d=R_c, omega_d=omega_c, domega_d=domega_c)
        return now

    def _kept(self, x: Array, v: Array, v_before: Array, most: float, dt: float) -> Array:
        """Return the velocity v (3,) within the bounds at the displacement x (3,)."""
        rate = min(POSITION_RATE, 1 / dt)
        slower = rate * self.speed * dt  # by no more, where a bound was lowered
        size, distance = float(np.linalg.norm(v)), float(np.linalg.norm(x))
        fastest = max(self.speed, float(np.linalg.norm(v_before)) - slower)
        kept = v if size <= fastest else v * (fastest / size)
        if distance == 0:
            return kept
        away = x / distance
        allowed = max(rate * (most - distance), -self.speed, float(v_before @ away) - slower)
        excess = float(kept @ away) - allowed
        return kept - excess * away if excess > 0 else kept
