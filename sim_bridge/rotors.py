"""The rotors of the motors: their inertia, reflected to the joints, beside that of the links.

PyBullet knows none.  What drives the arm gives it in a step an impulse that moves the links alone
from dq to dq', B being their inertia; with the rotors I_r it moves them to dq_k+1:

    (B + I_r) (dq_k+1 - dq) = B (dq' - dq).

For efforts, weight and pushes this is the semi-implicit Euler step of (B + I_r) ddq.  What a
contact, or the stop of a joint, exerts within the step is that on the links alone.  Coupling of
the rotors by gears and their gyroscopic moments are left out.
"""

import numpy as np

from eulerparams_control.laws.rotations import Array


def with_rotors(B: Array, rotors: Array, dq: Array, dq_after: Array) -> Array:
    """Return the velocity (n,) [rad/s] after a step.

    Args:
        B: inertia of the links before it, kg m^2; (n, n).
        rotors: diagonal of I_r, kg m^2; (n,).
        dq, dq_after: before the step, and after it without rotors, rad/s; (n,).
    """
    change: Array = np.linalg.solve(B + np.diag(rotors), B @ (dq_after - dq))
    return dq + change
