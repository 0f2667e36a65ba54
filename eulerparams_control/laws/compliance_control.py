"""Compliance control: an impedance by efforts, without a force/torque sensor.

Siciliano and Villani, Robot Force Control, ch. 3: springs and dampers draw the tip to the desired
frame, and the arm keeps its own inertia:

    tau = J' w + B ddq_0 + C dq + d + g

with w the elastic wrench, minus the gradient of an energy, and the damping, and with ddq_0 the
accelerations that follow the desired ones, and tend to the posture without moving the tip.  Against
a contact f at rest K (p_d - p_e) = -f: what is felt is the stiffness.  The accelerations are those
that springs and contact make of the inertia; limits of speed, position and effort hold.

An arm that is held may be let go within a moment.  The springs pull no more than can be taken back,
at the rates of the efforts, before the tip has its speeds: their clips are lowered until that
holds, which takes energy from them, and return when nothing is stretched that far, which gives
none.  A force that is fed forward is bounded likewise, by less than the springs hold.  A tip beyond
its speeds is braked, whatever drives it.

Notation: ``Lambda`` (6, 6) inertia of the tip (J B^-1 J')^-1, ``K`` (6, 6) its stiffness, ``omega``
[1/s] natural rates of its modes, ``f, mu`` [N, Nm] wrench of the springs on the tip, ``u`` velocity
of the tip relative to the desired frame; base frame.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError, SingularityError, UnknownNameError
from eulerparams_control.laws._old.blend import blend, kept
from eulerparams_control.laws._old.chain import (
    Motion,
    TipState,
    dJ_dq,
    jacobian_in,
    joint_inertia,
    put_arm,
    read_tip,
)
from eulerparams_control.laws._old.compiled import (
    NONE,
    Array,
    Input,
    Inputs,
    Row,
    Rows,
    formula,
    kernel,
    layout,
    slot,
    to_rows,
)
from eulerparams_control.laws._old.dynamic_control import (
    INFINITE_EFFORT,
    OF_LAW,
    SINGULAR,
    STEEP_JOINT,
    DynamicControl,
    is_bounded,
)
from eulerparams_control.laws._old.frames import Frame, TipLimits, read_frame
from eulerparams_control.laws._old.inverse_dynamics import (
    INFINITE,
    NUMBERS,
    RATE,
    commanded,
    resolve_acceleration,
)
from eulerparams_control.laws._old.limits import without_accelerations
from eulerparams_control.laws._old.linear import (
    Mat,
    MatLike,
    Vec,
    VecLike,
    identity,
    inverse,
    mat,
    norm,
    put_vec,
    read_vec,
    row,
    vec,
)
from eulerparams_control.laws._old.orientation import (
    Lyapunov,
    OrientationRepresentation,
    as_formulas,
)
from eulerparams_control.laws._old.orientation.base import Coordinates, law_of
from eulerparams_control.laws._old.scheme import read_bounds, tick_places, too_far
from eulerparams_control.laws.compliant_frame import TRANSLATIONAL_FRAMES
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.inverse import solve_rows, symmetric_modes
from eulerparams_control.laws.scheme import JointCommand, LoopGain, Tick
from eulerparams_control.motion.frames import DesiredFrame

BLEND_TIME = 0.005
"""Time constant [s] with which a stretched arm goes over to other springs: what is left of those of
before is no spring, and would push an arm that is let go.  The efforts have their rates besides."""

# An axis that is softer is damped as if it had this stiffness [N/m], [Nm/rad].
_LEAST_K_p, _LEAST_K_o = 10.0, 0.5

# Modes that are slower [1/s] are damped as if they had this rate: near a singularity one has none.
_LEAST_OMEGA = 1.0

# A damped mode has 1 / (e omega) of the speed that its first acceleration makes in 1 s.
_DAMPED = math.e / 2.0

# A tip beyond its speeds is braked with this rate [1/s], and no more than this part of the rate of
# the ticks.
_BRAKES, _OF_TICKS = 100.0, 0.25

# Of the force that an arm may lose at once, without a lunge, what is fed forward takes this part:
# less than the springs that hold it.
_FED = 0.8

# Ticks until what was seen of the tip has changed an effort.
_LATE = 2.0

# A force that is fed forward changes by no more [N/s].  Of what the springs hold within their clip
# it is this part at most; of it may be along axes without stiffness.
_SLEW, _MOST_FED, _HELD = 200.0, 0.9, 1e-6

_TINY = 1e-12

displacement = spring = law = read = put = slot  # of a representation


class _Numbers(NamedTuple):
    """A law in numbers; F F' is the stiffness that is damped, in the same coordinates as K."""

    options: Coordinates
    K_p: MatLike
    K_o: MatLike
    F_p: MatLike
    F_o: MatLike
    ratio_p: float
    ratio_o: float
    clip_p: float
    clip_o: float
    in_base: bool


