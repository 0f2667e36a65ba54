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
from typing import NamedTuple

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError
from ruckig import Trajectory as Profile

from eulerparams_control.laws.rotations import Array, body_rates, cross, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.trajectories import rotation_vector_at_end

Sample = Callable[[float], DesiredFrame]

# A state whose parts across the way are below this part of their limit goes straight.
_STRAIGHT = 1e-3

# What the axes across the way get of the limits: of a straight way, and else of what is left.
_LEAST, _ACROSS = 0.01, 0.15

# A plan is looked at in so many places; beyond its limits by this part it takes longer.
_PLACES, _TOLERANCE, _LONGER, _TRIALS = 24, 0.01, 1.1, 8

# Of the acceleration a plan takes this part: a law of finite rate adds to it where it changes.
_OF_ACCELERATION = 0.97

# A limit that is infinite, for a library that wants numbers.
_MOST = 1e6

# A motion is joined after times that grow by this factor, at most so often.
_LATER, _JOINS = 1.25, 30


class Plan:
    """A motion from one state of the tip to another; then it goes on as it ended.

    Attributes:
        duration: [s].
    """

    def __init__(self, start: DesiredFrame, axes: tuple[Array, Array], profile: Profile) -> None:
        self._p, self._R = start.p_d, start.R_d
        self._axes, self._profile = axes, profile
        self.duration: float = profile.duration

    def sample(self, t: float) -> DesiredFrame:
        """Return the frame at t [s] after the start."""
        rows = np.array(self._profile.at_time(max(t, 0.0)))  # value, rate, acceleration
        A, B = self._axes
        (p, v, a), (x, dx, ddx) = rows[:, :3] @ A.T, rows[:, 3:] @ B.T
        omega, domega = body_rates(x, dx, ddx)
        R = self._R @ exp(x)
        return DesiredFrame(self._p + p, R, v, R @ omega, a, R @ domega)


def reach(start: DesiredFrame, end: DesiredFrame, limits: MotionLimits, least: float = 0.0) -> Plan:
    """Return the plan from one state to another, in no less than ``least`` [s]."""
    begin = _begin(start)
    ends = ((end.p_d - start.p_d, end.dp_d, end.ddp_d), rotation_vector_at_end(start, end))
    return _planned(start, begin, ends, limits, least, ControlInterface.Position)


def attain(start: DesiredFrame, twist: Array, limits: MotionLimits) -> Plan:
    """Return the plan from a state to a constant twist (6,) [m/s, rad/s]; 0 is to brake."""
    zero, v = np.zeros(3), []
    for part, most in zip((twist[:3], twist[3:]), limits.speeds, strict=True):
        speed = math.sqrt(part @ part)
        v.append(part if speed <= most else most / speed * part)
    ends = (zero, v[0], zero), (zero, start.R_d.T @ v[1], zero)
    return _planned(start, _begin(start), ends, limits, 0.0, ControlInterface.Velocity)


def join(start: DesiredFrame, motion: Sample, t: float, limits: MotionLimits, least: float) -> Plan:
    """Return the plan that meets a motion, which goes on meanwhile, as soon as it can.

    Args:
        start: the state.
        motion: that is to be met, as a function of its time [s].
        t: its time [s] now.
        limits: of the tip.
        least: [s] the plan takes at least.
    """
    T = least
    for _ in range(_JOINS):
        plan = reach(start, motion(t + T), limits, T)
        if plan.duration <= T * (1 + 1e-9) + 1e-9:
            break
        T = max(plan.duration, _LATER * T)
    return plan


