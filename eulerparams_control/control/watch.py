"""Between a controller of efforts and a driver without a timeout: what is sent, and when."""

import math
from enum import StrEnum

import numpy as np

from eulerparams_control.control.admission import AT_REST
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.limits import factor_within
from eulerparams_control.laws.rotations import Array
from eulerparams_control.parameters.watchdog import WatchdogParameters
from eulerparams_control.robot.robot import Robot


class WatchMode(StrEnum):
    """What a watch does."""

    WAITING = "waiting"  # for joint_states and the first effort: nothing is sent
    PASSING = "passing"  # the efforts of the controller
    BRAKING = "braking"  # damping and gravity: the controller is silent
    HOLDING = "holding"  # the same, since the arm came to rest
    BLIND = "blind"  # gravity where the arm was seen last: joint_states are silent, too


# After a silence efforts change by no more than they may in this time [s].
_LONGEST_STEP = 0.01

_IDLE = WatchMode.WAITING, WatchMode.PASSING


class Watch:
    """Passes efforts on; brakes the arm when they stop, until it is resumed.

    tau = -k B dq + C dq + g needs neither the controller nor a pose to go back to.  Where
    joint_states are silent there is no speed to brake: g where the arm was seen last stays for
    good, since without it the arm would fall, and any other effort would drive it.
    """

    def __init__(self, robot: Robot, parameters: WatchdogParameters) -> None:
        self._robot, self._parameters = robot, parameters
        self.mode = WatchMode.WAITING
        self._q = self._dq = self._tau = np.zeros(robot.n)
        self._joins = False  # whether it goes over to the efforts of the controller
        self._seen = self._heard = self._sent = -math.inf  # when they came, or left [s]

    def effort(self, tau: Array, t: float) -> Array | None:
        """Return what is passed on of efforts (n,) that came at t [s]; None: nothing."""
        if self.mode is WatchMode.WAITING and t - self._seen < self._parameters.state_timeout:
            self.mode = WatchMode.PASSING
        self._heard = t
        if self.mode is not WatchMode.PASSING:
            return None
        tau = self._robot.limits.limit_effort(tau)[0]
        self._tau, self._sent = self._ramped(tau, t) if self._joins else tau, t
        self._joins = self._joins and bool((self._tau != tau).any())
        return self._tau

    def state(self, q: Array, dq: Array, t: float) -> Array | None:
        """Return what brakes the arm that is measured at q, dq (n,) at t [s]; None: nothing."""
        self._q, self._dq, self._seen = q, dq, t
        return self.look(t)

    def lose_sight(self) -> None:
        """See no arm: whose states come is not known; gravity where it was seen last stays."""
        self._seen = -math.inf
        self.brake()

    def look(self, t: float) -> Array | None:
        """Return what is sent at t [s] because the controller is silent; None: it is not."""
        p = self._parameters
        if self.mode is WatchMode.PASSING and t - self._heard > p.timeout:
            self.mode = WatchMode.BRAKING
        if self.mode in _IDLE:
            return None
        if t - self._seen > p.state_timeout:
            self.mode, self._dq = WatchMode.BLIND, np.zeros_like(self._dq)
        elif (np.abs(self._dq) < AT_REST).all():
            self.mode = WatchMode.HOLDING
        else:
            self.mode = WatchMode.BRAKING
        state = self._robot.dynamic_state(self._q, self._dq)
        weight = state.C_dq + (state.g if p.compensate_gravity else 0.0)
        damping, limits = -p.damping * state.B @ self._dq, self._robot.limits
        tau = weight + factor_within(weight, damping, limits.effort) * damping
        self._tau, self._sent = self._ramped(limits.limit_effort(tau)[0], t), t
        return self._tau

    def brake(self) -> bool:
        """Brake from now on, if efforts act; return whether there is nothing left to brake."""
        if self.mode is WatchMode.PASSING:
            self.mode = WatchMode.BRAKING
        return self.mode is not WatchMode.BRAKING

    def resume(self, t: float) -> None:
        """Pass efforts on again; raises InvalidMessageError unless they come and the arm rests."""
        if self.mode in _IDLE:
            return
        if t - self._heard > self._parameters.timeout or self.mode is not WatchMode.HOLDING:
            raise InvalidMessageError(
                f"not resumed: {self.mode}; expected an arm at rest, and a controller that sends "
                "joint_effort again"
            )
        self.mode, self._joins = WatchMode.PASSING, True

    def _ramped(self, tau: Array, t: float) -> Array:
        """Return the efforts (n,) within the rate from those sent last."""
        step = self._parameters.max_effort_rate * min(t - self._sent, _LONGEST_STEP)
        away, most = tau - self._tau, np.full_like(tau, step)
        return self._tau + factor_within(np.zeros_like(tau), away, most) * away