class Pull(NamedTuple):
    """What the springs do at a displacement.

    Attributes:
        f, mu: (3,) [N], [Nm] on the tip: minus the gradient of the energy.
        energy: [J], that of the clipped springs.
        stretch: of the more stretched one; 1 where it is clipped.
        axes_p, axes_o: (3, 3) whose columns F_p and F_o refer to, base frame.
    """

    f: VecLike
    mu: VecLike
    energy: float
    stretch: float
    axes_p: MatLike
    axes_o: MatLike


class Effects(NamedTuple):
    """What a tick knows of its springs and dampers, behind x_de in its row.

    Attributes:
        f, mu: (3,) [N], [Nm] of the springs on the tip.
        energy: [J] of them.
        dissipated: [W] by the dampers.
        rate: [1/s] of the fastest mode.
        turning: the part of the elastic energy of that mode that is rotational.
        lowered: by which part the clips are lower than stated, from the next tick on.
    """

    f: VecLike
    mu: VecLike
    energy: float
    dissipated: float
    rate: float
    turning: float
    lowered: float


_numbers = layout(_Numbers).read
_put_effects, _unpack_effects = layout(Effects).put, layout(Effects).unpack
_read_effects = layout(Effects).read
_put_pull, _unpack_pull = layout(Pull).put, layout(Pull).unpack
effects_width, _pull_width = layout(Effects).width, layout(Pull).width
_RATE = -3  # from the end of the row of a tick


@formula
def _share(energy: float, clip: float) -> float:
    """Return the part of the gradient of an energy that is left beyond a clip.

    s = sqrt(2 energy) is the size of the displacement in the metric of the stiffness.  Up to the
    clip the energy is s^2 / 2, beyond it clip s - clip^2 / 2, whose gradient is clip / s as large.
    """
    s = math.sqrt(2.0 * energy)
    return clip / s if s > clip else 1.0


@formula
def _stretch(energy: float, clip: float) -> float:
    """Return s / clip; 0 without a displacement."""
    return math.sqrt(2.0 * energy) / clip if energy > 0.0 else 0.0


@formula
def _clipped(energy: float, clip: float) -> float:
    """Return the energy with that gradient."""
    s = math.sqrt(2.0 * energy)
    return clip * s - clip * clip / 2.0 if s > clip else energy


def _law(tip: TipState, desired: Frame, numbers: _Numbers, part: float) -> Pull:
    """Return what the springs do, clipped at this part of where that is stated."""
    A = identity(1.0) if numbers.in_base else desired.R_d
    f = A @ (numbers.K_p @ (A.T @ (desired.p_d - tip.p_e)))
    energy_p = (f @ (desired.p_d - tip.p_e)) / 2.0
    turned = spring(desired.R_d, tip.R_e, numbers.K_o, numbers.options)  # eqs. (56), (60), (66)
    clip_p, clip_o = part * numbers.clip_p, part * numbers.clip_o
    share_p, share_o = _share(energy_p, clip_p), _share(turned.energy, clip_o)
    energy = _clipped(energy_p, clip_p) + _clipped(turned.energy, clip_o)
    stretch = max(_stretch(energy_p, clip_p), _stretch(turned.energy, clip_o))
    return Pull(share_p * f, share_o * turned.moment, energy, stretch, A, turned.axes)


def _pull(p_e: Input, R_e: Inputs, p_d: Input, R_d: Inputs, numbers: Input, row: Row) -> int:
    """Fill the row of a :class:`Pull`."""
    still = Vec(0.0, 0.0, 0.0)
    tip = TipState(vec(p_e), mat(R_e), Motion(still, still, still, still))
    desired = Frame(vec(p_d), mat(R_d), still, still, still, still)
    _put_pull(row, 0, law(tip, desired, _numbers(numbers, 0), 1.0))
    return 0


