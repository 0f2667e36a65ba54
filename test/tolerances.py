"""The tolerances of the tests, each with its reason; rad and SI units unless said."""

# --- equations -----------------------------------------------------------------------

# E1, algebraic: some ten products of numbers of order 1 leave 1e-15; three decades are
# kept for ill-conditioned samples.
ALGEBRAIC = 1e-12

# Step of the central differences: the truncation h^2 f'''/6 (2e-13) and the rounding
# 1e-16/h (1e-10) are both far below DIFFERENCES.
STEP = 1e-6

# E1, by differences: the floor of the central differences is about 1e-9 where
# derivatives of order 10 occur.
DIFFERENCES = 1e-8

# Relative error of a value that is computed without cancellation: 20 roundings of 2.2e-16.
RELATIVE = 5e-15

# Relative error of eta = gap / 2 at a gap of 1e-12 below pi, which the entries of R hold
# to 1e-16 only.
ETA_NEAR_PI = 1e-3

# A printed equation that is wrong by a transposition is wrong by this much at least, at
# angles between 30 and 150 deg: 2 sqrt(2) sin(30 deg) = 1.41 in the Frobenius norm.
PRINTED_FAILS = 1.0

# Relative error of T^-1 at 1e-5 rad from the pole: the rounding of 1e-16 over 1e-5, and
# two decades.
ILL_CONDITIONED = 1e-9

# (39), (41) evaluated exactly: accelerations of up to 1e4 at POLE_CLEARANCE, and their rounding.
ERROR_EQUATION = 1e-9

# Step of the second differences of fourth order: rounding 5e-16 / h^2 (5e-10), truncation
# h^4 x/90, where x reaches 1e6 at POLE_CLEARANCE (1e-8 at most).
SECOND_STEP = 1e-3
SECOND_DIFFERENCES = 1e-6

# Eq. (38) as printed is wrong by dphi_d - ddphi_d, of order 1 for random motions: this much at
# least, where the corrected one is right to ERROR_EQUATION.
WRONG_FEED_FORWARD = 0.1

# --- orientation errors --------------------------------------------------------------

# An error delta is first order in this small rotation; what it leaves out is of order
# SMALL_ROTATION^2, with a factor of up to 1 / sin(POLE_CLEARANCE)^2 for Euler angles.
SMALL_ROTATION = 1e-5
FIRST_ORDER = 1e-8

# Samples "away from the pole" keep this distance: third derivatives of the angles grow
# like 1/distance^3, and the differences must stay below DIFFERENCES.
POLE_CLEARANCE = 0.3

# A singular T or L that rounding keeps from being exactly singular has an entry of
# 1e-16 for a zero, so that its inverse exceeds this.
UNBOUNDED = 1e10

# Two velocities that differ by a property, not by rounding, differ by more than this
# (for gains and velocities of order 1).
DISTINCT = 1e-2

# asin is used for the distance to the pole; at 90 deg from it, asin has a vertical
# tangent and returns half of the digits.
ASIN = 1e-7

# --- statistics ----------------------------------------------------------------------

# A share of 4000 random pairs: the standard deviation is 0.8 %; this is four of them.
SHARE_OF_PAIRS = 0.032

# --- closed loops, steps of 1 ms ------------------------------------------------------

# E5: abs(eta - tanh(k t/2 + c)); the explicit step leaves 5e-4 at k = 10.
CLOSED_FORM = 1e-3

# E5: V_1 never increases by more than the rounding of 2 (1 - eta).
V_INCREASE = 1e-12

# E13: relative error of the rate at which Q1 is left (the explicit step leaves 0.3 %).
ESCAPE_RATE = 1e-2

# E13: travel is 360 deg minus the first error to this [deg].
LONG_WAY_DEG = 0.5

# E14: the travel of each of the ways to choose a sign, to this [deg].
TRAVEL_DEG = 1.0

# --- E2 -------------------------------------------------------------------------------

# Slope of log cond(J_A) over log delta.
SLOPE = 0.05

# Bound of cond(J) on the same path, m and rad.
COND_J = 10.0

# Residual [m, rad] of the inverse kinematics that finds a configuration of the path.
POSE_FOUND = 1e-12

# Values that a prototype gave and that are known to two or three digits.
SEEN = 0.02

# --- nodes ----------------------------------------------------------------------------

# The law (28) at a gain of 100 / s in steps of 10 ms: what is left of an error at rest, in
# m, rad and rad/s; it decays by half or to nothing in every tick.
LAW_IN_A_NODE = 1e-6

