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
from typing import TYPE_CHECKING

import numpy as np

from eulerparams_control.laws.impedance_matrices import Matrices
from eulerparams_control.laws.jit import Array
from eulerparams_control.laws.rotations import inverse
from eulerparams_control.motion.frames import DesiredFrame

if TYPE_CHECKING:
    from eulerparams_control.parameters.impedance_control import ImpedanceParameters

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


class ForceControl:
    """The force along some axes of the compliance.

    Attributes:
        selection: (3,) 1 for each axis along which there may be a force, else 0.
        wanted: (3,) [N] that is asked for now, on its way to the one that was sent.
        stiffness: (3,) [N/m] of the contact as learned; NaN where there is no contact.
        swing: (3,) [N] by which what is asked for is off its slow mean, base frame.
        ahead: (3,) [N] by which what is exerted is to change until the next tick, base frame.
    """

    def __init__(self, parameters: "ImpedanceParameters") -> None:
        self.change(parameters)
        self.reset()

    def change(self, parameters: "ImpedanceParameters") -> None:
        """Go on with other parameters, of the same axes while a force is exerted."""
        self.selection = parameters.force_selection()
        self._mass = parameters.translation().greatest_mass
        self.parameters = parameters

    def reset(self) -> None:
        """End it."""
        self.is_on, self._target = False, np.zeros(3)
        self.restart()

    def restart(self) -> None:
        """Begin again at the force that is felt, after it was not known."""
        self._p: Array | None = None
        self._axes: dict[int, _Axis] = {}
        self._time, self._touches = 0.0, False
        self._contacts: deque[float] = deque(maxlen=_CONTACTS)
        self.wanted, self.swing, self.ahead = np.zeros((3, 3))
        self.stiffness = np.full(3, math.nan)

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
        """Return the drive (6,), which the compliant frame takes for the wrench, and r of (FC1).

        All frames, and the contact ``w`` (6,), are of the centre of compliance; ``compliant`` is
        that of the last tick.  There is so many ``times`` the damping.
        """
        parameters, R, p = self.parameters, actual.R_d, actual.p_d
        w_f = 2.0 * math.pi * parameters.force_bandwidth / times  # the bandwidth w
        r = _FRAME * w_f
        f = (-w[:3] @ R).tolist()  # along the axes, as all that follows
        if self._p is None:
            K_max, self._p = parameters.stiffest_contact, p
            self._axes = {i: _Axis(f[i], K_max) for i in range(3) if self.selection[i]}
        dx, self._p = ((p - self._p) @ R).tolist(), p
        off = ((p - compliant.p_d - dt * compliant.dp_d) @ R).tolist()  # of the tip from the frame
        v_d, a_d = (desired.dp_d @ R).tolist(), (desired.ddp_d @ R).tolist()
        push, swing, ahead = np.zeros((3, 3))
        for i, axis in self._axes.items():
            across = math.hypot(v_d[i - 1], v_d[i - 2])
            if dt > 0.0:
                axis.ask(float(self._target[i]), dt)
                axis.observe(f[i], dx[i], across, parameters, w_f, dt)
            v, a, ahead[i] = axis.lead(f[i], across, parameters, self._mass, w_f, dt)
            back = _RETURNS * w_f * off[i] if axis.touches else 0.0
            push[i] = _MASS * (r * (v + back - v_d[i]) + a - a_d[i]) + f[i]  # (FC1)
            swing[i], self.wanted[i] = axis.f_d - axis.mean, axis.f_d
            self.stiffness[i] = axis.contact.K if axis.touches else math.nan
        self._time += dt
        touched, self._touches = self._touches, any(a.touches for a in self._axes.values())
        if self._touches and not touched:
            self._contacts.append(self._time)
        self.swing, self.ahead = R @ swing, R @ ahead
        return np.concatenate((w[:3] + R @ push, w[3:])), r

    def freed(self, R: Array, rate: float, Z: Matrices) -> Matrices:
        """Return Z with ``_MASS``, D_f by the rate r, and no stiffness along the force axes.

        ``R`` (3, 3) is the compliance as measured, in the axes of Z.
        """
        N = (R * self.selection) @ R.T  # onto the axes
        P = _I - N
        M = P @ inverse(Z.M_inverse) @ P + _MASS * N
        D = P @ Z.D @ P + (_MASS * rate) * N
        return Matrices(inverse(M), D, P @ Z.K @ P)

    def bounces(self) -> bool:
        """Return whether the contact was lost again and again; then count from the start."""
        bounces = len(self._contacts) == _CONTACTS and self._time - self._contacts[0] < _WITHIN
        if bounces:
            self._contacts.clear()
        return bounces