@kernel
def _mobility(chain: Rows, work: Rows, J: Inputs, M: Rows) -> None:
    """Fill M (n, n + 6), of which the last six columns are then B^-1 J'."""
    n = len(work)
    B = np.empty((n, n))
    joint_inertia(chain, work, B)
    for i in range(n):
        for j in range(n):
            M[i, j] = B[i, j]
        for j in range(6):
            M[i, n + j] = J[j, i]
    solve_rows(M)


@kernel
def _put_axes(F: Rows, k: int, A: Mat) -> None:
    """Write a matrix into the block k of the diagonal of F (6, 6)."""
    for i in range(3):
        put_vec(F[3 * k + i], 3 * k, row(A, i))


@kernel
def _inverse_of(F: Rows, k: int) -> Mat:
    """Return the inverse of the block of F (6, 6) from k on, in whose metric springs are clipped.

    It is NaN where the coordinates are singular.
    """
    return inverse(mat(F[k : k + 3, k : k + 3]))


@kernel
def _left(spring: Vec, drag: Vec, lead: Vec, most: float) -> float:
    """Return the largest part k <= 1 of what leads with which |spring + drag + k lead| <= most.

    Where the two others are larger already it is the one that does not add to them.
    """
    a = spring + drag
    square, along, size = lead @ lead, a @ lead, a @ a
    over = size - max(most * most, size)
    if not square + 2.0 * along + over > 0.0:
        return 1.0
    return max(0.0, (math.sqrt(max(along * along - square * over, 0.0)) - along) / square)


@kernel
def _dampers(
    J: Inputs, M: Rows, pull: Pull, numbers: _Numbers, part: float, v: Row, v_d: Row, w: Row
) -> tuple[float, float, float]:
    """Add to w (6,) the damping -D u; return its power [W], and rate and turning of a mode.

    D = F Y diag(2 zeta / omega) Y' F' with F' J B^-1 J' F = Y diag(omega^2) Y': the geometric mean
    of Lambda and K = F F' times 2 zeta, which is positive definite, and damps each mode by its
    ratio: that of its part of p and o.  Lambda itself is not needed, which singularities lack.

    u = v - k v_d, k = 1 but where springs and dampers would push by more than the springs may,
    at this part of where their clips are stated: then k is the part with which they do not.
    """
    n = len(M)
    F, S, Y, G = np.zeros((6, 6)), np.empty((6, 6)), np.empty((6, 6)), np.zeros((n, 6))
    _put_axes(F, 0, pull.axes_p @ numbers.F_p)
    _put_axes(F, 1, pull.axes_o @ numbers.F_o)
    JF = np.zeros((n, 6))
    for i in range(n):
        for j in range(6):
            for k in range(6):
                G[i, j] += M[i, n + k] * F[k, j]
                JF[i, j] += J[k, i] * F[k, j]
    for i in range(6):
        for j in range(6):
            S[i, j] = 0.0
            for k in range(n):
                S[i, j] += JF[k, i] * G[k, j]
    symmetric_modes(S, Y)
    rate, turning, direction = 0.0, 0.0, np.empty(6)
    drag, lead, push, ahead = np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6)
    for m in range(6):
        of_o, along, leads = 0.0, 0.0, 0.0
        for i in range(6):
            direction[i] = 0.0
            for k in range(6):
                direction[i] += F[i, k] * Y[k, m]
            along += direction[i] * v[i]
            leads += direction[i] * v_d[i]
        for k in range(3, 6):
            of_o += Y[k, m] * Y[k, m]
        zeta = numbers.ratio_p + of_o * (numbers.ratio_o - numbers.ratio_p)
        omega = math.sqrt(max(S[m, m], _LEAST_OMEGA * _LEAST_OMEGA))
        c = 2.0 * zeta / omega
        for i in range(6):
            drag[i] -= c * along * direction[i]
            lead[i] += c * leads * direction[i]
            push[i] -= c * along * Y[i, m]
            ahead[i] += c * leads * Y[i, m]
        fastest = omega * max(zeta, 1.0 / zeta)  # light damping bears less delay, too
        if fastest > rate:
            rate, turning = fastest, of_o
    k_p = _left(_inverse_of(F, 0) @ pull.f, read_vec(push, 0), read_vec(ahead, 0),
                part * numbers.clip_p)  # fmt: skip
    k_o = _left(_inverse_of(F, 3) @ pull.mu, read_vec(push, 3), read_vec(ahead, 3),
                part * numbers.clip_o)  # fmt: skip
    led, power = min(k_p, k_o), 0.0
    for i in range(6):
        damping = drag[i] + led * lead[i]
        w[i] += damping
        power -= damping * (v[i] - v_d[i])
    return power, rate, turning


