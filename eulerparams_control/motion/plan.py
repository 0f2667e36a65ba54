"""Plans: motions of least time within the limits of the tip, from one state to another.

The position and the rotation vector x of R = R_0 exp(x), about the orientation R_0 at the start,
are planned together by Ruckig (Berscheid and Kroeger, "Jerk-limited Real-time Trajectory
Generation with Arbitrary Target States", 2021): they end at the same time.  Ruckig bounds each
axis by itself, so the first axis is laid along the way that is to go, and gets all that the state
leaves of the norm.  From rest to rest that is the straight line and the geodesic, in the shortest
time.
"""

import math
from collections.abc import Callable

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError
from ruckig import Trajectory as Profile

from eulerparams_control.laws.jit import (
    Array,
    b1,
    f8,
    jit,
    matrix,
    new_matrix,
    new_vector,
    types,
    vector,
)
from eulerparams_control.laws.rotations import body_rates, cross, norm, turn, turn_back
from eulerparams_control.motion.frames import DesiredFrame, finite, six_arrays
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.trajectories import perpendicular, rotation_vector_at_end, turned

Sample = Callable[[float], DesiredFrame]

# A state whose parts across the way are below this part of their limit goes straight.
_STRAIGHT = 1e-3

# What the axes across the way get of the limits: of a straight way, and else of what is left.
_LEAST, _ACROSS = 0.01, 0.15

# Number of places at which a plan is checked, and the part by which it may exceed its limits; else
# it takes longer, by this factor at least, within this number of trials.
_PLACES, _TOLERANCE, _LONGER, _TRIALS = 24, 0.01, 1.1, 8

# Of the acceleration a plan takes this part: a law of finite rate adds to it where it changes.  A
# limit that is infinite, for a library that wants numbers.
_OF_ACCELERATION, _MOST = 0.97, 1e6

# Least factor between the times after which a motion is joined, and the largest number of trials.
_LATER, _JOINS = 1.25, 30

# Further trials to join it sooner: so the tip gets nearer whenever one motion replaces another.
_CLOSER = 4

# A way [m, rad] that is shorter, or a speed that is less [m/s, rad/s], has no direction.
_NOWHERE = 1e-12


class Plan:
    """A motion from one state of the tip to another; then it goes on as it ended.

    Attributes:
        duration: [s].
    """

    def __init__(self, start: DesiredFrame, A: Array, B: Array, profile: Profile) -> None:
        self._begin, self._profile = (start.p_d, start.R_d, A, B), profile
        self.duration: float = profile.duration

    def sample(self, t: float) -> DesiredFrame:
        """Return the frame at t [s] after the start."""
        state = np.array(self._profile.at_time(max(t, 0.0)))
        return finite(DesiredFrame(*_along(*self._begin, state)))


@jit(six_arrays(vector, matrix, matrix, matrix, matrix))
def _along(p: Array, R: Array, A: Array, B: Array, state: Array) -> tuple[Array, ...]:
    """Return the frame of a plan that began at p and R.

    Args:
        p, R: (3,), (3, 3).
        A, B: (3, 3) whose columns are the axes of the position, and of the rotation vector x.
        state: (3, 6) on these axes: both, their rates, their accelerations.
    """
    way, dp, ddp = turn(A, state[0, :3]), turn(A, state[1, :3]), turn(A, state[2, :3])
    x, dx, ddx = turn(B, state[0, 3:]), turn(B, state[1, 3:]), turn(B, state[2, 3:])
    R, omega, domega = turned(R, x, dx, ddx)
    return p + way, R, dp, omega, ddp, domega


def reach(start: DesiredFrame, end: DesiredFrame, limits: MotionLimits, least: float = 0.0) -> Plan:
    """Return the plan from one state to another, in no less than ``least`` [s]."""
    return _planned(start, end, limits, least, ControlInterface.Position)


