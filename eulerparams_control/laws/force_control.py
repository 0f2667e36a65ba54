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

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.impedance_matrices import Matrices
from eulerparams_control.laws.jit import Array
from eulerparams_control.laws.rotations import inverse
from eulerparams_control.motion.frames import DesiredFrame

AXES = "xyz"

_I = np.eye(3)
_FRAME, _OBSERVER = 10.0, 2.0  # poles of the frame (FC1) and of the observer (FC2), over w
_RETURNS = 0.5  # the rate with which the frame returns to the tip in contact, over w
_MASS = 1000.0  # [kg] of the compliant frame along a force axis: it scales its drive alone

# The force that is asked for: its largest rate [N/s], its time constant [s]; and the time constant
# of its slow mean [s], which its swing is measured from.
_SLEW, _SMOOTH, _MEAN = 200.0, 0.005, 0.3

# A contact begins at this part of f_d, at so much [N] at least, and beyond so many standard
# deviations of f without contact; it ends at half of that.
_TOUCH, _NOISE, _NOISES = 0.05, 0.5, 6.0

# The variance of f without contact [N^2] at first, and the time [s] in which it is known.  A change
# of the force towards f_d whose square is this many variances may be a contact that begins.
_FIRST_VARIANCE, _LISTENS, _BEGINS = 0.1, 0.1, 16.0

# Changes are those within this time [s]; they count for these times [s] until the force is reached,
# and from then on; it is reached within this part of it and with this trust in the stiffness.
_CHANGES, _FIRST, _LATER, _REACHED, _SURE = 0.03, 0.1, 0.3, 0.1, 0.5

_FOLLOWS, _FOLLOWS_LATER = 0.005, 0.1  # time constants [s] of the stiffness, (FC3) and (FC4)
_TRUSTS = 0.05  # and that of the trust in it from then on
_SOFTEST, _STIFFER = 100.0, 10.0  # least stiffness [N/m] that is learned, largest one over K_max
_UNPROVEN, _PROVEN = 0.05, 0.3  # trust with which (FC5) leaves the one bound, reaches the other
_FASTEST = 0.02  # [s] in which a surface gets to its speed, at least

# The frame gathers speed by no more [m/s^2], without contact and in it, and without with this time
# constant [s]: so the tip, which is a tick late, is hardly faster.
_ACCELERATION, _IN_CONTACT, _GATHERS = 0.5, 1.0, 0.05

_CONTACTS, _WITHIN = 3, 2.0  # it bounces where so many contacts begin within this time [s]


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


def _clipped(value: float, most: float) -> float:
    """Return a value within -most and most."""
    return max(-most, min(most, value))


def _share(dt: float, time_constant: float) -> float:
    """Return 1 - e^(-dt / T): the part of its way that a first-order lag goes in dt [s]."""
    return -math.expm1(-dt / time_constant)


@dataclass
class _SetPoint:
    """The force f_d on its way to the one that was sent, its rate, and its slow mean."""

    f_d: float
    df_d: float
    mean: float

    def move(self, target: float, dt: float) -> None:
        """Go on towards a target [N]."""
        df = _clipped(_share(dt, _SMOOTH) * (target - self.f_d), _SLEW * dt)
        self.f_d += df
        self.df_d = df / dt
        self.mean += _share(dt, _MEAN) * (self.f_d - self.mean)


