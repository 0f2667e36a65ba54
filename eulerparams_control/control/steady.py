"""The short way of a state to its command, where all goes on as it did.

What is the next state of a steady stream, along a plain motion, is taken by one compiled call,
which says where the motion is then, too.  All else, and all that is not sure, goes the long way
through :class:`Admission`, :class:`Supervisor` and :class:`Shaper`, which the short one leaves as
they would: the commands are the same to the bit.
"""

import math
from typing import NamedTuple

import numpy as np

from eulerparams_control.control.admission import Admission
from eulerparams_control.control.clock import Instant
from eulerparams_control.control.guidance import LONG, Guidance
from eulerparams_control.control.modes import ControlMode
from eulerparams_control.control.supervisor import Supervisor
from eulerparams_control.laws.rotations import Array


class _Way(NamedTuple):
    """What may go on: a mode, along a leg that starts at a stamp [ns] and lasts [s]."""

    mode: ControlMode
    start: int
    lasts: float


class Steady:
    """Takes the states of a steady stream.

    Args:
        admission, supervisor, guidance: of the controller.

    Attributes:
        detours: how many states went the long way.
    """

    def __init__(self, admission: Admission, supervisor: Supervisor, guidance: Guidance) -> None:
        self._admission, self._supervisor, self._guidance = admission, supervisor, guidance
        self._way: _Way | None = None
        self.detours = 0

    def take(self, at: Instant, q: Array, dq: Array) -> tuple[Array, float, float, Array] | None:
        """Take a state q, dq (n,) measured at an instant; None: it has to go the long way.

        Returns:
            q (n,), dt and acted [s], see :class:`Accept`, and the desired frame (24,).
        """
        way, guidance = self._way, self._guidance
        if (
            way is not None
            and way.mode is self._supervisor.mode
            and guidance.is_at_full_rate
            and (since := (at.stamp - way.start) / 1e9) <= way.lasts
        ):
            frame, rate = np.empty(24), guidance.scheme.loop_rate
            taken = self._admission.admit_steady(at, q, dq, rate, since, frame)
            if taken is not None:
                return *taken, frame
        self.detours, self._way = self.detours + 1, None
        return None

    def forget(self) -> None:
        """Let the next state go the long way."""
        self._way = None

    def expect(self, velocity: Array, patient: bool) -> None:
        """Let the states that follow one with a command go the short way, if all is plain.

        Args:
            velocity, patient: see :meth:`Admission.admit`.
        """
        mode, guidance, admission = self._supervisor.mode, self._guidance, self._admission
        motion, leg = guidance.motion, guidance.motion.leg
        if mode.is_led and guidance.is_plain and admission.goes_on and leg.segments is not None:
            longest = math.inf if motion.is_holding else LONG
            admission.expect(velocity, patient, leg.segments, longest, self._supervisor.fine_rate)
            self._way = _Way(mode, motion.start, leg.duration)