def attain(start: DesiredFrame, twist: Array, limits: MotionLimits) -> Plan:
    """Return the plan from a state to a constant twist (6,) [m/s, rad/s]; 0 is to brake."""
    end = bounded(DesiredFrame(start.p_d, start.R_d, twist[:3], twist[3:]), limits)
    return _planned(start, end, limits, 0.0, ControlInterface.Velocity)


def bounded(frame: DesiredFrame, limits: MotionLimits) -> DesiredFrame:
    """Return the frame with a twist, and no acceleration, within the limits."""
    dp_d, omega_d = (
        v if (speed := math.sqrt(v @ v)) <= most else most / speed * v
        for v, most in zip((frame.dp_d, frame.omega_d), limits.speeds, strict=True)
    )
    return DesiredFrame(frame.p_d, frame.R_d, dp_d, omega_d)


def join(start: DesiredFrame, motion: Sample, t: float, limits: MotionLimits, least: float) -> Plan:
    """Return the plan that meets a motion, which goes on meanwhile, as soon as it can.

    Args:
        start: the state.
        motion: that is to be met, as a function of its time [s].
        t: its time [s] now.
        limits: of the tip.
        least: [s] the plan takes at least.
    """
    T, too_short = least, 0.0
    for _ in range(_JOINS):
        plan = reach(start, motion(t + T), limits, T)
        if _meets(plan, T):
            break
        too_short, T = T, max(plan.duration, _LATER * T)
    for _ in range(_CLOSER if too_short else 0):
        middle = (too_short + T) / 2
        sooner = reach(start, motion(t + middle), limits, middle)
        if _meets(sooner, middle):
            plan, T = sooner, middle
        else:
            too_short = middle
    return plan


def _meets(plan: Plan, T: float) -> bool:
    return plan.duration <= T * (1 + 1e-9) + 1e-9


@jit(new_matrix(vector, vector, vector, b1))
def _axes(way: Array, v_0: Array, v_1: Array, by_velocity: bool) -> Array:
    """Return three axes as columns (3, 3), the first along the way, or else along the velocity."""
    d = v_1 - v_0 if by_velocity else way
    if not norm(d) > _NOWHERE:
        d = v_0 if norm(v_0) > 0.0 else v_1
    if not norm(d) > _NOWHERE:
        return np.eye(3)
    A = np.empty((3, 3))
    A[:, 0] = d / norm(d)
    A[:, 1] = perpendicular(A[:, 0])
    A[:, 2] = cross(A[:, 0], A[:, 1])
    return A


@jit(new_vector(vector, f8, b1))
def _shared(taken: Array, most: float, is_straight: bool) -> Array:
    """Return the bounds of each axis, together about ``most``, that leave what is taken (3,)."""
    if is_straight:
        return most * np.array([1.0, _LEAST, _LEAST])
    squares = (taken / most) ** 2
    left = max(0.0, 1.0 - squares.sum())
    shares = squares + left * np.array([1.0 - 2.0 * _ACROSS, _ACROSS, _ACROSS])
    return most * np.maximum(np.sqrt(shares), _ACROSS)


@jit(types.Tuple((new_matrix, b1))(matrix, vector, vector, vector, vector, vector, vector))
def _half(
    A: Array, v_0: Array, a_0: Array, x_1: Array, v_1: Array, a_1: Array, most: Array
) -> tuple[Array, bool]:
    """Return half of a problem, of the position or of x, and whether all is along the first axis.

    Args:
        A: (3, 3) whose columns are the axes.
        v_0, a_0: (3,) velocity and acceleration at the start.
        x_1, v_1, a_1: (3,) way, velocity and acceleration at the end.
        most: (3,) speed, acceleration and jerk.

    Returns:
        (8, 3) the same five on the axes, and the largest speed, acceleration and jerk of each.
    """
    found = np.empty((8, 3))
    found[0], found[1] = turn_back(A, v_0), turn_back(A, a_0)
    found[2], found[3], found[4] = turn_back(A, x_1), turn_back(A, v_1), turn_back(A, a_1)
    speed, acceleration = min(most[0], _MOST), _OF_ACCELERATION * min(most[1], _MOST)
    v = np.maximum(np.abs(found[0]), np.abs(found[3]))
    a = np.maximum(np.abs(found[1]), np.abs(found[4]))
    across = max(max(v[1], v[2]) / speed, max(a[1], a[2]) / acceleration)
    is_straight = across < _STRAIGHT
    found[5] = _shared(v, speed, is_straight)
    found[6] = _shared(a, acceleration, is_straight)
    found[7] = _shared(np.zeros(3), min(most[2], _MOST), is_straight)
    return found, is_straight


