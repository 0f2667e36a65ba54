"""Elastic wrench of compliance control: springs between the tip and the desired frame, clipped.

Notation: ``dp_de`` (3,) [m] p_d - p_e, ``K_p, K_o`` (3, 3) stiffness, ``F`` a factor of a stiffness
F F', in whose metric a displacement has the size s = sqrt(2 energy); base frame.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array, dot, norm
from eulerparams_control.motion.frames import DesiredFrame

# An axis that is softer is damped as if it had this stiffness [N/m], [Nm/rad].
_LEAST_K_p, _LEAST_K_o = 10.0, 0.5

# Part of what the springs hold within their clip that may be fed forward, and the part of a force
# that may be along axes without stiffness.
_HELD_SHARE, _NULL_STIFFNESS = 0.9, 1e-6

_TINY = 1e-12


class SpringWrench(NamedTuple):
    """The elastic wrench at a displacement."""

    f: Array  # (3,) [N] on the tip: minus the gradient of the energy
    mu: Array  # (3,) [Nm]
    energy: float  # [J] of the clipped springs
    stretch: float  # of the more stretched one; 1 where it is clipped
    F: Array  # (6, 6) of the stiffness F F' that is damped there


class Elasticity:
    """Springs between the tip and the desired frame.

    Args:
        K_p, K_o: (3, 3) stiffness [N/m], [Nm/rad], symmetric, positive semidefinite.
        clip_position, clip_rotation: [m], [rad] of displacement along the stiffest axis from which
            the spring pulls no more; along one of the stiffness k it is sqrt(k_max / k) as far.
        frame: whose axes K_p refers to, "base" or "desired".

    Attributes:
        clips: (2,) of both springs, in the metric of their stiffness.

    Raises:
        ConfigurationError: if a matrix is impossible, or the representation has no impedance.
    """

    def __init__(
        self,
        orientation: OrientationRepresentation,
        K_p: Array,
        K_o: Array,
        clip_position: float = math.inf,
        clip_rotation: float = math.inf,
        frame: str = "base",
    ) -> None:
        _, stiff_p, clip_p = _spring("K_p", K_p, _LEAST_K_p, clip_position)
        rotation, stiff_o, clip_o = _spring("K_o", K_o, _LEAST_K_o, clip_rotation)
        self.orientation, self.K_p, self.K_o, self.frame = orientation, K_p, K_o, frame
        self.clip_position, self.clip_rotation = clip_position, clip_rotation
        self.clips = np.array((clip_p, clip_o))
        # [Nm] twice that of the rotation vector; next to a pole Euler angles ask for any moment
        self._most_moment = 2.0 * clip_o * math.sqrt(float(np.linalg.eigvalsh(stiff_o.K)[-1]))
        self._K_x = orientation.impedance(rotation).K
        self._F_p = np.linalg.cholesky(stiff_p.K)
        self._F_x = np.linalg.cholesky(orientation.impedance(stiff_o).K)

    def wrench(
        self, p_e: Array, R_e: Array, desired: DesiredFrame, clip_share: float = 1.0
    ) -> SpringWrench:
        """Return the wrench on a tip, clips being at the part ``clip_share`` of the stated ones."""
        R_d, dp_de, F = desired.R_d, desired.p_d - p_e, np.zeros((6, 6))  # (21)
        f = self.stiffness(R_d) @ dp_de
        turned = self.orientation.spring(R_d, R_e, self._K_x)  # (56), (60), (66)
        mu = self.orientation.finite(turned.moment)
        clip_p, clip_o = (clip_share * self.clips).tolist()
        share_p, stretch_p, U_p = clipped(dot(f, dp_de) / 2.0, clip_p)
        share_o, stretch_o, U_o = clipped(turned.energy, clip_o)
        most = clip_share * self._most_moment
        share_o *= min(1.0, most / max(share_o * norm(mu), _TINY))
        F[:3, :3] = self._F_p if self.frame == "base" else R_d @ self._F_p
        F[3:, 3:] = turned.axes @ self._F_x
        return SpringWrench(share_p * f, share_o * mu, U_p + U_o, max(stretch_p, stretch_o), F)

    def stiffness(self, R_d: Array) -> Array:
        """Return K_p (3, 3) [N/m] in the base frame, where the desired orientation is R_d."""
        return self.K_p if self.frame == "base" else R_d @ self.K_p @ R_d.T

    def refuse_force(self, force: Array, R_d: Array) -> None:
        """Raise ConfigurationError for a force (3,) [N], base frame, beyond what springs hold."""
        K, size = self.stiffness(R_d), norm(force)
        x = np.linalg.pinv(K) @ force
        is_held = norm(K @ x - force) < _TINY + _NULL_STIFFNESS * size
        stretched = math.sqrt(max(float(x @ force), _TINY**2))  # in the metric of K_p
        most = _HELD_SHARE * float(self.clips[0]) / stretched if is_held else 0.0
        if most < 1.0:
            raise ConfigurationError(
                f"the springs do not hold {size:.3g} N along {np.round(force / size, 3).tolist()} "
                f"(base frame) where there is no contact; expected at most "
                f"{size * most:.3g} N, {_HELD_SHARE:g} of what they hold at "
                "error_clip_position"
            )


def clipped(energy: float, clip: float) -> tuple[float, float, float]:
    """Return the part of a spring's pull that its clip leaves, its stretch, and its energy [J].

    s = sqrt(2 energy) is the size of the displacement in the metric of the stiffness.  Up to the
    clip the energy is s^2 / 2, beyond it clip s - clip^2 / 2, whose gradient is clip / s as large.
    """
    if not energy > 0.0:
        return 1.0, 0.0, energy
    s = math.sqrt(2.0 * energy)
    if s > clip:
        return clip / s, s / clip if clip > 0.0 else math.inf, clip * s - clip * clip / 2.0
    return 1.0, s / clip, energy


def _spring(name: str, K: Array, least: float, clip: float) -> tuple[Impedance, Impedance, float]:
    """Return the impedance of K alone, that with no softer axis, and the clip in its metric."""
    try:
        spring = Impedance(np.eye(3), np.zeros((3, 3)), K)
    except ConfigurationError as error:
        raise ConfigurationError(f"{name}: {error}") from error
    values, axes = np.linalg.eigh(K)
    raised = replace(spring, K=(axes * np.maximum(values, least)) @ axes.T)
    stiffest = float(values[-1])
    return spring, raised, clip * math.sqrt(stiffest) if stiffest > 0 else 0.0
