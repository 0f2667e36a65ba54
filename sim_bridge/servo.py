"""The position servo of the joints: how fast they are to move, so that they follow commands."""

import numpy as np

from eulerparams_control.laws.rotations import Array

_TURN = 2.0 * np.pi


class PositionServo:
    """Sets the speed dq = dq_s + bandwidth (q_s - q), behind a lag if there is one.

    Without a lag q_s, dq_s are the command.  With a lag tau [s] they follow its positions,
    starting where the arm is, discretised exactly; its speed is not fed forward:

        dq_s,k = alpha (q_ref - q_s,k) / dt,   q_s,k+1 = q_s,k + dt dq_s,k,
        alpha = 1 - exp(-dt / tau).

    Args:
        bandwidth: [rad/s].
        lag: tau, s; 0 is none.
        turning: (n,) whether a joint goes the short way to a position, modulo a turn.
        dt: length of a step, s.
    """

    def __init__(self, bandwidth: float, lag: float, turning: Array, dt: float) -> None:
        self._bandwidth, self._dt, self._turning = bandwidth, dt, turning
        self._may_turn = bool(turning.any())
        self._alpha = -np.expm1(-dt / lag) if lag else 0.0
        self.release()

    def release(self) -> None:
        """Follow nothing."""
        self._reference: tuple[Array, Array] | None = None  # q_ref, dq_ref
        self._lagging: Array | None = None  # q_s

    @property
    def is_on(self) -> bool:
        """Whether it follows a command."""
        return self._reference is not None

    def follow(self, q_ref: Array, dq_ref: Array, q: Array) -> None:
        """Follow a command (n,) [rad], [rad/s] from now on, the arm being at q (n,)."""
        if self._may_turn:
            turns = np.round((q - q_ref) / _TURN)
            q_ref = np.where(self._turning, q_ref + _TURN * turns, q_ref)
        self._reference = q_ref, dq_ref
        if self._alpha and self._lagging is None:
            self._lagging = q

    def speed(self, q: Array) -> Array:
        """Return the speed (n,) [rad/s] of the next step, the arm being at q (n,)."""
        assert self._reference is not None
        q_s, dq_s = self._reference
        if self._lagging is not None:
            q_s, dq_s = self._lagging, (self._alpha / self._dt) * (q_s - self._lagging)
            self._lagging = q_s + self._dt * dq_s
        speed: Array = dq_s + self._bandwidth * (q_s - q)
        return speed


def wrapped(q: Array, turning: Array) -> Array:
    """Return q (n,) with the joints that turn in (-pi, pi]."""
    return np.where(turning, q - _TURN * np.ceil((q - np.pi) / _TURN), q)
