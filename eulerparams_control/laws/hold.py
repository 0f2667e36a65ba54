"""A stop under efforts: joints are held where they stopped, against what pushed them there.

Notation: ``e`` (n,) [Nm or N] external efforts: what the environment exerts on the joints; ``w``
(6,) [N, Nm] the contact wrench as it is measured, base frame, about the tip; ``x`` (n,) [Nm or N]
what balances both; b for braked: where the joints are to be; ``E`` (n,) effort limits; ``w_i``
[1/s] rates of the modes V of the joints, V' B V = I, P = B V.
"""

import math
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.inverse import symmetric_modes
from eulerparams_control.laws.limits import JointLimits, factor_within
from eulerparams_control.laws.rotations import Array, dot, norm
from eulerparams_control.robot.robot import DynamicState

# Least force [N] of a contact: as it is measured; as it is estimated, for a tip at rest, for one
# that it pushes on, and for one that it resists, which may feel the friction of its joints.  A tip
# that is slower than this [m/s] is at rest.
_MEASURED, _ESTIMATED, _ESTIMATED_PUSH, _ESTIMATED_IN_MOTION = 10.0, 20.0, 30.0, 60.0
_AT_REST = 0.05
# A person leans on an arm with this part of what its joints hold.
_LEANING_PART = 0.2
# A joint is held by its effort limit where it deviates by this [rad or m].
_FULL_EFFORT_DEVIATION = 0.05
_UNLIMITED_EFFORT = 1000.0  # [Nm or N] where a joint has no effort limit
_TINY_LEVER = 1e-3  # [m] a joint that feels a force by less does not bound it
# Largest w_i times the period [s] of the states; the period where it is not known yet.
_RATE_TIMES_PERIOD, _UNKNOWN_PERIOD = 0.25, 0.01
# No w_i is faster than efforts that change at their rate reach this part of their limit.
_PART_OF_LIMIT = 0.4
# A hold begins with w_i up to this [1/s], which bear commands that act 6 ms late, and gets faster,
# e times in this time [s], until it swings.
_LATE_RATE, _RISE_OF_RATE = 60.0, 0.6
# It swings where a joint that is faster than this [rad/s or m/s] turns so often, each peak between
# these multiples of the one before, within this time [s]; half of that w_i is the largest from then
# on.  What lets go makes a larger peak.  No hold is slower than the last rate [1/s], however noisy
# speeds are.
_REVERSALS, _SWING_SPEED, _SWING_PART, _SWING_GROWTH, _SWING_TIME = 3, 0.02, 0.7, 6.0, 0.16
_SLOWEST = 20.0
# What turns after fewer states is noise.
_SWING_STATES = 3
# The observer follows e at this part of w_i, and slower where a rotor of this inertia [kg m^2],
# which the model may lack, would make it unstable; what it holds fades in this time [s].
_OBSERVER_PART, _UNKNOWN_ROTOR, _FADE_TIME = 0.25, 0.1, 2.0
# A contact that is not measured lets go where the half of its energy is gone, at this rate [1/s].
_RELEASE_RATE = 400.0
# A measured contact is balanced within this time [s], but does not grow while the tip moves into
# it faster than this [m/s].
_RISE_TIME, _APPROACH_SPEED = 0.05, 0.02
# Part of E that may balance; the rest holds the joints.
_BALANCE_PART = 0.8
# A contact that the arm drove into is let go: at this speed [m/s], by joints no faster than this
# [rad/s or m/s], until this force [N] is left, or for this time [s].
_RETREAT_SPEED, _RETREAT_JOINT_SPEED, _CLAMP_FORCE, _RETREAT_TIME = 0.05, 0.5, 45.0, 1.0
# It is given up where the arm went less than this part of the way after this time [s]: brakes hold
# it; or where, after this way [m], more than this part of the force is left: it is a load.
_STUCK_PART, _STUCK_TIME, _LOAD_PART, _LOAD_WAY = 0.3, 0.2, 0.9, 0.005
# Joints brake for this time [s] at least; slower than this [rad/s or m/s] they all but rest.
_BRAKING_TIME, _SLOW = 0.05, 0.05
# A motion drives into a contact where it goes against its force by this part of it at least.  Where
# the force is estimated the tip has to be kept from following, to less than this part: friction
# and loads go along.
_AGAINST_PART, _BLOCKED_PART = 0.3, 0.5
# Time [s] in which the work on a contact that has ended is forgotten: it may come back.
_FORGET_TIME = 0.1
# Directions in which the tip moves by less than this part of the most are taken for lost.
_RANK = 0.05