@kernel
def _accelerated(J: Inputs, M: Rows, w: Row, a: Row) -> None:
    """Fill a (6,): by what a wrench w (6,) accelerates a free tip, J B^-1 J' w."""
    n = len(M)
    for j in range(6):
        a[j] = 0.0
    for i in range(n):
        ddq = 0.0
        for j in range(6):
            ddq += M[i, n + j] * w[j]
        for j in range(6):
            a[j] += J[j, i] * ddq


@kernel
def _brake(J: Inputs, M: Rows, k: int, v: Vec, most: float, rate: float, w: Row) -> float:
    """Add to w (6,) what slows a tip down that is faster than ``most``; return its power [W].

    -r m (|v| - most) v / |v| with m = 1 / (n' J B^-1 J' n), n = v / |v|: the mass along v.

    Args:
        J, M: of the arm.
        k: 0 of the velocity, 3 of the angular velocity.
        v, most: its velocity, and the most.
        rate: r [1/s].
        w: is added to.
    """
    speed = norm(v)
    if not speed > most:
        return 0.0
    along, moved, mobility = v / speed, np.zeros(6), np.empty(6)
    put_vec(moved, k, along)
    _accelerated(J, M, moved, mobility)
    size = rate * (speed - most) / max(along @ read_vec(mobility, k), _TINY)
    put_vec(w, k, read_vec(w, k) - size * along)
    return size * speed


class _Release(NamedTuple):
    """How a tip goes off that is let go.

    Attributes:
        a_p, a_o: [m/s^2], [rad/s^2] by the springs.
        braked_p, braked_o: [1/s] the dampers' acceleration over the speed.
        time: [s] in which the efforts of the springs are taken back.
        tick: [s] for which an effort lasts.
    """

    a_p: float
    a_o: float
    braked_p: float
    braked_o: float
    time: float
    tick: float


@formula
def _borne(speed: float, most: float, a: float, braked: float, time: float, tick: float) -> float:
    """Return the largest part s <= 1 of the springs' pull that keeps a tip within its speed.

    A pull s a acts for a tick before it is seen.  It is taken back after t = 2 tick + s time / 2,
    and dampers leave 1 / (1 / t + c) of that, with c = e / 2 times ``braked``:

        speed + s a tick <= most
        speed + s a t / (1 + c t) = most
    """
    left, c, late = most - speed, _DAMPED * braked, _LATE * tick
    if left <= 0.0:
        return 0.0
    square = a * time / 2.0
    linear = a * late - left * c * time / 2.0
    whole = left * (1.0 + c * late)
    root = linear + math.sqrt(linear * linear + 4.0 * square * whole)
    part = 2.0 * whole / root if root > 2.0 * whole else 1.0
    return min(part, left / max(a * tick, left))


@kernel
def _part(v: float, omega: float, release: _Release, most: TipLimits) -> float:
    """Return the part of the springs' pull that keeps a tip of these speeds within its limits."""
    of_p, of_o, time, tick = release.braked_p, release.braked_o, release.time, release.tick
    part = _borne(v, most.linear_speed, release.a_p, of_p, time, tick)
    return min(part, _borne(omega, most.angular_speed, release.a_o, of_o, time, tick))