@dataclass
class _Stiffness:
    """K as learned; the trust in it, 0 to 1: so much of the observer acts; the sums of its law."""

    K: float
    trust: float = 0.0
    is_reached: bool = False  # the force, in this contact: from then on (FC4), not (FC3)
    S_x: float = 0.0
    S_f: float = 0.0

    def learn_landing(self, x: float, f: float, left: float, K_max: float, dt: float) -> None:
        """Learn of changes x [m], f [N] (FC3); ``left`` is the part of f_d that is missing."""
        by_x = (self.K * x) * (self.K * x)
        weight = by_x / (by_x + _NOISE**2)
        stays = math.exp(-weight * dt / _FIRST)
        self.S_x = S_xx = stays * self.S_x + weight * x * x * dt
        self.S_f = S_xf = stays * self.S_f + weight * x * f * dt
        if S_xx == 0.0:
            return
        s = _NOISE * math.sqrt(_FIRST / 10.0)
        estimate = (S_xf + s * math.sqrt(S_xx)) / S_xx  # (FC3)
        self._follow(estimate, _share(weight * dt, _FOLLOWS), K_max)
        self.trust = self.K * self.K * S_xx / (self.K * self.K * S_xx + (5.0 * s) ** 2)
        if left < _REACHED and self.trust > _SURE:
            self.is_reached, self.S_x, self.S_f = True, 0.0, 0.0

    def learn_landed(self, x: float, f: float, g: float, K_max: float, dt: float) -> None:
        """Learn of changes x [m], f [N] and g [N] of f_d, after the force was reached (FC4)."""
        weight = g * g / (g * g + _NOISE**2)
        stays = math.exp(-weight * dt / _LATER)
        self.S_x = S_gx = stays * self.S_x + weight * g * x * dt
        self.S_f = S_gf = stays * self.S_f + weight * g * f * dt
        if S_gx > 0.0 and S_gf > 0.0:
            weight *= S_gf / (S_gf + 0.1 * _NOISE**2)
            self._follow(S_gf / S_gx, _share(weight * dt, _FOLLOWS_LATER), K_max)  # (FC4)
        self.trust += _share(dt, _TRUSTS) * (1.0 - self.trust)

    def _follow(self, estimate: float, share: float, K_max: float) -> None:
        estimate = max(_SOFTEST, min(_STIFFER * K_max, estimate))
        self.K += share * (estimate - self.K)


@dataclass
class _Surface:
    """The force, and the motion of the surface, as observed (FC2)."""

    f: float
    v_s: float = 0.0
    a_s: float = 0.0

    def observe(
        self, f: float, dx: float, contact: _Stiffness, v_max: float, w: float, dt: float
    ) -> None:
        """Go on after the tip went dx [m], to the force f; ``v_max`` [m/s] bounds v_s."""
        pole = math.exp(-_OBSERVER * w * dt)
        predicted = self.f + contact.K * (dx - self.v_s * dt)
        missed = f - predicted
        change = contact.trust * missed / (contact.K * dt)
        v_s = self.v_s + self.a_s * dt - 1.5 * (1.0 - pole) ** 2 * (1.0 + pole) * change
        a_s = self.a_s - (1.0 - pole) ** 3 * change / dt
        self.f = predicted + (1.0 - pole**3) * missed
        self.v_s, self.a_s = _clipped(v_s, v_max), _clipped(a_s, v_max / _FASTEST)


