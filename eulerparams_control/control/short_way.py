"""The short way of a state to its command, where all goes on as it did.

What is the next state of a steady stream, along a trajectory or at rest, is taken by one compiled
call, which says where the motion is then, too.  All else, and all that is not sure, goes the long
way through :class:`Admission`, :class:`Supervisor` and :class:`Shaper`.  The short one leaves them
as they would: the commands are the same to the bit.
"""

from typing import NamedTuple

import numpy as np

from eulerparams_control.control.admission import Admission, Expected
from eulerparams_control.control.clock import Instant
from eulerparams_control.control.command_limiter import CommandLimiter
from eulerparams_control.control.guidance import Guidance
from eulerparams_control.control.modes import ControlMode
from eulerparams_control.control.supervisor import Supervisor
from eulerparams_control.laws.rotations import Array


class _Way(NamedTuple):
    """What may go on.

    Attributes:
        mode: the present one.
        start, lasts: [ns] of the leg of the motion: its stamp, and how long it is followed.
        expected: what the next state is to be.
    """

    mode: ControlMode
    start: int
    lasts: float
    expected: Expected


class ShortWay:
    """Takes the states of a steady stream.

    Args:
        admission, supervisor, guidance, limiter: of the controller.

    Attributes:
        detours: how many states went the long way, those that were refused among them.
    """

    def __init__(
        self,
        admission: Admission,
        supervisor: Supervisor,
        guidance: Guidance,
        limiter: CommandLimiter,
    ) -> None:
        self._admission, self._supervisor = admission, supervisor
        self._guidance, self._limiter = guidance, limiter
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
            and (since := at.stamp - way.start) <= way.lasts
        ):
            frame, rate = np.empty(24), guidance.scheme.loop_rate
            taken = self._admission.admit_expected(
                way.expected, at, q, dq, rate, since / 1e9, frame
            )
            if taken is not None:
                return *taken, frame
        self.detours, self._way = self.detours + 1, None
        return None

    def forget(self) -> None:
        """Let the next state go the long way."""
        self._way = None

    def expect(self) -> None:
        """Let the states that follow one with a command go the short way, if all is plain."""
        supervisor, guidance, admission = self._supervisor, self._guidance, self._admission
        motion, leg, limiter = guidance.motion, guidance.motion.leg, self._limiter
        if not (supervisor.mode.is_led and guidance.is_plain and admission.goes_on):
            return
        if (segments := leg.segments) is not None:
            expected = admission.expected(
                limiter.runaway_limits, not limiter.commands_efforts, segments,
                guidance.longest_plain_step, supervisor.fine_rate,
            )  # fmt: skip
            self._way = _Way(supervisor.mode, motion.start, leg.duration * 1e9, expected)