@kernel
def _bearable(
    J: Inputs, M: Rows, w: Row, pull: Pull, numbers: _Numbers, tip: Motion, most: TipLimits,
    rate: Input, dt: float,
) -> tuple[float, float]:  # fmt: skip
    """Return the parts of the springs' wrench w (6,) that a tip at rest bears, and this one."""
    n, time, v, omega = len(M), 0.0, norm(tip.v), norm(tip.omega)
    a, damping, b = np.empty(6), np.zeros(6), np.empty(6)
    _accelerated(J, M, w, a)
    a_p, a_o = read_vec(a, 0), read_vec(a, 3)
    for i in range(n):
        tau = 0.0
        for j in range(6):
            tau += J[j, i] * w[j]
        time = max(time, abs(tau) / rate[i])
    free = _Release(norm(a_p), norm(a_o), 0.0, 0.0, time, dt)
    if _part(v, omega, free, most) == 1.0:
        return 1.0, 1.0  # also with dampers
    _dampers(J, M, pull, numbers, 1.0, a, np.zeros(6), damping)
    _accelerated(J, M, damping, b)
    braked_p = -(a_p @ read_vec(b, 0)) / max(a_p @ a_p, _TINY)
    braked_o = -(a_o @ read_vec(b, 3)) / max(a_o @ a_o, _TINY)
    damped = _Release(free.a_p, free.a_o, max(braked_p, 0.0), max(braked_o, 0.0), time, dt)
    return _part(0.0, 0.0, damped, most), _part(v, omega, damped, most)


class _Drive(NamedTuple):
    """What drives the tip, besides its wrench.

    Attributes:
        dissipated: [W] by the dampers, the brake, and by what is drawn less.
        rate, turning: of the fastest mode, see :class:`Effects`.
        part: of where the clips are stated, from the next tick on.
        excess: how much longer each instant of the desired motion is to last, 1 or more.
    """

    dissipated: float
    rate: float
    turning: float
    part: float
    excess: float


@kernel
def _bounded(
    J: Inputs, M: Rows, pull: Pull, numbers: _Numbers, part: float, tip: Motion, v: Row, v_d: Row,
    most: TipLimits, rate: Input, dt: float, w: Row, fed: Row, damping: Row,
) -> tuple[float, float, float]:  # fmt: skip
    """Bound what drives a tip whose springs pull with w (6,); return ``dissipated, part, excess``.

    fed (6,), what is fed forward, becomes less, damping (6,) brakes what is too fast, and w, with
    what is fed, is drawn less where that would add power.
    """
    resting, moving = _bearable(J, M, w, pull, numbers, tip, most, rate, dt)
    if resting < 1.0:
        part *= resting * min(1.0, pull.stretch)
    elif pull.stretch <= 1.0:
        part = 1.0
    f = read_vec(fed, 0)
    if f @ f > 0.0:
        put_vec(fed, 0, f / _FED)
        borne, _ = _bearable(J, M, fed, pull, numbers, tip, most, rate, dt)
        put_vec(fed, 0, borne * f)
    leads, power, dissipated = 0.0, 0.0, 0.0
    for j in range(6):
        leads += w[j] * v_d[j]
        w[j] += fed[j]
        power += w[j] * v[j]
    # time waits only while the motion stretches the springs: back it goes
    excess = max(1.0, pull.stretch) if leads > 0.0 else 1.0
    if power > 0.0:  # no more
        for j in range(6):
            dissipated += (1.0 - moving) * w[j] * (v[j] - v_d[j])
            w[j] *= moving
    r = min(_BRAKES, _OF_TICKS / dt) if dt > 0.0 else 0.0
    dissipated += _brake(J, M, 0, tip.v, most.linear_speed, r, damping)
    dissipated += _brake(J, M, 3, tip.omega, most.angular_speed, r, damping)
    return dissipated, part, excess


@kernel
def _drive(
    J: Inputs, M: Rows, pull: Pull, numbers: _Numbers, part: float, tip: TipState,
    desired: Frame, force: Input, most: TipLimits, is_limited: bool, rate: Input, dt: float,
    w: Row,
) -> _Drive:  # fmt: skip
    """Fill w (6,) with the wrench on the tip: springs, dampers, and a force (3,) in its axes."""
    v, v_d, damping, fed = np.empty(6), np.empty(6), np.zeros(6), np.zeros(6)
    put_vec(v, 0, tip.motion.v)
    put_vec(v, 3, tip.motion.omega)
    put_vec(v_d, 0, desired.dp_d)
    put_vec(v_d, 3, desired.omega_d)
    put_vec(w, 0, pull.f)
    put_vec(w, 3, pull.mu)
    if len(force) > 0:
        put_vec(fed, 0, tip.R_e @ vec(force))
    taken, omega, turning = _dampers(J, M, pull, numbers, part, v, v_d, damping)
    excess = 1.0
    if is_limited:
        more, part, excess = _bounded(
            J, M, pull, numbers, part, tip.motion, v, v_d, most, rate, dt, w, fed, damping
        )
        taken += more
    for j in range(6):
        w[j] += damping[j] + (0.0 if is_limited else fed[j])
    return _Drive(taken, omega, turning, part, excess)


