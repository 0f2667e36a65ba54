"""Parallel force/position control: the tool presses with a force along some of its axes.

Along a force axis the compliant frame has no stiffness; the force error drives it, with the
integral action of an observer, and the surface's own motion is followed.  The other axes keep the
impedance (52).  After Chiaverini and Sciavicco, The parallel approach to force/position control of
robotic manipulators, 1993; Siciliano and Villani, Robot Force Control, 1999, ch. 4, 5.

Notation, along a force axis n: ``f`` [N] what the tool exerts ON the environment, ``f_d`` what it
is to exert, ``x`` [m] the compliant frame, ``x_e`` the tip, ``K`` [N/m] the stiffness of the
contact as learned, ``v_s, a_s`` [m/s, m/s^2] velocity and acceleration of the surface as observed,
``w`` [1/s] the bandwidth, ``r`` = 10 w.

    M_f (ddx - a_s) + D_f (dx - v_s) = f_d - f + df_d / w,  D_f = K / w,  M_f = D_f / r    (FC1)
    df = K (dx_e - v_s),  dv_s = a_s,  da_s = 0, observed with three poles at -2 w         (FC2)
    K = (S_xf + s sqrt(S_xx)) / S_xx until the force is reached: an upper bound            (FC3)
    K = S_gf / S_gx from then on, g the changes of f_d: the surface makes none of them     (FC4)
    |dx| <= min(v_max, |f_d| / (K_max T)) without contact, <= v_max + v_t in one           (FC5)
    f(t + dt) = f + K (dx - v_s) dt is what (48) compensates along n in contact            (FC6)

S_xf is the mean product of the changes of x_e and f within some 30 ms, s that of the noise of f.
On a contact (FC1) with df = K dx is df = w (f_d - f) + df_d: the same on every stiffness.  With
T = sqrt(M / K_max) a mass M that hits a stiffness K_max makes the force f_d; T is a period dt at
least, in which the law cannot answer.  v_t is the speed of the desired frame across n, which a
slope of 45 deg turns into one along it; (FC5) goes over from the one to the other bound as far as
K is proven, so that noise and a bias, which are no contact, make no haste.

A contact is stiffer than the motion loop, whose efforts move the tip by (FC6) rather than by its
errors: of these only Lambda k_P / (K dt) [1/s] is left, 4 where Lambda = 4 kg meets 1e6 N/m at
200 Hz.  So in contact the frame returns to the tip, too, with the rate w / 2.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws._old.compiled import (
    Array,
    Input,
    Inputs,
    Row,
    Rows,
    entry,
    formula,
    layout,
    to_rows,
)
from eulerparams_control.laws._old.linear import (
    Vec,
    column,
    identity,
    inverse,
    mat,
    norm,
    put_vec,
    read_vec,
    vec,
)
from eulerparams_control.laws._old.matrices import Matrices
from eulerparams_control.laws.compliant_frame import LawNumbers
from eulerparams_control.motion.frames import DesiredFrame

AXES = "xyz"

# Ratios to the bandwidth of the poles of the frame (FC1), and of the observer (FC2).
_FRAME, _OBSERVER = 10.0, 2.0

# Set-points change by no more [N/s], and come with this time constant [s].
_SLEW, _SMOOTH = 200.0, 0.005

# A contact begins at this part of f_d, and at so much [N] at least, the noise of a sensor; it ends
# at half of that.
_TOUCH, _NOISE = 0.05, 0.5

# It begins beyond so many standard deviations of what is felt without contact, too, the variance of
# which [N^2] is known after this time [s], and is this one before.
_NOISES, _LISTENS, _FIRST_VARIANCE = 6.0, 0.1, 0.1

# What changes the force towards f_d by more than this many times its variance may be a contact that
# begins, and is not taken for noise.
_BEGINS = 16.0

# Changes are those within the first time [s]; what was learned counts for the next ones [s], while
# the force is not yet reached to within this part, and from then on.
_CHANGES, _FIRST, _LATER, _REACHED = 0.03, 0.1, 0.3, 0.1

# The trust in the stiffness with which the first estimate ends.
_SURE = 0.5

# Times [s] in which the stiffness follows what is learned, of both kinds, and the trust in it.
_FOLLOWS, _FOLLOWS_LATER, _TRUSTS = 0.005, 0.1, 0.05

# With this part of w the frame returns to the tip in contact.
_RETURNS = 0.5

# From no speed to the whole one (FC5): the trust in the stiffness, 3 deviations of what proves it.
_UNPROVEN, _PROVEN = 0.05, 0.3

# The mass [kg] of the compliant frame along a force axis: it scales what drives it alone.
_MASS = 1000.0

# The least stiffness that is learned [N/m], and the largest one by the one that is expected.
_SOFTEST, _STIFFER = 100.0, 10.0

# A surface gets to its speed in this time [s] at least.
_FASTEST = 0.02

# The frame gathers speed by no more [m/s^2], without contact and in it, and without with this time
# constant [s]: so the tip, which is a tick late, is hardly faster.
_ACCELERATION, _IN_CONTACT, _GATHERS = 0.5, 1.0, 0.05

# It bounces where so many contacts begin within this time [s].
_CONTACTS, _WITHIN = 3, 2.0

# The slow mean of f_d [s], of which its swing is told.
_MEAN = 0.3


class _Numbers(NamedTuple):
    """The options in numbers."""

    w: float
    v_max: float
    K_max: float
    M: float


class _SetPoint(NamedTuple):
    """The force that is asked for, its rate, and its slow mean."""

    f_d: float
    df_d: float
    mean: float


class _Surface(NamedTuple):
    """The force, and the motion of the surface, as observed (FC2)."""

    f: float
    v_s: float
    a_s: float


class _Changes(NamedTuple):
    """Of x_e, f and f_d, against their means."""

    x: float
    f: float
    g: float


class _Learned(NamedTuple):
    """K as learned, the trust in it, 0 to 1: so much of the observer acts; and its sums."""

    K: float
    trust: float
    is_reached: bool
    S_x: float
    S_f: float


class _Axis(NamedTuple):
    """What is known along an axis; ``v`` is the speed that was asked for last."""

    is_on: bool
    touches: bool
    x_e: float
    v: float
    wanted: _SetPoint
    surface: _Surface
    variance: float  # [N^2] of f without contact
    means: _Changes
    learned: _Learned


class _Wanted(NamedTuple):
    """Velocity and acceleration that the compliant frame is to have, and the change (FC6)."""

    v: float
    a: float
    change: float


_width, _read, _put, _pack, _unpack = layout(_Axis)
_, _read_law, _put_law = layout(LawNumbers)[:3]
_TOUCHES, _SPEED = 1, 3  # where in the row of an axis
_read_numbers = layout(_Numbers).read


@dataclass(frozen=True)
class ForceOptions:
    """How a force is exerted.

    Attributes:
        axes: of the compliance, of "xyz", along which there may be a force.
        bandwidth: [Hz] of the force.
        max_speed: [m/s] of the approach.
        stiffest: [N/m] of the contact that is expected.
        mass: [kg] that arrives at the contact.

    Raises:
        ConfigurationError: if a value is impossible.
    """

    axes: tuple[str, ...] = ("z",)
    bandwidth: float = 5.0
    max_speed: float = 0.02
    stiffest: float = 1e5
    mass: float = 10.0

    def __post_init__(self) -> None:
        wrong = [axis for axis in self.axes if axis not in tuple(AXES)]
        if wrong or len(set(self.axes)) != len(self.axes):
            raise ConfigurationError(
                f"force_axes is {list(self.axes)}; expected some of x, y, z, each once at most"
            )
        for name in ("bandwidth", "max_speed", "stiffest", "mass"):
            if not 0 < getattr(self, name) < math.inf:
                raise ConfigurationError(f"{name} is {getattr(self, name)}; expected > 0")

    @property
    def are_on(self) -> Array:
        """1 (3,) for each force axis, else 0."""
        return np.array([float(axis in self.axes) for axis in AXES])

    def values(self, times: float) -> Array:
        """Return the options as a row, with so many times the damping."""
        w = 2.0 * math.pi * self.bandwidth / times
        return to_rows(_Numbers, _Numbers(w, self.max_speed, self.stiffest, self.mass))


# --- one axis ------------------------------------------------------------------------------


@formula
def _clipped(value: float, most: float) -> float:
    """Return a value within -most and most."""
    return max(-most, min(most, value))


@formula
def _set(before: _SetPoint, target: float, dt: float) -> _SetPoint:
    """Return the set-point on its way to a target [N]."""
    wanted = -math.expm1(-dt / _SMOOTH) * (target - before.f_d)
    df = _clipped(wanted, _SLEW * dt)
    f_d = before.f_d + df
    return _SetPoint(f_d, df / dt, before.mean - math.expm1(-dt / _MEAN) * (f_d - before.mean))


@formula
def _observed(
    before: _Surface, know: _Learned, f: float, dx: float, most: float, w: float, dt: float
) -> _Surface:
    """Return the surface (FC2) after the tip went dx [m], to the force f; ``most`` is of v_s."""
    pole = math.exp(-_OBSERVER * w * dt)
    at = before.f + know.K * (dx - before.v_s * dt)
    missed, change = f - at, know.trust * (f - at) / (know.K * dt)
    v_s = before.v_s + before.a_s * dt - 1.5 * (1.0 - pole) ** 2 * (1.0 + pole) * change
    a_s = before.a_s - (1.0 - pole) ** 3 * change / dt
    at += (1.0 - pole**3) * missed
    return _Surface(at, _clipped(v_s, most), _clipped(a_s, most / _FASTEST))


@formula
def _landing(know: _Learned, by: _Changes, left: float, K_max: float, dt: float) -> _Learned:
    """Return the stiffness until the force is reached (FC3); ``left`` [1] is of it."""
    force = (know.K * by.x) ** 2
    weight, s = force / (force + _NOISE**2), _NOISE * math.sqrt(_FIRST / 10.0)
    stays = math.exp(-weight * dt / _FIRST)
    S_xx = stays * know.S_x + weight * by.x * by.x * dt
    S_xf = stays * know.S_f + weight * by.x * by.f * dt
    if S_xx == 0.0:
        return know
    found = max(_SOFTEST, min(_STIFFER * K_max, (S_xf + s * math.sqrt(S_xx)) / S_xx))
    K = know.K - math.expm1(-weight * dt / _FOLLOWS) * (found - know.K)
    trust = 1.0 / (1.0 + (5.0 * s) ** 2 / (K * K * S_xx))
    if left < _REACHED and trust > _SURE:
        return _Learned(K, trust, True, 0.0, 0.0)
    return _Learned(K, trust, False, S_xx, S_xf)


@formula
def _landed(know: _Learned, by: _Changes, K_max: float, dt: float) -> _Learned:
    """Return the stiffness after the force was reached (FC4)."""
    weight, K = by.g * by.g / (by.g * by.g + _NOISE**2), know.K
    stays = math.exp(-weight * dt / _LATER)
    S_gx = stays * know.S_x + weight * by.g * by.x * dt
    S_gf = stays * know.S_f + weight * by.g * by.f * dt
    if S_gx > 0.0 and S_gf > 0.0:
        found = max(_SOFTEST, min(_STIFFER * K_max, S_gf / S_gx))
        weight *= S_gf / (S_gf + 0.1 * _NOISE**2)
        K -= math.expm1(-weight * dt / _FOLLOWS_LATER) * (found - K)
    trust = know.trust - math.expm1(-dt / _TRUSTS) * (1.0 - know.trust)
    return _Learned(K, trust, True, S_gx, S_gf)


@formula
def _moved(
    axis: _Axis, target: float, f: float, dx: float, across: float, options: _Numbers, dt: float
) -> _Axis:
    """Return the axis dt [s] later.

    Args:
        axis: it.
        target: [N] what was sent.
        f: [N] now.
        dx: [m] that the tip went.
        across: [m/s] the speed across the axis, which a slope turns into that of the surface.
        options: of the law.
        dt: positive.
    """
    wanted, x_e = _set(axis.wanted, target, dt), axis.x_e + dx
    f_d, surface, means, know = wanted.f_d, axis.surface, axis.means, axis.learned
    least = max(_TOUCH * abs(f_d), _NOISE, _NOISES * math.sqrt(axis.variance))
    touches = abs(f) > (0.5 * least if axis.touches else least)
    share, variance = -math.expm1(-dt / _CHANGES), axis.variance
    x, g = means.x + share * (x_e - means.x), means.g + share * (f_d - means.g)
    means = _Changes(x, means.f + share * (f - means.f), g)
    by = _Changes(x_e - means.x, f - means.f, f_d - means.g)
    if touches != axis.touches:  # nothing is learned yet
        surface, means = _Surface(f, 0.0, 0.0), _Changes(x_e, f, f_d)
        know = _Learned(options.K_max, 0.0, False, 0.0, 0.0)
    elif not touches:
        # a contact that begins is beyond the noise, on the other side
        if by.f * f_d <= 0.0 or by.f * by.f <= _BEGINS * variance:
            variance -= math.expm1(-dt / _LISTENS) * (by.f * by.f - variance)
    else:
        surface = _observed(surface, know, f, dx, options.v_max + across, options.w, dt)
        if know.is_reached:
            know = _landed(know, by, options.K_max, dt)
        else:
            left = abs(f_d - f) / max(abs(f_d), _NOISE)
            know = _landing(know, by, left, options.K_max, dt)
    return _Axis(True, touches, x_e, axis.v, wanted, surface, variance, means, know)


@formula
def _asked(axis: _Axis, f: float, across: float, options: _Numbers, dt: float) -> _Wanted:
    """Return what the frame is to do along an axis; see :func:`_moved`."""
    wanted, surface, know = axis.wanted, axis.surface, axis.learned
    T, f_d = max(math.sqrt(options.M / options.K_max), dt), max(abs(wanted.f_d), _NOISE)
    most = min(options.v_max, f_d / (options.K_max * T))  # (FC5)
    v_s, a_s, share, most_a = 0.0, 0.0, -math.expm1(-dt / _GATHERS), _ACCELERATION
    u = most * _clipped(3.0 * (wanted.f_d - f) / f_d, 1.0)
    if axis.touches:
        v_s, a_s = surface.v_s + surface.a_s * dt, surface.a_s  # until the next tick
        share, most_a = 1.0, _IN_CONTACT
        proven = max(0.0, min(1.0, (know.trust - _UNPROVEN) / (_PROVEN - _UNPROVEN)))
        most += proven * (options.v_max + across - most)
        u = v_s + (options.w * (wanted.f_d - f) + wanted.df_d) / know.K  # (FC1)
    v = _clipped(u, most)
    if abs(v) > abs(axis.v):
        v = axis.v + _clipped(share * (v - axis.v), most_a * dt)
    change = know.K * (v - v_s) * dt if axis.touches else 0.0
    return _Wanted(v, a_s if u == v else 0.0, change)


# --- all axes ------------------------------------------------------------------------------


@entry
def _drive(
    R: Inputs, d: Input, off: Input, w: Input, target: Input, dp_d: Input, ddp_d: Input,
    numbers: Input, dt: float, state: Rows, found: Row,
) -> float:  # fmt: skip
    """Fill what drives the frame, instead of the wrench: f, mu; the swing of f_d; the change (FC6).

    Args:
        R: (3, 3) whose columns are the axes.
        d: (3,) [m] that the tip went since the tick before.
        off: (3,) [m] of the tip from the compliant frame.
        w: (6,) contact on the tool, about the centre.
        target: (3,) [N] what the tool is to exert, along the axes.
        dp_d, ddp_d: of the desired frame.
        numbers: the options.
        dt: [s] since the tick before.
        state: (3, _) of the axes; it moves on.
        found: (12,) to be filled.

    Returns:
        the rate r [1/s] of (FC1).
    """
    options, axes = _read_numbers(numbers, 0), mat(R)
    r, f, swing = _FRAME * options.w, read_vec(w, 0), Vec(0.0, 0.0, 0.0)
    ahead = Vec(0.0, 0.0, 0.0)
    v_d, a_d, force = vec(dp_d), vec(ddp_d), f
    for i in range(3):
        axis, n = _read(state[i], 0), column(axes, i)
        if axis.is_on:
            exerted = -(n @ f)
            across = norm(v_d - (n @ v_d) * n)
            if dt > 0.0:
                axis = _moved(axis, target[i], exerted, n @ vec(d), across, options, dt)
                _put(state[i], 0, axis)
            wanted = _asked(axis, exerted, across, options, dt)
            state[i, _SPEED] = wanted.v
            back = _RETURNS * options.w * (n @ vec(off)) if axis.touches else 0.0
            drive = _MASS * (r * (wanted.v + back - n @ v_d) + wanted.a - n @ a_d)
            force = force + (drive + exerted) * n
            swing = swing + (axis.wanted.f_d - axis.wanted.mean) * n
            ahead = ahead + wanted.change * n
    put_vec(found, 0, force)
    put_vec(found, 3, read_vec(w, 3))
    put_vec(found, 6, swing)
    put_vec(found, 9, ahead)
    return r


@entry
def _freed(numbers: Input, axes: Inputs, R_d: Inputs, rate: float, found: Row) -> None:
    """Fill the numbers of the law that along axes has no stiffness, and the mass ``_MASS``.

    Args:
        numbers: of the law.
        axes: (3, 3) whose columns are these axes, base frame; zero where there is none.
        R_d: of the desired frame.
        rate: [1/s] of their damping.
        found: to be filled.
    """
    law, A = _read_law(numbers, 0), mat(axes)
    if not law.in_base:
        A = mat(R_d).T @ A
    N, Z = A @ A.T, law.translation
    P = identity(1.0) - N
    M = P @ (inverse(Z.M_inverse) @ P) + _MASS * N
    D = P @ (Z.D @ P) + (_MASS * rate) * N
    translation = Matrices(inverse(M), D, P @ (Z.K @ P))
    most = max(law.rate, rate)
    freed = LawNumbers(law.options, translation, law.rotation, law.in_base, most, law.most)
    found[:] = numbers
    _put_law(found, 0, freed)


class ForceControl:
    """The force along some axes of the compliance.

    Attributes:
        options: of the law.
        is_on: whether there is one; a restart of the scheme ends it.
        axes: (3, 3) whose columns are the axes, base frame, as they were last.
        swing: (3,) [N] by which what is asked for is off its slow mean, base frame.
        ahead: (3,) [N] by which what is exerted is to change until the next tick, base frame.
    """

    def __init__(self, options: ForceOptions) -> None:
        self.options = options
        self._state = np.zeros((3, _width))
        self.reset()

    def reset(self) -> None:
        """End it."""
        self.is_on, self._target = False, np.zeros(3)
        self.restart()

    def restart(self) -> None:
        """Begin again at the force that is felt, after it was not known."""
        self._p: Array | None = None
        self._time, self._touched = 0.0, False
        self._contacts: deque[float] = deque(maxlen=_CONTACTS)
        self.swing = self.ahead = np.zeros(3)

    def press(self, target: Array) -> None:
        """Exert a force (3,) [N] on the environment, axes of the compliance, from now on."""
        self.is_on, self._target = True, target

    def _begin(self, R: Array, w: Array) -> None:
        f, on = -(R.T @ w[:3]), self.options.are_on
        for i in range(3):
            know = _Learned(self.options.stiffest, 0.0, False, 0.0, 0.0)
            known = (
                _SetPoint(f[i], 0.0, f[i]),
                _Surface(0, 0, 0),
                _FIRST_VARIANCE,
                _Changes(0, f[i], f[i]),
                know,
            )
            self._state[i] = _pack(_Axis(on[i], False, 0.0, 0.0, *known))

    def drive(
        self, dt: float, actual: DesiredFrame, compliant: DesiredFrame, desired: DesiredFrame,
        w: Array, times: float,
    ) -> tuple[Array, float]:  # fmt: skip
        """Return what drives the compliant frame, dt [s] after the last time.

        Args:
            dt: 0 or more.
            actual: the frame of the centre of compliance as measured.
            compliant: that of the last tick.
            desired: that which leads it.
            w: (6,) [N, Nm] contact on the tool, about the centre, base frame.
            times: how many times the damping there is.

        Returns:
            the drive (6,), to be taken for the wrench, and the rate [1/s] of (FC1).
        """
        R, p = actual.R_d, actual.p_d
        if self._p is None:
            self._begin(R, w)
            self._p = p
        found, d, self._p = np.empty(12), p - self._p, p
        values, state = self.options.values(times), self._state
        off, rates = p - compliant.p_d - dt * compliant.dp_d, (desired.dp_d, desired.ddp_d)
        r = _drive(R, d, off, w, self._target, *rates, values, dt, state, found)
        self._count_contacts(dt)
        self.axes, self.swing, self.ahead = R * self.options.are_on, found[6:9], found[9:]
        return found[:6], r

    def freed(self, R_d: Array, rate: float, numbers: Array) -> Array:
        """Return the :class:`LawNumbers` of a law in a row, without stiffness along the axes.

        Args:
            R_d: (3, 3) of the desired frame.
            rate: [1/s] of :meth:`drive`.
            numbers: of the law.
        """
        found = np.empty_like(numbers)
        _freed(numbers, self.axes, R_d, rate, found)
        return found

    def _count_contacts(self, dt: float) -> None:
        self._time += dt
        touches = bool(self._state[:, _TOUCHES].any())
        if touches and not self._touched:
            self._contacts.append(self._time)
        self._touched = touches

    def bounces(self) -> bool:
        """Return whether the contact was lost again and again; then look for it from the start."""
        found = len(self._contacts) == _CONTACTS and self._time - self._contacts[0] < _WITHIN
        if found:
            self._contacts.clear()
        return found

    @property
    def wanted(self) -> Array:
        """The force (3,) [N] that is asked for now, on its way to the one that was sent."""
        f_d = np.array([_unpack(row).wanted.f_d for row in self._state], dtype=float)
        return np.where(self.options.are_on, f_d, 0.0)

    @property
    def stiffness(self) -> Array:
        """The stiffness (3,) [N/m] of the contact as learned; NaN where there is no contact."""
        known = [_unpack(row) for row in self._state]
        return np.array(
            [float(axis.learned.K) if axis.is_on and axis.touches else math.nan for axis in known]
        )