def _planned(
    start: DesiredFrame,
    end: DesiredFrame,
    limits: MotionLimits,
    least: float,
    interface: ControlInterface,
) -> Plan:
    by_velocity = interface is ControlInterface.Velocity
    R, way = start.R_d, end.p_d - start.p_d
    x, dx, ddx = rotation_vector_at_end(R, end.R_d, end.omega_d, end.domega_d)
    omega, domega = turn_back(R, start.omega_d), turn_back(R, start.domega_d)  # J_r is 1 there
    A, B = _axes(way, start.dp_d, end.dp_d, by_velocity), _axes(x, omega, dx, by_velocity)
    most_p, most_x = limits.by_derivative.T
    p_half, p_is_straight = _half(A, start.dp_d, start.ddp_d, way, end.dp_d, end.ddp_d, most_p)
    x_half, x_is_straight = _half(B, omega, domega, x, dx, ddx, most_x)
    asked = InputParameter(6)
    (
        asked.current_velocity,
        asked.current_acceleration,
        asked.target_position,
        asked.target_velocity,
        asked.target_acceleration,
        asked.max_velocity,
        asked.max_acceleration,
        asked.max_jerk,
    ) = np.concatenate((p_half, x_half), axis=1).tolist()
    asked.current_position = [0.0] * 6
    asked.control_interface = interface
    profile, T = Profile(6), least
    for _ in range(_TRIALS):
        if T > 0:
            asked.minimum_duration = T
        _solve(asked, profile)
        plan = Plan(start, A, B, profile)
        if p_is_straight and x_is_straight:
            break
        excess = _excess(profile, limits)
        if excess <= 1 + _TOLERANCE:
            break
        T = profile.duration * max(_LONGER, min(excess, 2.0))
    return plan


def _solve(problem: InputParameter, profile: Profile) -> None:
    """Solve a problem; where its end cannot be met with its acceleration, without one."""
    solver = Ruckig(6)
    for end in ("target_acceleration", "target_velocity", "minimum_duration"):
        try:
            if solver.calculate(problem, profile) in (Result.Working, Result.Finished):
                return
        except (RuckigError, ValueError):  # it is impossible, or has no name in Python
            pass
        setattr(problem, end, None if end == "minimum_duration" else [0.0] * 6)
    problem.control_interface = ControlInterface.Velocity  # at least it brakes
    solver.calculate(problem, profile)


def _excess(profile: Profile, limits: MotionLimits) -> float:
    """Return by how much the norms along a plan exceed their limits, 1 being not at all.

    What the plan begins with is given.
    """
    times = np.linspace(0.0, profile.duration, _PLACES).tolist()
    norms = _rates(np.array([profile.at_time(t) for t in times]))
    most = np.maximum(limits.by_derivative[:2].ravel(), norms[0])
    return float((norms / most).max())


@jit(new_matrix(types.Array(f8, 3, "A", readonly=True)))
def _rates(states: Array) -> Array:
    """Return |dp|, |omega|, |ddp|, |domega| (N, 4) of states (N, 3, 6): see ``_along``."""
    norms = np.empty((len(states), 4))
    for n in range(len(states)):
        value, rate, acceleration = states[n, 0], states[n, 1], states[n, 2]
        omega, domega = body_rates(value[3:], rate[3:], acceleration[3:])
        norms[n, 0], norms[n, 1] = norm(rate[:3]), norm(omega)
        norms[n, 2], norms[n, 3] = norm(acceleration[:3]), norm(domega)
    return norms
