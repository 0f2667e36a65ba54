"""Joint friction over a step, stable however light the links are.

Friction acts with d(dq_k) throughout the step from t_k, so that a controller that adds
d(dq_k) to its effort cancels it exactly.  M being the joint-space inertia, this is stable
while dt dd/ddq <= 2 M.  Light links at a low rate, or under much Coulomb friction, break
that.  Then d(dq_k+1) acts, which is stable always: dq' being the velocity after the first
kind of step,

    M (dq_k+1 - dq') + dt (d(dq_k+1) - d(dq_k)) = 0.

Where the robot is at rest or moves evenly, both are the same.
"""

from collections.abc import Iterable

import numpy as np

from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.urdf import COULOMB_SPEED

# Instead of 2: some hundred configurations find three quarters of the steepest rate at least.
_STABLE = 1.5

# Newton's last step [rad/s]: the square of it is lost in rounding.  Three steps are usual; 30
# were the most in 20,000 systems at random.
_LAST_STEP = 1e-8
_STEPS = 100

# Of the function that Newton's method makes least, relative.
_ROUNDING = 1e-13


def is_stiff(friction: JointFriction, inertias: Iterable[Array], dt: float) -> bool:
    """Return whether d(dq_k) would be unstable at one of the inertias M, (n, n) each.

    Args:
        friction: of n joints.
        inertias: kg m^2.
        dt: length of a step, s.
    """
    slope = np.diag(_slope(friction, np.zeros_like(friction.viscous)))  # steepest at rest
    return any(np.linalg.eigvalsh(_STABLE * M - dt * slope)[0] < 0.0 for M in inertias)


def soften(friction: JointFriction, M: Array, dt: float, dq: Array, dq_after: Array) -> Array:
    """Return the velocity (n,) after a step under d(dq_k+1) instead of d(dq_k).

    Args:
        friction: of n joints.
        M: inertia before the step, kg m^2; (n, n).
        dt: length of the step, s.
        dq: dq_k, rad/s; (n,).
        dq_after: dq', the velocity after the step under d(dq_k), rad/s; (n,).
    """
    impulse = M @ dq_after + dt * friction.effort(dq)

    def convex(x: Array) -> float:
        """What is least at dq_k+1: its gradient is the balance of impulses."""
        return float(0.5 * x @ M @ x - impulse @ x + dt * _potential(friction, x))

    x = dq
    for _ in range(_STEPS):
        excess = M @ x + dt * friction.effort(x) - impulse
        step = np.linalg.solve(M + dt * np.diag(_slope(friction, x)), -excess)
        if np.abs(step).max() < _LAST_STEP:
            return x + step
        value = convex(x)
        while convex(x + step) > value + _ROUNDING * abs(value):
            step = 0.5 * step
        x = x + step
    return x


def _slope(friction: JointFriction, dq: Array) -> Array:
    """Return dd/ddq (n,), Nm s/rad."""
    fading = 1.0 - np.tanh(dq / COULOMB_SPEED) ** 2
    return friction.viscous + friction.coulomb / COULOMB_SPEED * fading


def _potential(friction: JointFriction, dq: Array) -> float:
    """Return the integral of d over dq, but for a constant, Nm rad/s."""
    x = dq / COULOMB_SPEED
    viscous = 0.5 * friction.viscous @ dq**2
    return float(viscous + COULOMB_SPEED * friction.coulomb @ np.logaddexp(x, -x))