class ContactWork(NamedTuple):
    """Who did the work on a contact."""

    driven: float = 0.0  # [J] by the motion that the arm follows, against the force
    pushed: float = 0.0  # [J] by the environment, which moved the tip
    presses: bool = False  # whether the arm is commanded to exert the force

    @property
    def drove_in(self) -> bool:
        """Whether the arm drove into what it touches."""
        return self.presses or self.driven > max(self.pushed, 0.0)

    def after(
        self, dt: float, force: Array, is_measured: bool, dp_d: Array, dp_e: Array, presses: bool
    ) -> "ContactWork":
        """Return the work after dt [s] in which a force (3,) [N] acted on the tip."""
        size = norm(force)
        if size < least_contact(is_measured, dp_e, force):
            left = math.exp(-dt / _FORGET_TIME)
            return ContactWork(left * self.driven, left * self.pushed)
        driven, drives, pushes = self.driven, -dot(force, dp_d), dot(force, dp_e)
        is_against = drives > _AGAINST_PART * size * norm(dp_d)
        if is_against and (is_measured or -pushes < _BLOCKED_PART * drives):
            driven += dt * drives
        return ContactWork(driven, self.pushed + dt * pushes, presses)


NO_CONTACT = ContactWork()


class Retreat:
    """Leads the tip away from a contact that the arm drove into, along its force."""

    def __init__(self) -> None:
        self._lasted = self._way = self._force = 0.0  # [s], [m], and the largest force [N]

    def velocity(self, dt: float, dp_e: Array, force: Array) -> Array | None:
        """Return the velocity (3,) [m/s] to go on with; None: the retreat has ended.

        Little of the force (3,) [N] is left, or brakes hold the tip, or it is that of a load.
        """
        size = norm(force)
        self._lasted, self._force = self._lasted + dt, max(self._force, size)
        self._way += dt * dot(dp_e, force) / max(size, _CLAMP_FORCE)
        is_stuck = self._way < _STUCK_PART * _RETREAT_SPEED * (self._lasted - _STUCK_TIME)
        is_load = self._way > _LOAD_WAY and size > _LOAD_PART * self._force
        if size < _CLAMP_FORCE or is_stuck or is_load or self._lasted > _RETREAT_TIME:
            return None
        return (_RETREAT_SPEED / size) * force


class _Phase(Enum):
    BRAKING = auto()
    RETREATING = auto()  # from what the arm drove into
    HELD = auto()