class _Axis:
    """A force axis: f_d with its rate and slow mean, the contact, and the speed v of the frame.

    ``variance`` [N^2] is that of f without contact; ``across`` [m/s] is the speed v_t of (FC5).
    """

    def __init__(self, f: float, K_max: float) -> None:
        self.f_d, self.df_d, self.mean = f, 0.0, f
        self.touches, self.v, self.variance = False, 0.0, _FIRST_VARIANCE
        self.contact = _Contact(K_max, f, f)

    def ask(self, target: float, dt: float) -> None:
        """Let f_d go on towards a target [N]."""
        df = _clipped(_share(dt, _SMOOTH) * (target - self.f_d), _SLEW * dt)
        self.f_d += df
        self.df_d = df / dt
        self.mean += _share(dt, _MEAN) * (self.f_d - self.mean)

    def observe(
        self, f: float, dx: float, across: float, p: "ImpedanceParameters", w: float, dt: float
    ) -> None:
        f_d = self.f_d
        least = max(_TOUCH * abs(f_d), _NOISE, _NOISES * math.sqrt(self.variance))
        touched, self.touches = self.touches, abs(f) > (0.5 * least if self.touches else least)
        if touched != self.touches:
            self.contact = _Contact(p.stiffest_contact, f, f_d)
            return
        x, by_f, g = self.contact.changes(dx, f, f_d, dt)
        if self.touches:
            left = abs(f_d - f) / max(abs(f_d), _NOISE)
            self.contact.observe(f, dx, p.max_approach_speed + across, w, dt)
            self.contact.learn(x, by_f, g, left, p.stiffest_contact, dt)
        elif by_f * f_d <= 0.0 or by_f * by_f <= _BEGINS * self.variance:
            # a contact that begins is beyond the noise, on the other side
            self.variance += _share(dt, _LISTENS) * (by_f * by_f - self.variance)

    def lead(
        self, f: float, across: float, p: "ImpedanceParameters", mass: float, w: float, dt: float
    ) -> tuple[float, float, float]:
        """Return the velocity and acceleration of the frame along the axis, and K (dx - v_s) dt."""
        f_d, v_max, K_max = self.f_d, p.max_approach_speed, p.stiffest_contact
        size, T = max(abs(f_d), _NOISE), max(math.sqrt(mass / K_max), dt)
        v_most = min(v_max, size / (K_max * T))  # (FC5)
        if not self.touches:
            u = v_most * _clipped(3.0 * (f_d - f) / size, 1.0)
            return self._gather(u, v_most, _share(dt, _GATHERS), _ACCELERATION * dt), 0.0, 0.0
        K, trust, a_s = self.contact.K, self.contact.trust, self.contact.a_s
        v_s = self.contact.v_s + a_s * dt  # at the next tick
        proven = max(0.0, min(1.0, (trust - _UNPROVEN) / (_PROVEN - _UNPROVEN)))
        v_most += proven * (v_max + across - v_most)  # (FC5)
        u = v_s + (w * (f_d - f) + self.df_d) / K  # (FC1)
        v = self._gather(u, v_most, 1.0, _IN_CONTACT * dt)
        a = a_s if v == u else 0.0  # none where the speed is bounded
        return v, a, K * (v - v_s) * dt  # (FC6)

    def _gather(self, u: float, v_most: float, share: float, dv_most: float) -> float:
        """Return the next speed on its way to u; it grows by no more than dv_most."""
        v = _clipped(u, v_most)
        dv = _clipped(share * (v - self.v), dv_most)
        if abs(v) > abs(self.v) and dv != v - self.v:
            v = self.v + dv
        self.v = v
        return v


