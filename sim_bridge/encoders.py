"""Encoders of the joints: their counts, and the filtered rate of these."""

import math

import numpy as np

from eulerparams_control.laws.rotations import Array


class Encoders:
    """The encoders of the joints and the velocity that the drives derive from them.

    Positions are rounded to the grid 2 pi / resolution.  With a cut-off f the velocity is
    the difference quotient of the rounded positions through a first-order low pass,
    discretised exactly, at rest at first:

        dq_k = dq_k-1 + alpha ((q_k - q_k-1) / dt - dq_k-1),    alpha = 1 - exp(-2 pi f dt).

    Args:
        resolution: counts per turn (per 2 pi m if prismatic); 0 does not round.
        cutoff: f, Hz; 0 passes the velocity on.
        dt: length of a step, s.

    Attributes:
        are_exact: whether they change nothing.
    """

    def __init__(self, resolution: int, cutoff: float, dt: float) -> None:
        self.are_exact = resolution == 0 and cutoff == 0.0
        self._grid = 2.0 * math.pi / resolution if resolution else 0.0
        self._alpha = -math.expm1(-2.0 * math.pi * cutoff * dt)
        self._dt = dt
        self.reset()

    def reset(self) -> None:
        """Take the next positions for those of a robot at rest."""
        self._last: tuple[Array, Array] | None = None

    def measure(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return the measured q and dq, (n,) each, of the next step.

        Args:
            q: positions with their noise, rad; (n,).
            dq: velocities, rad/s; (n,).
        """
        if self._grid:
            q = self._grid * np.round(q / self._grid)
        if self._alpha:
            q_last, dq_last = self._last or (q, np.zeros_like(q))
            dq = dq_last + self._alpha * ((q - q_last) / self._dt - dq_last)
            self._last = q, dq
        return q, dq