def _tick(
    chain: Rows, work: Rows, row: Row, q_now: Input, dq_now: Input, desired_row: Input,
    force: Input, previous: Input, dt: float, lasts: float, past: Rows, numbers: Input,
    posture: Rows, friction: Rows, limits: Rows, step: Row,
) -> int:  # fmt: skip
    """Fill the row of a tick as that of dynamic control, with :class:`Effects` behind x_de.

    ``force`` (3,) [N] is fed forward, on the environment, axes of the tip; (0,) is none.
    """
    n, is_limited = len(work), limits.shape[1] > 0
    at, at_ddq, at_tau, at_x = tick_places(n)
    if len(q_now) > 0:
        put_arm(chain, q_now, dq_now, work, row)
    q, dq, tip, J = row[:n], row[n : 2 * n], read_tip(row, 2 * n), jacobian_in(row, n)
    desired, rate = read_frame(desired_row, 0), limits[RATE] if is_limited else step[:0]
    given, most = _numbers(numbers, OF_LAW), read_bounds(numbers, NUMBERS)
    put(row, at_x, displacement(desired.R_d, tip.R_e, read(previous, 0), given.options))
    part = 1.0 - _read_effects(previous, len(previous) - effects_width).lowered
    pull = law(tip, desired, given, part)
    if math.isnan(pull.mu.x):
        return SINGULAR
    if is_limited:
        found = too_far(desired, tip.p_e, tip.R_e, most)
        if found:
            return found
    M, ddq, w, a = np.empty((n, n + 6)), np.empty(n), np.empty(6), np.empty(6)
    _mobility(chain, work, J, M)
    driven = _drive(
        J, M, pull, given, part, tip, desired, force, most.limits, is_limited, rate, dt, w
    )
    put_vec(a, 0, desired.ddp_d)
    put_vec(a, 3, desired.domega_d)
    resolve_acceleration(q, dq, J, dJ_dq(row, n), a, numbers, posture, ddq)
    for i in range(n):
        for j in range(6):
            ddq[i] += M[i, n + j] * w[j]  # J' w, as what it accelerates
    blend(step, dt, ddq)
    if not is_bounded(ddq):
        return STEEP_JOINT
    row[at] = driven.excess
    told = driven.dissipated, driven.rate, driven.turning, 1.0 - driven.part
    _put_effects(row, len(row) - effects_width, Effects(pull.f, pull.mu, pull.energy, *told))
    changed = commanded(
        chain, work, q, dq, J, ddq, force[:0], dt, lasts, past, friction, numbers,
        without_accelerations(limits), row[at_ddq:at_tau], row[at_tau:at_x],
    )  # fmt: skip
    if changed & INFINITE:
        return INFINITE_EFFORT
    kept(step)
    return changed


_NO_FORCE = np.zeros(3)
_NO_FORCE.setflags(write=False)


