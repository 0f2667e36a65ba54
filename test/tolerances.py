"""The tolerances of the tests, each with its reason; rad and SI units unless said."""

import numpy as np
from numpy.typing import ArrayLike

# --- rounding -------------------------------------------------------------------------
# Relative error of a value that is computed without cancellation: 20 roundings of 2.2e-16.
RELATIVE = 5e-15
# R -> xyzw -> R: some ten roundings, and the angle of two rotations that are 1e-16 apart.
THROUGH_A_QUATERNION = 1e-14
# Kinematics of a chain of ten transforms with entries of order 1.
KINEMATICS = 1e-13
# Some ten products of numbers of order 1 leave 1e-15; three decades for ill-conditioned samples.
# Also a position that stops at its limit; a pose that is held; a wrench
# [N, Nm] to the axes of the tip and back.
ALGEBRAIC = LIMIT_ROUNDING = HELD = AT_POINT_WRENCH = 1e-12
# [rad, Nm] The guard of the commands allows this beyond a step, for the rounding of the laws.
GUARD_ROUNDING = 2e-12
# A polynomial of degree 5 through given ends, with coefficients of 100, and J_r up to 175 deg.
THROUGH_POINTS = 1e-11
# A law replaced by another commands the same velocity [rad/s]; the pose of inverse_kinematics.
NO_JUMP = REACHED = 1e-10
# Accelerations of up to 1e4 through T^-1 at POLE_CLEARANCE, or J^-1 and B of condition 100; the
# relative error of T^-1 at 1e-5 rad from the pole, the rounding of 1e-16 over 1e-5.
ERROR_EQUATION = NULL_SPACE = 1e-9
# The start of an experiment [m].
REST = 1e-9
# Durations are rounded to a nanosecond: half of one, and the rounding of 1e6 s (1e-10).
NANOSECOND = 0.7e-9
# asin at 90 deg from the pole has a vertical tangent and returns half of the digits; so do the
# roots of a polynomial of degree 6 that may be double.
ASIN = MODES = 1e-7
# Relative error of eta = gap / 2 at a gap of 1e-12 below pi; the entries of R hold it to 1e-16.
ETA_NEAR_PI = 1e-3

# --- differences ----------------------------------------------------------------------
# Step of the central differences: truncation h^2 f'''/6 (2e-13) and rounding 1e-16/h (1e-10) are
# both far below DIFFERENCES, the floor where derivatives of order 10 occur.
STEP, DIFFERENCES = 1e-6, 1e-8
# Samples "away from the pole": third derivatives of the angles grow like 1/distance^3.
POLE_CLEARANCE = 0.3
# Slopes [N, Nm] of energies of up to 1 J: rounding 1e-16 / STEP, truncation STEP^2 times third
# derivatives of up to 1e5 where a spring is clipped.
GRADIENT = 1e-6
# Accelerations of a quintic: jerks of order 100 times STEP.
MOTION_DIFFERENCES = 1e-7
# Rate of a momentum of order 1 in steps of 1e-5 s: the third derivative is of order 10.
MOMENTUM = 1e-8
# An elastic moment of stiffnesses of up to 100 Nm/rad [Nm].
STIFFNESS = 1e-7
# Residual [N, Nm] of impedance equations of up to 100 N; T is differentiated by differences.
IMPEDANCE_EQUATION = 1e-7
# Velocities and accelerations over 0.2 ms: the wrench, which is linear between its samples, leaves
# dt^2 / 8 of its second derivative (1e3 / s^2).
COMPLIANT_RATES = 2e-5

# --- properties, not rounding ---------------------------------------------------------
# A singular T or L that rounding keeps from being exactly singular has an inverse beyond this.
UNBOUNDED = 1e10
# Two velocities that differ by a property differ by more (gains and velocities of order 1).
DISTINCT = 1e-2
# Axes printed with 4 digits are off by half of the last one in each of three components.
AXES_OF_4_DIGITS = 1e-4
# A velocity changes in a tick by what the accelerations before and after it say, and their change.
BEYOND_A_STEP = 1.3

# --- integration: steps of 1 ms unless said -------------------------------------------
# Closed loops of gain k = 10, of the first error: the explicit step leaves k dt / (2 e) = 2e-3,
# and the curvature of the joint motion as much again.
CLOSED_LOOP = 5e-3
# Errors of any robot of the catalogue, commanded at 500 Hz.
ROBOTS_DEG, ROBOTS_MM = 0.02, 0.05
# dV_3 over a tick against the mean of (69) at its ends, of its largest value: the trapezium leaves
# dt^2 / 12 of the second derivative (4e3).
V_3_SAMPLED = 5e-4
# Poles of a free arm by differences of its accelerations, whose rounding is 1e-13 / STEP.
DAMPING_RATIO = 1e-4
# The error of Runge-Kutta's method drops by 2^4 as the step is halved, but for higher orders.
OF_ORDER_4 = (12.0, 22.0)
# Steps are divided so that a mode moves by half a time constant in each: the method leaves
# 0.5^5 / 120, which adds up to this of the deflection.
FAST_MODES = 1e-3
# A circle of 60 quintic arcs a turn between its points: arc^6 / 46080 = 3e-11 for a radius of 1;
# where a ramp changes the speed, its derivatives come into it.
RAMPED = 1e-7

# --- contact and nodes ----------------------------------------------------------------
# What a spring of 1000 N/m exerts on a wall of 2e4 N/m after 10 s [N]; a pose at rest after it.
FORCE_IN_CONTACT = 1e-3
# The law (28) at 100 / s in steps of 10 ms: what is left of an error at rest; it decays by half
# or to nothing in every tick.
LAW_IN_A_NODE = 1e-6
# The joint servo of the simulator at rest, rad and m.
SIMULATED_POSE = 1e-3


def assert_close(found: ArrayLike, expected: ArrayLike, atol: float = ALGEBRAIC) -> None:
    """Assert that no entry is off by more than atol."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)