# The blend of a changed law lets go of 1 % of the difference in a tick of 1 ms (time
# constant 0.1 s); the difference is up to 1.5 times the speed, and the error itself decays
# by a few tenths of a percent.
BLEND_PER_TICK = 0.05

# 1.2 s later e^-12 of the difference is left; the law's angle is that of a step of 20 ms before,
# and the axes of a sequence of Euler angles are those of a rotation by a few degrees.
BLENDED = 0.06

# R -> xyzw -> R: some ten roundings, and the angle of two rotations that are 1e-16 apart.
THROUGH_A_QUATERNION = 1e-14

# The joint servo of the simulator at rest, rad and m.
SIMULATED_POSE = 1e-3

# --- robot and kinematic control ------------------------------------------------------

# Kinematics of a chain of ten transforms with entries of order 1.
KINEMATICS = 1e-13

# Efforts of up to 100 Nm from some hundred products along a chain of ten bodies.
DYNAMICS = 1e-11

# A degree-5 polynomial through given ends: its coefficients are up to 100 times as large
# as the ends, and J_r is inverted up to 175 deg.
THROUGH_POINTS = 1e-11

# Accelerations of a quintic by central differences: jerks of order 100 times STEP.
MOTION_DIFFERENCES = 1e-7

# A circle of 60 quintic arcs a turn between its points [m, rad]: the arcs are 6 deg long,
# and the error of the interpolation is arc^6 / 46080 = 3e-11 for a radius of 1.
BETWEEN_POINTS = 1e-9

# The same where a ramp changes the speed: derivatives of the ramp come into it.
RAMPED = 1e-7

# Rounding of a position that stops at its limit: (limit - q) / dt * dt + q.
LIMIT_ROUNDING = 1e-12

# Closed loops of gain k = 10 in steps of 1 ms, of the first error: the explicit step
# leaves k dt / (2 e) = 2e-3, and the curvature of the joint motion as much again.
CLOSED_LOOP = 5e-3

# E3, T1: orientation error [deg] and joint speed [rad/s] at most; the prototype had
# 2e-4 deg and 1.12 rad/s.
T1_DEG = 1e-3
T1_SPEED = 1.2

# A law replaced by another commands a velocity that is the same to rounding [rad/s].
NO_JUMP = 1e-10

# E6: the error of an open loop grows at least by this factor from first to last turn;
# that of the closed loop at most by the other.
OPEN_LOOP_GROWS = 5.0
CLOSED_LOOP_GROWS = 1.05

# The joint command is exact at its stamp [m, rad] when the controller holds a pose.
HELD = 1e-12

# Pose [m, rad] to which inverse_kinematics iterates.
REACHED = 1e-10

# Durations are rounded to a nanosecond: half of one, and the rounding of 1e6 s (1e-10).
NANOSECOND = 0.7e-9

# Residual of the inverse kinematics of an experiment's start, m.
REST = 1e-9

# --- dynamic control -------------------------------------------------------------------

# Accelerations of up to 10 through J^-1, J and B of condition 100: rounding and three decades.
NULL_SPACE = 1e-9

# A simulated second of the whole arm in RK4 steps of 2 ms against the closed form, m and rad:
# the truncation is 6e-10.
CLOSED_LOOP_DYNAMICS = 1e-8

# The same against an independent integration of (41), which is truncated too; the long way
# round is faster, and what is truncated is 2e-8.
INDEPENDENT_RUN = 1e-7

# E7: errors [deg], [mm] of an arm that is commanded at 1 kHz.
E7_DEG = 5e-3
E7_MM = 0.02

# Errors [mm], [deg] on a path with 1 kg that the model does not know, while the law is replaced
# every 30 ms: what the lower of the gains alone leave.
THROUGH_A_CHANGE_MM = 5.1
THROUGH_A_CHANGE_DEG = 0.37

# Change of the efforts [Nm] in a tick of 1 ms of that motion: 0.16 seen; 3, the rate, without a
# blend.
SMOOTH = 0.3

# An arm that is held for 1 s by what its model says of gravity, rad.
AT_REST = 1e-9

# dV_2 measured over a tick of 1 ms against the mean of (43), of its largest value: the effort is
# constant for a tick.
LYAPUNOV_SAMPLED = 0.02

# --- impedance -------------------------------------------------------------------------

# The roots of a polynomial of degree 6 that may be double: half of the digits, and one decade.
MODES = 1e-7