class JointHold:
    """Brakes the joints, and holds them where they stop.

    Where nothing is touched they brake within their accelerations.

    Args:
        limits: of the joints, to which it keeps.
        rate: (n,) [Nm/s] at which efforts may change.
        length: [m] characteristic length of the arm.
        state, e, w: the arm when this begins, and the contact as it is estimated and measured.
        drove_in: whether the arm drove into what it touches: that is let go.
    """

    def __init__(
        self,
        limits: JointLimits,
        rate: Array,
        length: float,
        state: DynamicState,
        e: Array,
        w: Array | None,
        drove_in: bool,
    ) -> None:
        n, dp_e = len(e), state.arm.dp_e
        self._phase, self._left = _Phase.HELD, 0.0  # [s] to brake
        self._q_b = self._dq_b = self._ddq_b = np.zeros(n)
        self._fastest, self._most = _LATE_RATE, math.inf
        self.limits, self.rate, self._length, self._drove_in = limits, rate, length, drove_in
        self._unmeasured = self._lately = e if w is None else np.zeros(n)
        self._w, self._balanced = w, np.zeros(6) if w is None else w
        self._period, self._is_new = 0.0, True
        self._retreat = Retreat()
        self._swing = _Swing(n)
        force = self._force(state, e)
        # [N] that a tip in motion may feel of its joints' friction already
        is_friction = w is None and not drove_in and dot(force, dp_e) <= -_AT_REST * norm(force)
        self._friction_force = norm(force) if is_friction else 0.0
        if self._touches(dp_e, force):
            self._hold_at(state.arm.q)  # a braking path would go on into it
        else:
            self._brake(state.arm.q, state.arm.dq)

    def effort(
        self, dt: float, state: DynamicState, e_now: Array, e: Array, w: Array | None
    ) -> Array:
        """Return the efforts (n,) that hold the joints, all terms of eq. (32) among them.

        tau = C dq + g + x + B ddq_b + D (dq_b - dq) + K (q_b - q), with K = P w^2 P', D = 2 P w P'
        and x = -J'w - the part of e that is not measured: e_now over the last dt [s], e over more.
        """
        arm, B, E = state.arm, state.B, self.limits.effort
        E = np.where(np.isfinite(E), E, _UNLIMITED_EFFORT)
        w_i, V = _modes(B, E / _FULL_EFFORT_DEVIATION)
        w_i = np.minimum(w_i, self._largest_rate(dt, arm.dq, E))
        P = B @ V
        K, D = (P * w_i**2) @ P.T, (P * 2 * w_i) @ P.T
        self._observe(dt, w_i, V, P, e_now - self._measure(dt, state, w))
        self._go_on(0.0 if self._is_new else dt, state, self._force(state, e))
        self._is_new = False
        away = self.limits.difference(self._q_b, arm.q)
        away *= factor_within(np.zeros_like(E), K @ away, E)  # where more is asked it yields
        self._q_b = arm.q + away
        weight = state.C_dq + state.g
        x = -arm.J.T @ self._balanced - np.clip(self._unmeasured, -E, E)
        balance = weight + factor_within(weight, x, _BALANCE_PART * E) * x
        holds = B @ self._ddq_b + D @ (self._dq_b - arm.dq) + K @ away
        tau: Array = balance + factor_within(balance, holds, E) * holds
        return np.clip(tau, -E, E)  # the weight alone may be beyond

    def _largest_rate(self, dt: float, dq: Array, E: Array) -> float:
        """Return the largest w_i that period, effort rate and latency bear."""
        self._period += (dt - self._period) * (0.1 if self._period > 0 else 1.0)
        by_efforts = float((self.rate / (_PART_OF_LIMIT * E)).min())
        largest = min(by_efforts, _RATE_TIMES_PERIOD / (self._period or _UNKNOWN_PERIOD))
        if self._swing.swings(dt, dq):
            self._most = max(self._fastest / 2, _SLOWEST)
        self._fastest = min(math.exp(dt / _RISE_OF_RATE) * self._fastest, self._most, largest)
        return self._fastest

    def _measure(self, dt: float, state: DynamicState, w: Array | None) -> Array:
        """Balance the contact that is measured now, and return what it exerts on the joints.

        One that is measured no more is unmeasured.
        """
        J = state.arm.J
        if (w is None) != (self._w is None):
            before = np.zeros(6) if w is None else w
            change = J.T @ (self._balanced - before)
            self._unmeasured, self._lately = self._unmeasured + change, self._lately + change
            self._balanced = before
        self._w = w
        if w is None:
            return np.zeros(J.shape[1])
        measured: Array = J.T @ w
        if np.linalg.norm(measured) <= np.linalg.norm(J.T @ self._balanced):
            self._balanced = w
        elif state.arm.dp_e @ w[:3] > -_APPROACH_SPEED * np.linalg.norm(w[:3]):
            part = 1 - math.exp(-dt / _RISE_TIME)
            self._balanced = self._balanced + part * (w - self._balanced)
        return measured

    def _observe(self, dt: float, w_i: Array, V: Array, P: Array, e_now: Array) -> None:
        """Go on to what is not measured of e: the observer of De Luca and others, mode by mode."""
        k_i = np.minimum(_OBSERVER_PART, 1 / (1 + _UNKNOWN_ROTOR * (V**2).sum(axis=0)))
        part = 1 - np.exp(-k_i * w_i * dt)
        change = P @ (part * (V.T @ (e_now - self._unmeasured)))
        self._unmeasured = math.exp(-dt / _FADE_TIME) * self._unmeasured + change
        self._lately = self._lately + (1 - math.exp(-_RELEASE_RATE * dt)) * (e_now - self._lately)
        if self._w is None:
            left, held = V.T @ self._lately / w_i, V.T @ self._unmeasured / w_i
            if left @ left < 0.5 * held @ held:  # the contact lets go
                self._unmeasured = np.zeros_like(e_now)

    def _go_on(self, dt: float, state: DynamicState, force: Array) -> None:
        """Move q_b, dq_b on, and decide how they go on from there."""
        arm, limits, size = state.arm, self.limits, norm(force)
        q_b = self._q_b + dt * (self._dq_b + dt / 2 * self._ddq_b)
        self._q_b = np.clip(q_b, np.minimum(limits.lower, arm.q), np.maximum(limits.upper, arm.q))
        self._dq_b = self._dq_b + dt * self._ddq_b
        if self._phase is _Phase.BRAKING:
            self._left, speed = self._left - dt, self._dq_b @ self._dq_b
            if self._touches(arm.dp_e, force):  # on the way: that was driven into, too
                approach = -float(force @ (arm.J[:3] @ self._dq_b))
                self._drove_in = self._drove_in or approach > _APPROACH_SPEED * size
                self._hold_at(arm.q)
            elif speed > _SLOW**2 and arm.dq @ self._dq_b < speed / 2:  # others brake it
                self._brake(arm.q, arm.dq)
            elif self._left > 0:
                self._ddq_b = -self._dq_b / max(self._left, dt)
            else:
                self._hold_at(self._q_b)
        if self._phase is _Phase.HELD and self._drove_in and size > _CLAMP_FORCE:
            self._phase = _Phase.RETREATING
        if self._phase is _Phase.RETREATING:
            self._go_back(dt, state, force)

    def _go_back(self, dt: float, state: DynamicState, force: Array) -> None:
        """Move away along the force of a contact, until little of it is left, or it is none."""
        arm = state.arm
        v = self._retreat.velocity(dt, arm.dp_e, force)
        if v is None:
            self._drove_in = False
            self._hold_at(arm.q)
            return
        dq_b = _speeds(arm.J, self._length) @ v
        fastest = float(np.abs(dq_b).max())
        self._dq_b = dq_b * min(1.0, _RETREAT_JOINT_SPEED / max(fastest, _SLOW))

    def _brake(self, q: Array, dq: Array) -> None:
        """Brake from q, dq (n,) on; at once where no acceleration is too large."""
        lasts = self.limits.stop_time(dq)
        if lasts == 0:
            self._hold_at(q)
            return
        self._phase, self._left = _Phase.BRAKING, max(lasts, _BRAKING_TIME)
        self._q_b, self._dq_b, self._ddq_b = q.copy(), dq.copy(), -dq / self._left

    def _hold_at(self, q: Array) -> None:
        self._phase, self._q_b = _Phase.HELD, q.copy()
        self._dq_b = self._ddq_b = np.zeros_like(q)

    def _touches(self, dp_e: Array, force: Array) -> bool:
        least = least_contact(self._w is not None, dp_e, force)
        return norm(force) > least + self._friction_force

    def _force(self, state: DynamicState, e: Array) -> Array:
        return contact_force(state.arm.J, e, self._length) if self._w is None else self._w[:3]


