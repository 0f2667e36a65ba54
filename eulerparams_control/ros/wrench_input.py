"""The newest valid wrench of a sensor, and whether it is still to be believed."""

import math
from collections import deque
from typing import Any

import numpy as np

from eulerparams_control.control.clock import Latency, steady
from eulerparams_control.control.mode import Cause, Why
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.wrench import SensedWrench, StuckSensor
from eulerparams_control.messages.from_ros import ns_from_ros, wrench_from_ros
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.common import LATEST
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.ros.state_input import StateInput

STUCK = Why(
    Cause.WRENCH_STUCK,
    note="the wrench repeats its value to the bit while the arm moves: the sensor is stuck",
    remedy="see to the sensor and its driver; a wrench that changes is believed again",
)


def lost(note: str) -> Why:
    """Return why there is no wrench that is to be believed."""
    return Why(Cause.NO_WRENCH, note=note, remedy="see to the sensor, its driver and the network")


# Number of gaps longer than the timeout, within the longer of these times [s] and [timeouts], that
# make the rate of a sensor too low: it would be believed and not believed in turns.
_GAPS, _WITHIN, _TIMEOUTS = 3, 5.0, 50.0


def too_rare(gap: float, timeout: float) -> Why:
    """Return why wrenches are not believed that come with gaps [s]."""
    return Why(
        Cause.WRENCH_RATE_TOO_LOW,
        note=f"the wrench has gaps of up to {gap:.3g} s, but wrench_timeout is {timeout:g} s",
        remedy=f"let the sensor publish {2 / timeout:.3g} times a second or more, or set "
        f"wrench_timeout to {2 * gap:.2g} s",
    )