# Axes printed with 4 digits are off by half of the last one in each of three components.
AXES_OF_4_DIGITS = 1e-4

# Rate of a momentum of order 1 by central differences of 1e-5 s: the truncation is 1e-10 times
# its third derivative (of order 10), the rounding 1e-16 / 1e-5.
MOMENTUM = 1e-8

# A sine at the cut-off in steps of a thousandth of its period, held constant for a step: half of
# that, 2 pi / 2000, in phase, and as much in gain.
CUT_OFF = 5e-3

# Turn [rad] at which a stiffness is measured by central differences: the truncation is 1e-10 of
# it, the rounding 1e-16 / 1e-5 of the larger of mass and stiffness, with two decades to spare.
SMALL_TURN = 1e-5

# Moments and stiffnesses of up to 100 Nm/rad, by small turns or in ill-conditioned coordinates.
STIFFNESS = 1e-7

# Eigenvalues of such a stiffness at beta = 85 deg, where they differ by a factor of 500.
EIGENVALUES = 1e-5

# E15, E16: rest [rad/s] after 4 s at 10 1/s.
SETTLED = 1e-9

# E15, one turn by 30 deg instead of a moment [deg]: the elastic moment is away from the axis of
# K* by this much at least.
OFF_AXIS_DEG = {"relative_euler_angles": 2.0, "euler_angles": 15.0}

# (62) is wrong for Euler angles away from phi = 0 by this much at least, for 10 to 100 Nm/rad.
PRINTED_62_FAILS = 1.0

# E16 with 0.02 Nm: 0.8 mrad in the softest direction, 5 deg from the pole.
E16_SMALL = 2e-3

# Residual of the impedance equations [N, Nm] of up to 100 N; T is differentiated by differences.
IMPEDANCE_EQUATION = 1e-7

# Velocities and accelerations by differences of 4th order over 0.2 ms: what is truncated is below
# 1e-9; the wrench, which is linear between its samples, leaves dt^2 / 8 of its second derivative
# (1e3 / s^2).
COMPLIANT_RATES = 2e-5

# The same motion on frames that move differently, rad and m.
RELATIVE_MOTION = 1e-9

# The naive derivative of omega_c at 3 rad/s turns the frame by this much at least [deg].
NAIVE_DEG = 7.0

# (69) by Simpson's rule over 2 steps of 2 ms [J], of about 50 J.
ENERGY_BALANCE = 1e-7

# E18: relative error of the rates at which the equilibria of (67) are left.
ESCAPES = 5e-3

# The error of Runge-Kutta's method drops by 2^4 as the step is halved, but for higher orders.
OF_ORDER_4 = (12.0, 22.0)

# After half a second from 120 deg in steps of 1 ms [rad]: the prototype had 3e-11; Euler's method
# leaves 5e-4.
RUNGE_KUTTA = 1e-9
EULER_METHOD = (1e-4, 2e-3)

# Energy after 10 s without damping, relative.
ENERGY_KEPT = 1e-9

# Motion of mass, damper and spring of up to 30 1/s in steps of 1 ms [m].
STEP_RESPONSE = 1e-9

# Steps are divided so that a mode moves by half a time constant in each: what the method leaves
# of it, 0.5^5 / 120, adds up to this of the deflection.
FAST_MODES = 1e-3

# A velocity changes in a tick by no more than the accelerations before and after it say, but for
# their change within the tick.
BEYOND_A_STEP = 1.3

# E17: relative error of the moment after 1 s, of which modes at 10 1/s leave 1.4e-3.
E17_STATIC = 2e-3
E17_SEEN = 2e-3

# E19: relative error of the force with a spring.
E19_FORCE = 1e-3

# A force in contact 0.5 s after a change: what the slow pole of the impedance leaves.
BY_CONTACT = 0.02

# A wrench [N, Nm] to the axes of the tip and back.
AT_POINT_WRENCH = 1e-12

# Force [N] of a tool of 2 kg at up to 2 m/s^2, whose inertia is taken out with the acceleration
# that was commanded: the motion loop leaves 1e-2 m/s^2 of it, the step of the simulator as much.
INERTIAL_FORCE = 0.1

# dV_3 over a tick of 1 ms against the mean of (69) at both ends, of its largest value: what the
# trapezium leaves is dt^2 / 12 of its second derivative (4e3).
V_3_SAMPLED = 5e-4

GUARD_ROUNDING = 2e-12
"""[rad, Nm] The guard of the commands allows this beyond a step, for the rounding of the laws."""