class _Swing:
    """Sees which of n joints swing without coming to rest."""

    def __init__(self, n: int) -> None:
        self._sign, self._peak, self._last_peak, self._age = np.zeros((4, n))
        self._count, self._states = np.zeros((2, n), dtype=int)  # states since it turned last

    def swings(self, dt: float, dq: Array) -> bool:
        """Return whether a joint at dq (n,) swings, dt [s] after the last call; once a time."""
        self._age += dt
        turned = dq * self._sign < 0
        turns = turned & (self._peak > _SWING_SPEED) & (self._states >= _SWING_STATES)
        self._states = np.where(turned, 1, self._states + 1)
        least, most = _SWING_PART * self._last_peak, _SWING_GROWTH * self._last_peak
        is_regular = (least < self._peak) & (self._peak < most) & (self._age < _SWING_TIME)
        goes_on = turns & is_regular
        self._count = np.where(turns, np.where(goes_on, self._count + 1, 1), self._count)
        self._last_peak = np.where(turns, self._peak, self._last_peak)
        self._age = np.where(turns, 0.0, self._age)
        self._peak = np.where(dq * self._sign > 0, np.maximum(self._peak, np.abs(dq)), np.abs(dq))
        self._sign = np.where(dq == 0, self._sign, np.sign(dq))
        is_swinging = bool((self._count >= _REVERSALS).any())
        if is_swinging:
            self._count[:] = 0
        return is_swinging