class _Contact:
    """What is learned since the tool touched last, or let go: K, and f, v_s, a_s as observed.

    ``trust`` in K, from 0 to 1, is the part of the observer that acts.  From when the force
    ``is_reached`` (FC4) counts, not (FC3), with the sums ``S_x, S_f``.
    """

    def __init__(self, K: float, f: float, f_d: float) -> None:
        self.K, self.f = K, f
        self.v_s = self.a_s = self.trust = self.S_x = self.S_f = 0.0
        self.is_reached, self._x, self._mean = False, 0.0, np.array((0.0, f, f_d))

    def changes(self, dx: float, f: float, f_d: float, dt: float) -> list[float]:
        """Return the changes of x_e, f and f_d."""
        self._x += dx
        now = np.array((self._x, f, f_d))
        self._mean += _share(dt, _CHANGES) * (now - self._mean)
        changes: list[float] = (now - self._mean).tolist()
        return changes

    def observe(self, f: float, dx: float, v_max: float, w: float, dt: float) -> None:
        """Observe (FC2); ``v_max`` [m/s] bounds v_s."""
        pole = math.exp(-_OBSERVER * w * dt)
        predicted = self.f + self.K * (dx - self.v_s * dt)
        missed = f - predicted
        change = self.trust * missed / (self.K * dt)
        v_s = self.v_s + self.a_s * dt - 1.5 * (1.0 - pole) ** 2 * (1.0 + pole) * change
        a_s = self.a_s - (1.0 - pole) ** 3 * change / dt
        self.f = predicted + (1.0 - pole**3) * missed
        self.v_s, self.a_s = _clipped(v_s, v_max), _clipped(a_s, v_max / _FASTEST)

    def learn(self, x: float, f: float, g: float, left: float, K_max: float, dt: float) -> None:
        """Learn K of the changes x, f, and g of f_d, of which the part ``left`` is missing."""
        cause, size, T = (g, g, _LATER) if self.is_reached else (x, self.K * x, _FIRST)
        weight = size * size / (size * size + _NOISE**2)
        stays = math.exp(-weight * dt / T)
        self.S_x = S_x = stays * self.S_x + weight * cause * x * dt
        self.S_f = S_f = stays * self.S_f + weight * cause * f * dt
        if self.is_reached:
            if S_x > 0.0 and S_f > 0.0:
                weight *= S_f / (S_f + 0.1 * _NOISE**2)
                self._follow(S_f / S_x, _share(weight * dt, _FOLLOWS_LATER), K_max)  # (FC4)
            self.trust += _share(dt, _TRUSTS) * (1.0 - self.trust)
        elif S_x > 0.0:
            s = _NOISE * math.sqrt(_FIRST / 10.0)
            estimate = (S_f + s * math.sqrt(S_x)) / S_x  # (FC3)
            self._follow(estimate, _share(weight * dt, _FOLLOWS), K_max)
            self.trust = self.K * self.K * S_x / (self.K * self.K * S_x + (5.0 * s) ** 2)
            if left < _REACHED and self.trust > _SURE:
                self.is_reached, self.S_x, self.S_f = True, 0.0, 0.0

    def _follow(self, estimate: float, share: float, K_max: float) -> None:
        estimate = max(_SOFTEST, min(_STIFFER * K_max, estimate))
        self.K += share * (estimate - self.K)


def _clipped(value: float, most: float) -> float:
    return max(-most, min(most, value))


def _share(dt: float, time_constant: float) -> float:
    """Return 1 - e^(-dt / T): the part of its way that a first-order lag goes in dt [s]."""
    return -math.expm1(-dt / time_constant)
