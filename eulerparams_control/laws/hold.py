"""A stop under efforts: joints are held where they stopped, against what pushed them there.

Notation: ``e`` (n,) [Nm or N] what the environment exerts on the joints; ``w`` (6,) [N, Nm] the
contact as it is measured, base frame, about the tip; ``x`` (n,) [Nm or N] what balances both;
b for braked: where the joints are to be; ``E`` (n,) effort limits; ``w_i`` [1/s] rates of the
modes V of the joints, V' B V = I, P = B V.
"""

import math
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.compiled import Array
from eulerparams_control.laws.limits import JointLimits, factor_within
from eulerparams_control.robot.robot import DynamicState

CONTACT = 20.0
"""Force [N] from which the environment is taken for a contact where it is not measured."""

MEASURED_CONTACT = 10.0
"""The same where it is measured: friction is none of it."""

# A tip that is faster than this [m/s] may feel so much [N] of the friction of its joints.
_MOVES, _HIT_IN_MOTION = 0.05, 60.0
# A joint that deviates by this [rad or m] is held by its effort limit.
_GIVES = 0.05
_ENDLESS = 1000.0  # [Nm or N] where a joint has no such limit
# w_i dt is no more, or the period of the states would make the hold oscillate.
_OF_A_PERIOD = 0.25
_SLOW_PERIOD = 0.01  # [s] where that is not known yet
# Nor is it faster than this [1/s]: commands that act 12 ms late would make light wrists swing.
_FASTEST = 40.0
# Nor is it faster than efforts that change at their rate get to this part of their limit.
_RAMPED = 0.4
# What is unknown of e is learnt at this part of w_i, slower where a rotor of the inertia [kg m^2]
# that the model may not know would make that unstable.
_LEARNT, _ROTOR = 0.25, 0.1
# It fades in this time [s] where nothing teaches it again, as under the brakes of the robot.
_FADES = 2.0
# A contact that is measured is balanced within this time [s], but none that the tip moves into
# faster than this [m/s].
_RISE_TIME, _INTO = 0.05, 0.02
# Part of E that may balance; the rest holds the joints.
_BALANCE = 0.8
# What the arm drove into is let go at this speed [m/s], until this force [N] is left, or for this
# time [s].
_RETREAT, _MAX_CLAMP_FORCE, _RETREAT_TIME = 0.05, 45.0, 1.0
# It is none that held the arm back in this time [s] by more than this part of the way: brakes do.
_SEEN, _FOLLOWS = 0.2, 0.3
# Nor is it one whose force, after so much of a way [m], is more than this part of what it was: a
# load is as heavy everywhere.
_EASES, _EASED = 0.005, 0.9
# Joints stop no faster than in this time [s]; slower than this [rad/s or m/s] they all but rest.
_SOFT, _SLOW = 0.05, 0.05

_TINY = 1e-12


# A motion works on a contact where it goes against its force by this part of it, at least.
_AGAINST = 0.3
# Where the force is not measured the tip follows by less than this part, too: friction and loads
# go along.
_BLOCKED = 0.5
# Work on a contact that has ended is forgotten in this time [s]: it may come back.
_FORGOTTEN = 0.1


class ContactWork(NamedTuple):
    """Who did the work on a contact.

    Attributes:
        led: [J] by the motion that the arm follows, against the force.
        pushed: [J] by the environment, which moved the tip.
        presses: whether the arm is told to exert the force.
    """

    led: float = 0.0
    pushed: float = 0.0
    presses: bool = False

    @property
    def is_driven_in(self) -> bool:
        """Whether the arm drove into what it touches."""
        return self.presses or self.led > max(self.pushed, 0.0)

    def after(
        self,
        dt: float,
        force: Array,
        is_measured: bool,
        dp_d: Array,
        dp_e: Array,
        presses: bool,
    ) -> "ContactWork":
        """Return the work after dt [s] in which a force (3,) [N] acted, if it is a contact.

        dp_d, dp_e (3,) [m/s] are the velocities of the motion and of the tip.
        """
        size = float(np.linalg.norm(force))
        if size < (MEASURED_CONTACT if is_measured else least_contact(dp_e)):
            left = math.exp(-dt / _FORGOTTEN)
            return ContactWork(left * self.led, left * self.pushed)
        lead, pushes = -float(force @ dp_d), float(force @ dp_e)
        is_against = lead > _AGAINST * size * float(np.linalg.norm(dp_d))
        is_against = is_against and (is_measured or -pushes < _BLOCKED * lead)
        return ContactWork(self.led + dt * lead * is_against, self.pushed + dt * pushes, presses)


UNTOUCHED = ContactWork()