def _begin(start: DesiredFrame) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return rates and accelerations of p and x at the start, where x is 0 and J_r is 1."""
    R = start.R_d.T
    return (start.dp_d, start.ddp_d), (R @ start.omega_d, R @ start.domega_d)


class _Half(NamedTuple):
    """Half of a problem, of p or of x.

    Attributes:
        axes: (3, 3) as columns.
        known: (3,) each on them: velocity and acceleration now; position, velocity and
            acceleration at the end; largest speed, acceleration and jerk.
        is_straight: whether all of it is along the first axis.
    """

    axes: Array
    known: tuple[Array, ...]
    is_straight: bool


def _half(
    begin: tuple[Array, Array],
    end: tuple[Array, Array, Array],
    most: tuple[float, float, float],
    by_velocity: bool,
) -> _Half:
    (v_0, a_0), (x_1, v_1, a_1) = begin, end
    A = _axes(v_1 - v_0 if by_velocity else x_1, v_0 if (v_0 @ v_0) else v_1)
    now_v, now_a, x, v, a = (A.T @ part for part in (v_0, a_0, x_1, v_1, a_1))
    speed, acceleration, jerk = (min(one, _MOST) for one in most)
    acceleration *= _OF_ACCELERATION
    across = max(
        np.abs(np.concatenate((now_v[1:], v[1:]))).max() / speed,
        np.abs(np.concatenate((now_a[1:], a[1:]))).max() / acceleration,
    )
    straight = bool(across < _STRAIGHT)
    bounds = (
        _shared(np.maximum(np.abs(now_v), np.abs(v)), speed, straight),
        _shared(np.maximum(np.abs(now_a), np.abs(a)), acceleration, straight),
        _shared(np.zeros(3), jerk, straight),
    )
    return _Half(A, (now_v, now_a, x, v, a, *bounds), straight)


def _planned(
    start: DesiredFrame,
    begins: tuple[tuple[Array, Array], tuple[Array, Array]],
    ends: tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]],
    limits: MotionLimits,
    least: float,
    interface: ControlInterface,
) -> Plan:
    by_velocity = interface is ControlInterface.Velocity
    most = zip(limits.speeds, limits.accelerations, limits.jerks, strict=True)
    p, x = (_half(*half, by_velocity) for half in zip(begins, ends, most, strict=True))
    problem = InputParameter(6)
    (
        problem.current_velocity,
        problem.current_acceleration,
        problem.target_position,
        problem.target_velocity,
        problem.target_acceleration,
        problem.max_velocity,
        problem.max_acceleration,
        problem.max_jerk,
    ) = (np.concatenate(both).tolist() for both in zip(p.known, x.known, strict=True))
    problem.current_position = [0.0] * 6
    problem.control_interface = interface
    profile, T = Profile(6), least
    for _ in range(_TRIALS):
        if T > 0:
            problem.minimum_duration = T
        _solve(problem, profile)
        if p.is_straight and x.is_straight:
            break
        if (excess := _excess(profile, x.axes, limits)) <= 1 + _TOLERANCE:
            break
        T = profile.duration * max(_LONGER, min(excess, 2.0))
    return Plan(start, (p.axes, x.axes), profile)


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


def _axes(way: Array, other: Array) -> Array:
    """Return three axes (3, 3) as columns, the first along a way, or along another if it is 0."""
    for d in (way, other):
        length = math.sqrt(d @ d)
        if length > 1e-12:
            first = d / length
            second = np.zeros(3)
            second[int(np.abs(first).argmin())] = 1.0
            second -= (first @ second) * first
            second /= math.sqrt(second @ second)
            return np.column_stack((first, second, cross(first, second)))
    return np.eye(3)


def _shared(taken: Array, most: float, is_straight: bool) -> Array:
    """Return the bounds (3,) of each axis, together about ``most``, that leave what is taken."""
    if is_straight:
        return most * np.array([1.0, _LEAST, _LEAST])
    squares = (taken / most) ** 2
    left = max(0.0, 1.0 - float(squares.sum()))
    shares = squares + left * np.array([1 - 2 * _ACROSS, _ACROSS, _ACROSS])
    return most * np.maximum(np.sqrt(shares), _ACROSS)


def _excess(profile: Profile, axes: Array, limits: MotionLimits) -> float:
    """Return by how much the norms along a plan exceed their limits, 1 being not at all.

    Args:
        profile: of the plan.
        axes: (3, 3) of its rotation vector.
        limits: of the norms; what the plan begins with is given.
    """
    times = np.linspace(0.0, profile.duration, _PLACES).tolist()
    rows = np.array([profile.at_time(t) for t in times])  # (places, value rate acceleration, 6)
    omega, domega = body_rates(*np.moveaxis(rows[:, :, 3:] @ axes.T, 1, 0))
    rates = np.stack((rows[:, 1, :3], omega, rows[:, 2, :3], domega))
    norms = np.sqrt((rates * rates).sum(axis=2))
    most = np.array([*limits.speeds, *limits.accelerations])
    return float((norms.max(axis=1) / np.maximum(most, norms[:, 0])).max())