class _Axis:
    """What is known along a force axis.

    ``f`` [N] is the force now, ``across`` [m/s] the speed across the axis, which a slope turns into
    that of the surface, ``w`` [1/s] the bandwidth.

    Attributes:
        x_e: [m] the way of the tip.
        mean_x, mean_f, mean_g: of x_e, f, f_d, within the time of their changes.
        variance: [N^2] of f without contact.
        v: [m/s] the speed that the compliant frame was to have last.
    """

    def __init__(self, f: float, options: ForceOptions) -> None:
        self.touches, self.x_e, self.v, self.variance = False, 0.0, 0.0, _FIRST_VARIANCE
        self.wanted = _SetPoint(f, 0.0, f)
        self._forget(f, options)

    def _forget(self, f: float, options: ForceOptions) -> None:
        self.mean_x, self.mean_f, self.mean_g = self.x_e, f, self.wanted.f_d
        self.contact, self.surface = _Stiffness(options.stiffest), _Surface(f)

    def move(
        self, f: float, dx: float, across: float, options: ForceOptions, w: float, dt: float
    ) -> None:
        """Go on by dt [s], in which the tip went dx [m]."""
        self.x_e += dx
        f_d, K_max, share = self.wanted.f_d, options.stiffest, _share(dt, _CHANGES)
        least = max(_TOUCH * abs(f_d), _NOISE, _NOISES * math.sqrt(self.variance))
        touched, self.touches = self.touches, abs(f) > (0.5 * least if self.touches else least)
        if touched != self.touches:
            self._forget(f, options)
            return
        self.mean_x += share * (self.x_e - self.mean_x)
        self.mean_f += share * (f - self.mean_f)
        self.mean_g += share * (f_d - self.mean_g)
        by_x, by_f, by_g = self.x_e - self.mean_x, f - self.mean_f, f_d - self.mean_g
        if not self.touches:
            # a contact that begins is beyond the noise, on the other side
            if by_f * f_d <= 0.0 or by_f * by_f <= _BEGINS * self.variance:
                self.variance += _share(dt, _LISTENS) * (by_f * by_f - self.variance)
            return
        self.surface.observe(f, dx, self.contact, options.max_speed + across, w, dt)
        if self.contact.is_reached:
            self.contact.learn_landed(by_x, by_f, by_g, K_max, dt)
        else:
            left = abs(f_d - f) / max(abs(f_d), _NOISE)
            self.contact.learn_landing(by_x, by_f, left, K_max, dt)

    def lead(
        self, f: float, across: float, options: ForceOptions, w: float, dt: float
    ) -> tuple[float, float, float]:
        """Return velocity and acceleration that the frame is to have, and the change (FC6)."""
        f_d, df_d, K_max = self.wanted.f_d, self.wanted.df_d, options.stiffest
        size, T = max(abs(f_d), _NOISE), max(math.sqrt(options.mass / K_max), dt)
        v_most = min(options.max_speed, size / (K_max * T))  # (FC5)
        if not self.touches:
            u = v_most * _clipped(3.0 * (f_d - f) / size, 1.0)
            return self._gather(u, v_most, _share(dt, _GATHERS), _ACCELERATION * dt), 0.0, 0.0
        K, trust = self.contact.K, self.contact.trust
        v_s, a_s = self.surface.v_s + self.surface.a_s * dt, self.surface.a_s  # at the next tick
        proven = max(0.0, min(1.0, (trust - _UNPROVEN) / (_PROVEN - _UNPROVEN)))
        v_most += proven * (options.max_speed + across - v_most)  # (FC5)
        u = v_s + (w * (f_d - f) + df_d) / K  # (FC1)
        v = self._gather(u, v_most, 1.0, _IN_CONTACT * dt)
        a = a_s if v == u else 0.0  # none where the speed is bounded
        return v, a, K * (v - v_s) * dt  # (FC6)

    def _gather(self, u: float, v_most: float, share: float, dv_most: float) -> float:
        """Return the next speed on its way to u [m/s]; it grows by no more than dv_most."""
        v = _clipped(u, v_most)
        dv = _clipped(share * (v - self.v), dv_most)
        if abs(v) > abs(self.v) and dv != v - self.v:
            v = self.v + dv
        self.v = v
        return v