class JointHold:
    """Brakes the joints, and holds them where they stop.

    Args:
        limits: of the joints; they brake within their accelerations where nothing is touched.
        rate: (n,) [Nm/s] at which the efforts may change.
        state: of the arm when this begins.
        felt: (n,) e as it is followed, begun before.
        w: the contact as it is measured, or None.
        is_driven_in: whether the arm drove into what it touches: that is let go.
    """

    def __init__(
        self,
        limits: JointLimits,
        rate: Array,
        state: DynamicState,
        felt: Array,
        w: Array | None,
        is_driven_in: bool,
    ) -> None:
        self.bound(limits, rate)
        self._is_driven_in = is_driven_in
        self._unknown = felt.copy() if w is None else np.zeros_like(felt)
        self._w = w
        self._balanced = np.zeros(6) if w is None else w
        self._period = self._retreated = self._gained = 0.0
        self._is_new = True
        self._at_first = 0.0  # the force [N] from which it retreats
        q, dq = state.arm.q.copy(), state.arm.dq.copy()
        self._q_b, self._dq_b, self._ddq_b, self._left = q, dq, np.zeros_like(q), 0.0
        force = self._force(state, felt)
        is_moving = w is None and not is_driven_in and least_contact(state.arm.dp_e) > CONTACT
        self._rubs = float(np.linalg.norm(force)) if is_moving else 0.0
        if self._is_hit(state, force, MEASURED_CONTACT):
            self._stop_at(q)  # a braking path would go on into it
        else:
            self._begin(q, dq)

    def bound(self, limits: JointLimits, rate: Array) -> None:
        """Keep to limits of the joints, and to rates (n,) [Nm/s] of the efforts, from now on."""
        self._limits = limits
        self._E = np.where(np.isfinite(limits.effort), limits.effort, _ENDLESS)
        self._fastest = min(_FASTEST, float((rate / (_RAMPED * self._E)).min()))

    def effort(
        self, dt: float, state: DynamicState, e: Array, felt: Array, w: Array | None
    ) -> Array:
        """Return the efforts (n,) that hold the joints, all terms of eq. (32) among them.

        tau = C dq + g + x + B ddq_b + D (dq_b - dq) + K (q_b - q), with K = P w^2 P', D = 2 P w P'
        and x = -J'w - the part of e that is not measured.

        Args:
            dt: [s] since the state before.
            state: of the arm.
            e: (n,) over that time; felt: the same, followed at FELT_RATE.
            w: the contact as it is measured, or None.
        """
        arm, B, C_dq, g, E = state.arm, state.B, state.C_dq, state.g, self._E
        self._period += (dt - self._period) * (0.1 if self._period > 0 else 1.0)
        w_i, V = _modes(B, E / _GIVES)
        w_i = np.minimum(w_i, min(self._fastest, _OF_A_PERIOD / (self._period or _SLOW_PERIOD)))
        P = B @ V
        K, D = (P * w_i**2) @ P.T, (P * 2 * w_i) @ P.T
        self._measure(dt, state, w)
        self._learn(dt, state, w_i, V, P, e, felt)
        self._go_on(0.0 if self._is_new else dt, state, self._force(state, felt))
        self._is_new = False
        away = self._limits.difference(self._q_b, arm.q)
        away *= factor_within(np.zeros_like(E), K @ away, E)  # where more is asked it yields
        self._q_b = arm.q + away
        weight = C_dq + g
        x = -arm.J.T @ self._balanced - np.clip(self._unknown, -E, E)
        balance = weight + factor_within(weight, x, _BALANCE * E) * x
        holds = B @ self._ddq_b + D @ (self._dq_b - arm.dq) + K @ away
        tau: Array = balance + factor_within(balance, holds, E) * holds
        return np.clip(tau, -E, E)  # the weight alone may be beyond

    def _measure(self, dt: float, state: DynamicState, w: Array | None) -> None:
        """Go on to the contact that is measured now; what is measured no more is unknown."""
        J = state.arm.J
        if (w is None) != (self._w is None):
            before = np.zeros(6) if w is None else w
            self._unknown = self._unknown + J.T @ (self._balanced - before)
            self._balanced = before
        self._w = w
        if w is None:
            return
        if np.linalg.norm(J.T @ w) <= np.linalg.norm(J.T @ self._balanced):
            self._balanced = w
        elif state.arm.dp_e @ w[:3] > -_INTO * np.linalg.norm(w[:3]):
            self._balanced = self._balanced + (1 - math.exp(-dt / _RISE_TIME)) * (
                w - self._balanced
            )

    def _learn(
        self, dt: float, state: DynamicState, w_i: Array, V: Array, P: Array, e: Array, felt: Array
    ) -> None:
        """Go on to what is unknown of e: the observer of De Luca and others, a mode at its rate."""
        measured = 0.0 if self._w is None else state.arm.J.T @ self._w
        k_i = np.minimum(_LEARNT, 1 / (1 + _ROTOR * (V**2).sum(axis=0)))
        part = 1 - np.exp(-k_i * w_i * dt)
        learnt = P @ (part * (V.T @ (e - measured - self._unknown)))
        self._unknown = math.exp(-dt / _FADES) * self._unknown + learnt
        if self._w is None:
            left, held = V.T @ felt / w_i, V.T @ self._unknown / w_i
            if left @ left < 0.5 * held @ held:  # the contact lets go
                self._unknown = felt.copy()

    def _go_on(self, dt: float, state: DynamicState, force: Array) -> None:
        """Move q_b, dq_b on, and say how they go on from there."""
        arm, limits, size = state.arm, self._limits, float(np.linalg.norm(force))
        q_b = self._q_b + dt * (self._dq_b + dt / 2 * self._ddq_b)
        self._q_b = np.clip(q_b, np.minimum(limits.lower, arm.q), np.maximum(limits.upper, arm.q))
        self._dq_b = self._dq_b + dt * self._ddq_b
        self._left = max(self._left - dt, 0.0)
        if self._is_driven_in and size > _MAX_CLAMP_FORCE and self._retreated < _RETREAT_TIME:
            self._retreated += dt
            self._gained += dt * float(arm.dp_e @ force) / size
            v = np.concatenate((_RETREAT * force / size, np.zeros(3)))
            self._stop_at(self._q_b)
            self._dq_b = np.linalg.pinv(arm.J, rcond=0.05) @ v
            self._at_first = self._at_first or size
            is_stuck = self._gained < _FOLLOWS * _RETREAT * (self._retreated - _SEEN)
            is_weight = self._gained > _EASES and size > _EASED * self._at_first
            if is_stuck or is_weight:
                self._is_driven_in = False
                self._stop_at(arm.q)
        elif self._left > 0 and self._is_hit(
            state, force, CONTACT
        ):  # on the way: what comes of that is let go, too
            self._is_driven_in |= bool(force @ (arm.J[:3] @ self._dq_b) < -_INTO * size)
            self._stop_at(arm.q)
        elif self._left > 0 and self._is_braked_by_others(arm.dq):
            self._begin(arm.q, arm.dq)
        elif self._left > 0:
            self._ddq_b = -self._dq_b / max(self._left, dt)
        else:
            self._stop_at(self._q_b)

    def _begin(self, q: Array, dq: Array) -> None:
        """Brake from q, dq (n,) on; at once where no acceleration is too large."""
        lasts = self._limits.stop_time(dq)
        if lasts == 0:
            self._stop_at(q)
            return
        self._left = max(lasts, _SOFT)
        self._q_b, self._dq_b, self._ddq_b = q, dq, -dq / self._left

    def _stop_at(self, q: Array) -> None:
        self._q_b, self._left = q, 0.0
        self._dq_b = self._ddq_b = np.zeros_like(q)

    def _is_braked_by_others(self, dq: Array) -> bool:
        speed = self._dq_b @ self._dq_b
        return bool(speed > _SLOW**2 and dq @ self._dq_b < speed / 2)

    def _is_hit(self, state: DynamicState, force: Array, least: float) -> bool:
        """Whether the tip hits something: a force (3,) [N] that is no friction of the joints."""
        if self._w is None:
            least = self._rubs + least_contact(state.arm.dp_e)
        return float(np.linalg.norm(force)) > least

    def _force(self, state: DynamicState, felt: Array) -> Array:
        """Return the force (3,) [N] of the contact on the tip."""
        return contact_force(state.arm.J, felt) if self._w is None else self._w[:3]


def least_contact(dp_e: Array) -> float:
    """Return the force [N] from which the tip, at dp_e (3,) [m/s], is taken to touch something.

    Where it is not measured: friction of joints that move looks like a contact.
    """
    return _HIT_IN_MOTION if float(np.linalg.norm(dp_e)) > _MOVES else CONTACT


def contact_force(J: Array, e: Array) -> Array:
    """Return the force (3,) [N] on the tip that exerts e (n,) on the joints, as far as one can."""
    force: Array = (np.linalg.pinv(J.T, rcond=0.05) @ e)[:3]
    return force


def _modes(B: Array, K: Array) -> tuple[Array, Array]:
    """Return the rates w_i (n,) and the modes V (n, n) of joints of the stiffness K (n,)."""
    C = np.linalg.inv(np.linalg.cholesky(B))
    squares, U = np.linalg.eigh(C @ np.diag(K) @ C.T)
    return np.sqrt(squares), C.T @ U