def least_contact(is_measured: bool, dp_e: Array, force: Array) -> float:
    """Return the least force [N] that is a contact, of a force (3,) on a tip at dp_e (3,) [m/s]."""
    if is_measured:
        return _MEASURED
    if norm(dp_e) < _AT_REST:
        return _ESTIMATED
    return _ESTIMATED_PUSH if dot(force, dp_e) > 0.0 else _ESTIMATED_IN_MOTION


def contact_force(J: Array, e: Array, length: float) -> Array:
    """Return the force (3,) [N] on the tip that exerts e (n,) on the joints, as far as one can."""
    return _speeds(J, length).T @ e


def release_rate(state: DynamicState, E: Array, fastest: float) -> float:
    """Return the rate [1/s] of states at which an arm that a hand lets go is slow enough.

    The hand leaned along an axis d of the base, with a fifth of what the joints hold: F = 0.2
    min_j (E_j - |g_j|) / |J_j' d|.  Until the next state shows that it is gone it is balanced, and
    accelerates the tip by |J B^-1 J' d| F, to ``fastest`` [m/s] at most.
    """
    J = state.arm.J[:3]
    left = np.maximum(np.where(np.isfinite(E), E, _UNLIMITED_EFFORT) - np.abs(state.g), 0.0)
    F = _LEANING_PART * (left[:, None] / np.maximum(np.abs(J.T), _TINY_LEVER)).min(axis=0)
    accelerations = np.linalg.norm(J @ np.linalg.solve(state.B, J.T), axis=0)
    return float((accelerations * F).max()) / fastest


def _speeds(J: Array, length: float) -> Array:
    """Return the pseudo-inverse (n, 3) of J, of the velocity of a tip that does not turn.

    Directions in which the tip can hardly move, ``length`` [m] weighing turns, are lost.
    """
    scale = np.array((1.0 / length,) * 3 + (1.0,) * 3)
    A = scale[:, None] * J
    modes, U = A @ A.T, np.empty((6, 6))
    symmetric_modes(modes, U)
    squares = modes.diagonal().copy()
    squares[squares <= _RANK * _RANK * squares.max()] = math.inf
    speeds: Array = A.T @ (U / squares) @ (U.T * scale)
    return speeds[:, :3]


def _modes(B: Array, K: Array) -> tuple[Array, Array]:
    """Return the rates w_i (n,) and the modes V (n, n) of joints of the stiffness K (n,)."""
    C = np.linalg.inv(np.linalg.cholesky(B))
    squares, U = np.linalg.eigh(C @ np.diag(K) @ C.T)
    return np.sqrt(squares), C.T @ U
