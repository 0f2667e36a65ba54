"""What the impedance equations (52), (55), (59) relate: motion and wrench at one point.

That point is the centre of compliance of the node impedance_control, which may be off the tip.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.analysis.compliant import CompliantMotion
from eulerparams_control.analysis.impedances import centre_of_compliance, impedance_node
from eulerparams_control.analysis.series import Series
from eulerparams_control.analysis.wrenches import Wrenches
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.rotations_batch import turn_back


class ImpedanceRun(NamedTuple):
    """An impedance at work, at N instants.

    Attributes:
        motion: of the compliant and the desired frame at the centre of compliance.
        f: (N, 3) [N] contact force, base axes; 0 if no wrench is known.
        mu: (N, 3) [Nm] contact moment about the centre, base axes; 0 if no wrench is known.
    """

    motion: CompliantMotion
    f: Array
    mu: Array

    @property
    def f_d(self) -> Array:
        """(N, 3) [N] f in the desired frame; NaN where there is none."""
        return self._in_desired(self.f)

    @property
    def mu_d(self) -> Array:
        """(N, 3) [Nm] mu in the desired frame; NaN where there is none."""
        return self._in_desired(self.mu)

    def _in_desired(self, vectors: Array) -> Array:
        return turn_back(self.motion.desired.R, vectors)


def impedance_run(
    compliant: CompliantMotion,
    wrench: Wrenches | None,
    measured: Series,
    parameters: Mapping[str, Mapping[str, Any]],
) -> ImpedanceRun:
    """Return motion and wrench at the centre of compliance.

    Args:
        compliant: the compliant frame of the tip.
        wrench: at the tip; None if it is not known.
        measured: motion of the arm; its last state before each instant counts.
        parameters: of the recorded nodes, by node and name.

    Raises:
        BagError: if the parameters are impossible.
    """
    centre = centre_of_compliance(impedance_node(parameters) or {}, measured.robot)
    motion = compliant.carrying(centre)
    if wrench is None:
        return ImpedanceRun(motion, np.zeros((len(motion.t), 3)), np.zeros((len(motion.t), 3)))
    f, mu = wrench.at(compliant.t)
    before = np.maximum(np.searchsorted(measured.t, compliant.t, side="right") - 1, 0)
    r = measured.R_e[before] @ centre.p
    return ImpedanceRun(motion, f, mu - np.cross(r, f))
