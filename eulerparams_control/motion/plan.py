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

from eulerparams_control.laws._old.compiled import Array, formula
from eulerparams_control.laws._old.linear import Mat, Vec, columns, cross, identity, norm
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits, TipLimits
from eulerparams_control.motion.trajectories import perpendicular, rotation_vector_at_end, turned

Sample = Callable[[float], DesiredFrame]

# A state whose parts across the way are below this part of their limit goes straight.
_STRAIGHT = 1e-3

# What the axes across the way get of the limits: of a straight way, and else of what is left.
_LEAST, _ACROSS = 0.01, 0.15

# Number of places at which a plan is checked, and the part by which it may exceed its limits; else
# it takes longer, by this factor at least, within this number of trials.
_PLACES, _TOLERANCE, _LONGER, _TRIALS = 24, 0.01, 1.1, 8

# Of the acceleration a plan takes this part: a law of finite rate adds to it where it changes.
_OF_ACCELERATION = 0.97

# A limit that is infinite, for a library that wants numbers.
_MOST = 1e6

# Least factor between the times after which a motion is joined, and the largest number of trials.
_LATER, _JOINS = 1.25, 30

# Further trials to join it sooner: so the tip gets nearer whenever one motion replaces another.
_CLOSER = 4

# A way [m, rad] that is shorter, or a speed that is less [m/s, rad/s], has no direction.
_NOWHERE = 1e-12

# Of a half, (3,) each on its axes: velocity and acceleration now; position, velocity and
# acceleration at the end; the largest speed, acceleration and jerk.
_Half = tuple[Vec, Vec, Vec, Vec, Vec, Vec, Vec, Vec]


class Plan:
    """A motion from one state of the tip to another; then it goes on as it ended.

    Attributes:
        duration: [s].
    """

    def __init__(self, start: DesiredFrame, axes: Array, profile: Profile) -> None:
        self._begin, self._profile = np.concatenate((axes, *start[:2]), axis=None), profile
        self.duration: float = profile.duration

    def sample(self, t: float) -> DesiredFrame:
        """Return the frame at t [s] after the start."""
        return DesiredFrame.of(self.rows([max(t, 0.0)])[0])

    def rows(self, times: list[float]) -> Array:
        """Return the frames (N, 24) at N times [s] after the start."""
        at = np.array([self._profile.at_time(t) for t in times]).reshape(-1, 18)
        return along.rows(np.hstack((at, np.broadcast_to(self._begin, (len(times), 30)))))


@formula
def along(
    value: tuple[Vec, Vec],
    rate: tuple[Vec, Vec],
    acceleration: tuple[Vec, Vec],
    axes: tuple[Mat, Mat],
    p: Vec,
    R: Mat,
) -> DesiredFrame:
    """Return the frame of a plan that began at p and R, from what is on its axes, p and x."""
    A, B = axes
    way, dp, ddp = A @ value[0], A @ rate[0], A @ acceleration[0]
    return turned(R, p + way, dp, ddp, B @ value[1], B @ rate[1], B @ acceleration[1])


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


@formula
def problem(
    start: DesiredFrame, end: DesiredFrame, by_velocity: bool, most: TipLimits
) -> tuple[_Half, _Half, Mat, Mat, bool]:
    """Return both halves of a problem, p and x; their axes; whether all is along the first."""
    R, way = start.R_d.T, end.p_d - start.p_d  # at the start x is 0 and J_r is 1
    x, dx, ddx = rotation_vector_at_end(start, end)
    omega, domega = R @ start.omega_d, R @ start.domega_d
    A = _axes(way, start.dp_d, end.dp_d, by_velocity)
    B = _axes(x, omega, dx, by_velocity)
    p_half, p_is = _half(
        A.T, start.dp_d, start.ddp_d, way, end.dp_d, end.ddp_d,
        most.linear_speed, most.linear_acceleration, most.linear_jerk,
    )  # fmt: skip
    x_half, x_is = _half(
        B.T, omega, domega, x, dx, ddx,
        most.angular_speed, most.angular_acceleration, most.angular_jerk,
    )  # fmt: skip
    return p_half, x_half, A, B, p_is and x_is