@dataclass(frozen=True)
class ElasticLaw:
    """Springs and dampers between the tip and the desired frame.

    Attributes:
        orientation: the representation of the rotational displacement.
        K_p, K_o: (3, 3) stiffness [N/m], [Nm/rad], symmetric, positive semidefinite.
        ratio_p, ratio_o: damping ratio of translational and rotational modes of the free arm.
        clip_position, clip_rotation: [m], [rad] of displacement along the stiffest axis from which
            the spring pulls no more; along one of the stiffness k it is sqrt(k_max / k) as far.
        frame: whose axes K_p refers to, "base" or "desired".

    Raises:
        ConfigurationError: if a matrix or a number is impossible, or the representation has no
            impedance.
    """

    orientation: OrientationRepresentation
    K_p: Array
    K_o: Array
    ratio_p: float = 1.0
    ratio_o: float = 1.0
    clip_position: float = math.inf
    clip_rotation: float = math.inf
    frame: str = "base"

    def __post_init__(self) -> None:
        object.__setattr__(self, "orientation", as_formulas(self.orientation))
        if self.frame not in TRANSLATIONAL_FRAMES:
            raise UnknownNameError("translational_frame", self.frame, TRANSLATIONAL_FRAMES)
        for name in ("ratio_p", "ratio_o", "clip_position", "clip_rotation"):
            if not getattr(self, name) > 0:
                raise ConfigurationError(f"{name} is {getattr(self, name)}; expected > 0")
        _ = self.numbers, self.step

    @cached_property
    def numbers(self) -> Array:
        """What the law is made of, as a row."""
        orientation, K_p, K_o = (
            self.orientation,
            _checked("K_p", self.K_p),
            _checked("K_o", self.K_o),
        )
        numbers = _Numbers(
            orientation.options.values,
            K_p,
            _in_coordinates(orientation, K_o),
            _factor(_raised(K_p, _LEAST_K_p)),
            _factor(_in_coordinates(orientation, _raised(K_o, _LEAST_K_o))),
            self.ratio_p,
            self.ratio_o,
            _clip(K_p, self.clip_position),
            _clip(K_o, self.clip_rotation),
            self.frame == "base",
        )
        return to_rows(_Numbers, numbers)

    @cached_property
    def step(self) -> Callable[..., int]:
        """What fills the row of a tick."""
        return law_of(_tick, _law, type(self.orientation))

    @property
    def width(self) -> int:
        """How many floats its part of the row of a tick has: x_de, and :class:`Effects`."""
        return self.orientation.rows.width + effects_width

    fastest_gain = None
    """It depends on where the arm is."""

    def refuse_force(self, force: Array, R_d: Array) -> None:
        """Raise ConfigurationError for a force (3,) [N], base frame, that the springs do not hold.

        Without a contact they have to, within their clip.
        """
        K, size = self.stiffness(R_d), float(np.linalg.norm(force))
        x = np.linalg.pinv(K) @ force
        is_held = np.linalg.norm(K @ x - force) < _TINY + _HELD * size
        stretched = math.sqrt(max(float(x @ force), _TINY**2))  # in the metric of K_p
        most = _MOST_FED * _clip(self.K_p, self.clip_position) / stretched if is_held else 0.0
        if most < 1.0:
            raise ConfigurationError(
                f"the springs do not hold {size:.3g} N along {np.round(force / size, 3).tolist()} "
                f"(base frame) where there is no contact; expected at most "
                f"{size * most:.3g} N, {_MOST_FED:g} of what they hold at "
                "error_clip_position"
            )

    def stiffness(self, R_d: Array) -> Array:
        """Return K_p (3, 3) [N/m] in the base frame, where the desired orientation is R_d."""
        return self.K_p if self.frame == "base" else R_d @ self.K_p @ R_d.T

    def pull(self, p_e: Array, R_e: Array, desired: DesiredFrame) -> Pull:
        """Return what the springs do at a pose p_e (3,), R_e (3, 3) of the tip.

        Raises:
            SingularityError: if the representation has no finite answer.
        """
        row = np.empty(_pull_width)
        law_of(_pull, _law, type(self.orientation))(p_e, R_e, *desired[:2], self.numbers, row)
        pull: Pull = _unpack_pull(row)
        if np.isnan(pull.mu).any():
            raise SingularityError(self.orientation.singularity)
        return pull

    def springs(self, tick: Tick) -> Lyapunov:
        """Return the elastic energy [J], and minus what the dampers take [W]."""
        effects = effects_of(tick)
        return Lyapunov(effects.energy, -effects.dissipated)


class Springs(NamedTuple):
    """Springs as they act.

    Attributes:
        law: theirs.
        part: of where their clips are stated.
    """

    law: ElasticLaw
    part: float

    @property
    def clips(self) -> tuple[float, float]:
        """The clips [m], [rad]."""
        return self.part * self.law.clip_position, self.part * self.law.clip_rotation


def effects_of(tick: Tick) -> Effects:
    """Return what a tick of compliance control knows of its springs and dampers."""
    effects: Effects = _unpack_effects(tick.effects[-effects_width:])
    return effects


