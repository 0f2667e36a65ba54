"""Maps of how moments turn the compliant frame.

A constant moment is applied to the compliance law at rest until it is at rest again.
"""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.lab.maps.base import MapKind, MapVariant
from eulerparams_control.laws.compliant_frame import ComplianceLaw, CompliantFrame
from eulerparams_control.laws.impedance_matrices import Impedance, damping_of_ratio
from eulerparams_control.laws.rotations import Array, log
from eulerparams_control.motion.frames import DesiredFrame
from sim_bridge.environment.keys import number, vector

_AT_REST = 0.02  # [rad/s]


@dataclass(frozen=True, kw_only=True)
class PressedMap(MapKind):
    """A compliant frame is pressed by a moment.

    Attributes:
        K_o: [Nm/rad] stiffness about the desired axes x, y, z.
        rate: [1/s] of the critically damped impedance about the softest axis.
        dt: [s] a step.
        duration: [s] after which it is at rest.
    """

    K_o: tuple[float, ...] = vector(default=(100.0, 100.0, 100.0))
    rate: float = number(default=20.0, above=0.0)
    dt: float = number(default=5e-3, above=0.0)
    duration: float = number(default=0.8, above=0.0)

    def law(self, variant: MapVariant) -> ComplianceLaw:
        """Return the compliance law."""
        K = np.diag(self.K_o)
        M = min(self.K_o) / self.rate**2 * np.eye(3)
        Z = Impedance(M, damping_of_ratio(M, K, 1.0), K)
        return ComplianceLaw(variant.representation, Z, Z)

    def turn(self, law: ComplianceLaw, R_d: Array, mu: Array) -> Array:
        """Return the rotation vector (3,) of R_d' R_c at rest under the moment mu, base frame.

        NaN if it does not come to rest.

        Raises:
            SingularityError: if the representation has no finite answer on the way.
        """
        desired, frame = DesiredFrame(np.zeros(3), R_d), CompliantFrame(law)
        wrench = np.concatenate((np.zeros(3), mu))
        for _ in range(round(self.duration / self.dt)):
            compliant = frame.step(self.dt, desired, wrench)
        if not np.abs(compliant.omega_d).max() < _AT_REST:
            return np.full(3, math.nan)
        return log(R_d.T @ compliant.R_d)