@formula
def _half(
    A: Mat, v_0: Vec, a_0: Vec, x_1: Vec, v_1: Vec, a_1: Vec,
    speed: float, acceleration: float, jerk: float,
) -> tuple[_Half, bool]:  # fmt: skip
    """Return half of a problem on the axes that are the rows of A, and whether it is straight."""
    v_0, a_0, x_1, v_1, a_1 = A @ v_0, A @ a_0, A @ x_1, A @ v_1, A @ a_1
    speed, acceleration = min(speed, _MOST), _OF_ACCELERATION * min(acceleration, _MOST)
    v, a = _larger(v_0, v_1), _larger(a_0, a_1)
    is_straight = max(max(v.y, v.z) / speed, max(a.y, a.z) / acceleration) < _STRAIGHT
    v, a = _shared(v, speed, is_straight), _shared(a, acceleration, is_straight)
    j = _shared(0.0 * v, min(jerk, _MOST), is_straight)
    return (v_0, a_0, x_1, v_1, a_1, v, a, j), is_straight


@formula
def _larger(v: Vec, w: Vec) -> Vec:
    """Return the larger one of the magnitudes of each element."""
    return Vec(max(abs(v.x), abs(w.x)), max(abs(v.y), abs(w.y)), max(abs(v.z), abs(w.z)))


@formula
def _axes(x_1: Vec, v_0: Vec, v_1: Vec, by_velocity: bool) -> Mat:
    """Return three axes as columns, the first along the way, or else along the velocity."""
    d = v_1 - v_0 if by_velocity else x_1
    if not norm(d) > _NOWHERE:
        d = v_0 if norm(v_0) > 0.0 else v_1
    if not norm(d) > _NOWHERE:
        return identity(1.0)
    first = d / norm(d)
    second = perpendicular(first)
    return columns(first, second, cross(first, second))


@formula
def _shared(taken: Vec, most: float, is_straight: bool) -> Vec:
    """Return the bounds of each axis, together about ``most``, that leave what is taken."""
    if is_straight:
        return most * Vec(1.0, _LEAST, _LEAST)
    squares = Vec(taken.x * taken.x, taken.y * taken.y, taken.z * taken.z) / (most * most)
    left = max(0.0, 1.0 - (squares.x + squares.y + squares.z))
    shares = squares + left * Vec(1.0 - 2.0 * _ACROSS, _ACROSS, _ACROSS)
    x, y, z = math.sqrt(shares.x), math.sqrt(shares.y), math.sqrt(shares.z)
    return most * Vec(max(x, _ACROSS), max(y, _ACROSS), max(z, _ACROSS))


def _planned(
    start: DesiredFrame,
    end: DesiredFrame,
    limits: MotionLimits,
    least: float,
    interface: ControlInterface,
) -> Plan:
    by_velocity = interface is ControlInterface.Velocity
    found = problem.row(*start, *end, by_velocity, limits.row)
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
    ) = found[:48].reshape(2, 8, 3).swapaxes(0, 1).reshape(8, 6).tolist()
    asked.current_position = [0.0] * 6
    asked.control_interface = interface
    profile, T = Profile(6), least
    for _ in range(_TRIALS):
        if T > 0:
            asked.minimum_duration = T
        _solve(asked, profile)
        plan = Plan(start, found[48:66], profile)
        if found[66] or (excess := _excess(plan, limits)) <= 1 + _TOLERANCE:
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


def _excess(plan: Plan, limits: MotionLimits) -> float:
    """Return by how much the norms along a plan exceed their limits, 1 being not at all.

    What the plan begins with is given.
    """
    rates = plan.rows(np.linspace(0.0, plan.duration, _PLACES).tolist())[:, 12:]
    norms = np.sqrt((rates * rates).reshape(_PLACES, 4, 3).sum(axis=2))
    return float((norms / np.maximum(limits.row[:4], norms[0])).max())


for _formula in (along, problem):
    _formula.prepare()