class ForceControl:
    """The force along some axes of the compliance.

    Attributes:
        options: of the law.
        is_on: whether there is one; a restart of the scheme ends it.
        axes: (3, 3) whose columns are the axes, base frame, as they were last; else zero.
        swing: (3,) [N] by which what is asked for is off its slow mean, base frame.
        ahead: (3,) [N] by which what is exerted is to change until the next tick, base frame.
    """

    def __init__(self, options: ForceOptions) -> None:
        self.options = options
        self._axes: dict[int, _Axis] = {}
        self.reset()

    def reset(self) -> None:
        """End it."""
        self.is_on, self._target = False, np.zeros(3)
        self.restart()

    def restart(self) -> None:
        """Begin again at the force that is felt, after it was not known."""
        self._p: Array | None = None
        self._time, self._touches = 0.0, False
        self._contacts: deque[float] = deque(maxlen=_CONTACTS)
        self.swing = self.ahead = np.zeros(3)

    def press(self, target: Array) -> None:
        """Exert a force (3,) [N] on the environment, axes of the compliance, from now on."""
        self.is_on, self._target = True, target

    def drive(
        self,
        dt: float,
        actual: DesiredFrame,
        compliant: DesiredFrame,
        desired: DesiredFrame,
        w: Array,
        times: float,
    ) -> tuple[Array, float]:
        """Return what drives the compliant frame, dt [s] after the last time.

        Args:
            dt: 0 or more.
            actual: the frame of the centre of compliance as measured.
            compliant: that of the last tick.
            desired: that which leads it.
            w: (6,) [N, Nm] contact on the tool, about the centre, base frame.
            times: how many times the damping there is.

        Returns:
            the drive (6,), to be taken for the wrench, and the rate r [1/s] of (FC1).
        """
        options, R, p = self.options, actual.R_d, actual.p_d
        w_f = 2.0 * math.pi * options.bandwidth / times  # the bandwidth w
        r = _FRAME * w_f
        f = (-w[:3] @ R).tolist()  # along the axes, as all that follows
        if self._p is None:
            self._p = p
            self._axes = {i: _Axis(f[i], options) for i in range(3) if AXES[i] in options.axes}
        d, self._p = ((p - self._p) @ R).tolist(), p
        off = ((p - compliant.p_d - dt * compliant.dp_d) @ R).tolist()  # of the tip from the frame
        v_d, a_d = (desired.dp_d @ R).tolist(), (desired.ddp_d @ R).tolist()
        push, swing, ahead = np.zeros((3, 3))
        for i, axis in self._axes.items():
            across = math.hypot(v_d[i - 1], v_d[i - 2])
            if dt > 0.0:
                axis.wanted.move(float(self._target[i]), dt)
                axis.move(f[i], d[i], across, options, w_f, dt)
            v, a, ahead[i] = axis.lead(f[i], across, options, w_f, dt)
            back = _RETURNS * w_f * off[i] if axis.touches else 0.0
            push[i] = _MASS * (r * (v + back - v_d[i]) + a - a_d[i]) + f[i]  # (FC1)
            swing[i] = axis.wanted.f_d - axis.wanted.mean
        self._time += dt
        touched, self._touches = self._touches, any(a.touches for a in self._axes.values())
        if self._touches and not touched:
            self._contacts.append(self._time)
        self.axes, self.swing, self.ahead = R * options.are_on, R @ swing, R @ ahead
        return np.concatenate((w[:3] + R @ push, w[3:])), r

    def freed(self, R_d: Array, rate: float, Z: Matrices, in_base: bool) -> Matrices:
        """Return the translational impedance Z, along the axes without stiffness, with ``_MASS``.

        Args:
            R_d: (3, 3) of the desired frame.
            rate: r [1/s] of :meth:`drive`, which the damping along the axes makes.
            Z: M_p^-1, D_p, K_p.
            in_base: whether these have the axes of the base; else of the desired frame.
        """
        A = self.axes if in_base else R_d.T @ self.axes
        N = A @ A.T  # onto the axes
        P = _I - N
        M = P @ inverse(Z.M_inverse) @ P + _MASS * N
        D = P @ Z.D @ P + (_MASS * rate) * N
        return Matrices(inverse(M), D, P @ Z.K @ P)

    def bounces(self) -> bool:
        """Return whether the contact was lost again and again; then look for it from the start."""
        bounces = len(self._contacts) == _CONTACTS and self._time - self._contacts[0] < _WITHIN
        if bounces:
            self._contacts.clear()
        return bounces

    @property
    def wanted(self) -> Array:
        """The force (3,) [N] that is asked for now, on its way to the one that was sent."""
        f_d = {i: axis.wanted.f_d for i, axis in self._axes.items()}
        return np.array([f_d.get(i, 0.0) for i in range(3)])

    @property
    def stiffness(self) -> Array:
        """The stiffness (3,) [N/m] of the contact as learned; NaN where there is no contact."""
        K = {i: axis.contact.K for i, axis in self._axes.items() if axis.touches}
        return np.array([K.get(i, math.nan) for i in range(3)])