class ComplianceControl(DynamicControl):
    """Compliance control of one arm: the efforts of dynamic control, by another law.

    :meth:`press` adds a force to that of the springs.

    Attributes:
        fed: (3,) [N] that is added now, on the environment, axes of the tip.
        springs: that act, the same object while they stay the same; None where none do.
    """

    law: ElasticLaw
    fed: Array
    springs: Springs | None = None
    _wanted: Array
    _known: LoopGain | None = None

    def press(self, force: Array) -> None:
        """Add a force (3,) [N] on the environment, axes of the tip, from now on; it ramps.

        It ends by itself where the scheme restarts, or holds.
        """
        self._wanted = force if force.any() else _NO_FORCE

    @property
    def is_pressing(self) -> bool:
        """Whether a force is added, or is to be."""
        return not (self._wanted is self.fed is _NO_FORCE)

    def _forget_x(self) -> None:
        self._known = self.fastest_gain  # also while the arm is held
        super()._forget_x()

    def reset(self, q: Array) -> None:
        """Begin at the measured q (n,), with no force."""
        self._wanted = self.fed = _NO_FORCE
        self.springs = None
        super().reset(q)

    def hold(self, dt: float, q: Array, dq: Array, w: Array | None = None) -> JointCommand:
        """Return efforts that stop the joints, and hold them there; no force is added then."""
        self._wanted = self.fed = _NO_FORCE
        self.springs = None
        return super().hold(dt, q, dq, w)

    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame, h: Array = NONE) -> Tick:
        """Return the efforts for this instant, with the force that is added.

        See :meth:`DynamicControl.tick`; a contact h is not compensated: it stretches the springs.

        Raises:
            ConfigurationError: if one is given.
        """
        if len(h):
            raise ConfigurationError("compliance control takes no contact h; expected none")
        force = NONE
        if self.is_pressing:
            more = self._wanted - self.fed
            size = float(np.linalg.norm(more))
            force = self.fed + min(1.0, _SLEW * dt / max(size, _TINY)) * more
            self.fed = force if force.any() else _NO_FORCE
        law, part, springs = self.law, 1.0 - self._x_de.item(-1), self.springs
        if springs is None or springs.law is not law or springs.part != part:
            self.springs = Springs(law, part)
        tick = self._tick(dt, q, dq, desired, force)
        self.loop_rate = tick.effects.item(_RATE)
        return tick

    @property
    def fastest_gain(self) -> LoopGain | None:
        """The stiffness of the fastest mode where the arm was last; None before the first tick."""
        if not hasattr(self, "_x_de"):
            return None
        _, _, _, _, rate, turning, _ = _unpack_effects(self._x_de[-effects_width:])
        if rate == 0:
            return self._known
        name, K = ("K_o", self.law.K_o) if turning > 0.5 else ("K_p", self.law.K_p)
        return LoopGain(name, float(np.linalg.eigvalsh(K)[-1]), rate, order=2)

    def lyapunov(self, tick: Tick) -> Lyapunov:
        """Return the energy of the motion and of the springs [J], and what the dampers take [W].

        V = u' Lambda u / 2 + U, of which without contact -u' D u remains at low speeds.
        """
        arm, desired = tick.state, tick.desired
        u = np.concatenate((arm.dp_e - desired.dp_d, arm.omega_e - desired.omega_d))
        B = self.robot.dynamic_state(arm.q, arm.dq).B
        kinetic = u @ np.linalg.pinv(arm.J @ np.linalg.solve(B, arm.J.T)) @ u / 2
        springs = self.law.springs(tick)
        return Lyapunov(float(kinetic) + springs.V, springs.dV)


def _checked(name: str, K: Array) -> Array:
    """Return a stiffness; raises ConfigurationError unless it is one."""
    try:
        return Impedance(np.eye(3), np.zeros((3, 3)), K).K
    except ConfigurationError as error:
        raise ConfigurationError(f"{name}: {error}") from error


def _in_coordinates(orientation: OrientationRepresentation, K_o: Array) -> Array:
    """Return a rotational stiffness in the coordinates of a representation."""
    return orientation.impedance(Impedance(np.eye(3), np.zeros((3, 3)), K_o)).K


def _clip(K: Array, most: float) -> float:
    """Return the size of a displacement by ``most`` along the stiffest axis, in the metric of K."""
    stiffest = float(np.linalg.eigvalsh(K)[-1])
    return most * math.sqrt(stiffest) if stiffest > 0 else 0.0


def _raised(K: Array, least: float) -> Array:
    """Return a stiffness (3, 3) of which no axis is softer than ``least``."""
    values, axes = np.linalg.eigh(K)
    raised: Array = (axes * np.maximum(values, least)) @ axes.T
    return raised


def _factor(K: Array) -> Array:
    """Return F (3, 3) with F F' = K."""
    factor: Array = np.linalg.cholesky(K)
    return factor