class WrenchInput:
    """Takes wrenches, and chooses the one for a state.

    In simulated time ages are those of the stamps, else they go by the time of receipt.  With
    pairing by the stamp a state waits for its wrench; for half the timeout in real time.

    Attributes:
        trouble: why there is no wrench to be believed, as of the last state; Why() if there is.
        repeats: whether the last message said the same as the one before, stamp included.
    """

    def __init__(self, states: StateInput, parameters: ImpedanceParameters) -> None:
        self._states, self._timeout = states, parameters.wrench_timeout
        self._is_paired = parameters.wrench_pairing != LATEST
        self._within = max(_WITHIN, _TIMEOUTS * self._timeout)
        self._latency = Latency(parameters.max_latency)
        self.forget()

    def forget(self) -> None:
        """Start again: no wrench has come."""
        self._latency.forget()
        self.repeats = self._is_new = False
        self._last: SensedWrench | None = None
        self._stamp = self._refused = -1  # [ns]
        self._may_go_back = False  # the stamp of the next one
        self._received = self._paired = -math.inf  # steady clock [s]
        self._gaps: deque[tuple[float, float]] = deque(maxlen=_GAPS)  # when they ended, and [s]
        self._stuck = StuckSensor()
        self.trouble = lost("no valid wrench yet; is the force/torque sensor running?")

    @property
    def fresh(self) -> SensedWrench | None:
        """The last wrench; None while there is none to be believed."""
        return None if self.trouble.note else self._last

    def set_back(self) -> None:
        """Expect older stamps: the clock of the robot was set back, and may be that of both."""
        self._latency.forget()
        self._may_go_back = True

    def take(self, msg: Any, sensor: Placement) -> None:
        """Take a message of a sensor that is there, seen from the tip.

        Raises:
            InvalidMessageError: if a value is not finite, the stamp repeats or goes back, or it
                comes late: what was felt a while ago pushes the arm the wrong way.
        """
        w, last, states = wrench_from_ros(msg, msg.header.frame_id), self._last, self._states
        stamp, now = ns_from_ros(msg.header.stamp), steady.now()
        # in real time, but for lock-step, what repeats itself is a driver that is stuck; a
        # simulator may repeat itself while it waits for its first answer
        may_repeat = (states.is_simulated or self._is_paired) and not states.is_commanded
        self.repeats = may_repeat and 0 < stamp == self._stamp
        if self.repeats and last is not None and np.array_equal(w, last.w):
            if states.repeats:
                self._received, self._is_new = now, True
            return
        # after a while without any a clock may have been set back
        may_go_back = self._may_go_back or now - self._received > self._timeout
        if 0 < stamp == self._stamp or (0 < stamp < self._stamp and not may_go_back):
            raise InvalidMessageError(
                f"the stamp {stamp / 1e9:.3f} s comes after {self._stamp / 1e9:.3f} s; is the "
                "sensor stuck, or is there a second one?"
            )
        if stamp > 0 and not states.is_simulated:
            self._refuse_late(stamp, now)
        if stamp < self._stamp:
            self._gaps.clear()  # a simulation that started again
        t = self._seconds(stamp, now)
        gap = t - self._seconds(self._stamp, self._received)
        if last is not None and self._timeout < gap < self._within:  # else a jump
            self._gaps.append((t, gap))
        self._last, self._stamp, self._received = SensedWrench(w, sensor), stamp, now
        self._is_new, self._may_go_back = True, False

    def _refuse_late(self, stamp: int, now: float) -> None:
        """Raise InvalidMessageError for a wrench that comes too late to control by."""
        if stamp < self._stamp:
            self._latency.forget()
        late, most = self._latency.of(stamp, now, patient=False), self._latency.most
        if late > most:
            raise InvalidMessageError(
                f"the wrench comes {late:.3f} s later than the best one, more than max_latency "
                f"{most:g} s: is the network or the computer overloaded?"
            )

    def refuse(self, msg: Any) -> None:
        """Note that a message was refused: the state of its stamp need not wait for another."""
        self._refused = ns_from_ros(msg.header.stamp)

    def is_complete(self, t: int) -> bool:
        """Whether the wrench of the state stamped t [ns] is there, or is not to be expected."""
        if self._last is None or not self._lacks(t):
            return True
        since = self._age(t) if self._states.is_simulated else steady.now() - self._paired
        return since > self._timeout / 2

    def choose(self, t: int, q: Array, limits: JointLimits) -> bool:
        """Choose the wrench for a state stamped t [ns] at q (n,); return whether it is new."""
        is_new, self._is_new = self._is_new, False
        if not self._lacks(t):
            self._paired = steady.now()
        if self._last is None:
            return False
        is_stuck = self.trouble.cause is Cause.WRENCH_STUCK
        if is_new and not self._states.is_simulated:  # what is simulated may repeat itself
            is_stuck = self._stuck.update(self._last.w, q, steady.now(), limits)
        self.trouble = self._trouble(t, is_stuck=is_stuck)
        return is_new and not self.trouble.note

    def _trouble(self, t: int, *, is_stuck: bool) -> Why:
        now = self._seconds(t, steady.now())
        if len(self._gaps) == _GAPS and 0 <= now - self._gaps[0][0] < self._within:
            if self.trouble.cause is Cause.WRENCH_RATE_TOO_LOW:
                return self.trouble  # one text, though it varies
            return too_rare(max(gap for _, gap in self._gaps), self._timeout)
        if self._age(t) > self._timeout:
            return lost(f"no valid wrench within {self._timeout:g} s; is the sensor running?")
        if self._lacks(t) and not self._states.is_simulated and self.is_complete(t):
            return lost("no wrench has the stamp of joint_states; set wrench_pairing: latest")
        return STUCK if is_stuck else Why()

    def _lacks(self, t: int) -> bool:
        """Whether the wrench of the state stamped t [ns] has not come, and counts."""
        return self._is_paired and t not in (self._stamp, self._refused)

    def _age(self, t: int) -> float:
        """Return the age [s] of the last wrench at the stamp t [ns]."""
        now, then = self._seconds(t, steady.now()), self._seconds(self._stamp, self._received)
        return abs(now - then)

    def _seconds(self, stamp: int, receipt: float) -> float:
        """Return the time [s] that counts."""
        return stamp / 1e9 if self._states.is_simulated else receipt
