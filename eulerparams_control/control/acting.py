"""What acts on the arm: the last command, and the state that it answered."""

import numpy as np

from eulerparams_control.control.admission import AT_REST, SAME, Accept
from eulerparams_control.control.clock import Instant
from eulerparams_control.control.limiter import Limiter
from eulerparams_control.control.mode import ModeEvent, stuck
from eulerparams_control.control.supervisor import Supervisor
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand, Scheme


class Acting:
    """The command that acts on the arm.

    Args:
        scheme: the control scheme.
        supervisor: keeps the mode.
        timeout: [s] without a state after which efforts must not act any more.
        q: (n,) measured positions at activation.

    Attributes:
        command: the last one; None: none acts, or the brakes are to.
        q, dq: (n,) as measured last.
    """

    def __init__(self, scheme: Scheme, supervisor: Supervisor, timeout: float, q: Array) -> None:
        self._scheme, self._supervisor, self._timeout = scheme, supervisor, timeout
        self.command: JointCommand | None = None
        self.q, self.dq = q, np.zeros_like(q)

    @property
    def is_at_rest(self) -> bool:
        """Whether the arm was measured to be at rest, and is not told to move."""
        command = self.command
        told = 0.0 if command is None or command.dq is None else command.dq
        return bool((np.maximum(np.abs(self.dq), np.abs(told)) < AT_REST).all())

    @property
    def _may_stay(self) -> bool:
        """Whether the last command does no harm for as long as one likes: a position at rest."""
        command = self.command
        if command is None or command.effort is not None or command.dq is None:
            return False
        return self.is_at_rest

    def again(self, at: Instant, state: Accept) -> JointCommand | None:
        """Return the command for the state seen last, which is seen again, if it may go on."""
        stamp, change = f"its stamp stays at {at.stamp / 1e9:g} s", self._supervisor.change
        if not state.code & SAME:
            change(ModeEvent.FAULT, stuck(f"joint_states moves, but {stamp}"))
        elif at.receipt is None or self._may_stay:
            return self.command
        elif state.acted <= self._timeout:
            return None  # it has its answer; efforts must not act for longer than states come
        else:
            change(ModeEvent.FAULT, stuck(f"joint_states repeats itself: {stamp}"))
        self.command = None
        return None  # there is no time to control by: the robot has to brake itself

    def last(self) -> JointCommand | None:
        """Return the command after which none will follow; None: the brakes act, or are to.

        Raises:
            UnsafeCommandError: if it is not finite.
        """
        if self.command is None or self._supervisor.mode.is_runaway:
            return None
        command = self._scheme.last_command(self.q, self.dq)
        return Limiter(self._supervisor.limiter.limits)(command, self.q, 0.0)
