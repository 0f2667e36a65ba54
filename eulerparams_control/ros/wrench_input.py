"""The newest valid wrench of a sensor, and whether it is still to be believed."""

import math

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.messages.from_ros import ns_from_ros, wrench_from_ros
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.common import LATEST


class WrenchInput:
    """Takes wrenches, and chooses the one for a state.

    In simulated time ages are those of the stamps, else they go by the time of receipt.  With
    pairing by the stamp a state waits for its wrench; for half the timeout in real time.

    Args:
        clock: of the node: whether time is simulated.
        pairing: "latest" or "stamp".
        timeout: [s] after which a wrench is too old.

    Attributes:
        fresh: the wrench chosen last; None while there is none to be believed.
        trouble: why there is none; "" if there is.
        repeats: whether the last message said the same as the one before, stamp included.
    """

    def __init__(self, clock: Clock, pairing: str, timeout: float) -> None:
        self._clock, self._pairing, self._timeout = clock, pairing, timeout
        self.forget()

    def forget(self) -> None:
        """Start again: no wrench has come."""
        self.repeats = False
        self.fresh: SensedWrench | None = None
        self._last: SensedWrench | None = None
        self._stamp = self._refused = -1  # [ns]
        self._received = self._paired = -math.inf  # steady clock [s]
        self._is_new = False
        self.trouble = "no valid wrench yet; is the force/torque sensor running?"

    def take(
        self, msg: WrenchStamped, sensor: Placement, *, may_repeat: bool, waits: bool
    ) -> None:
        """Take a message of a sensor.

        Args:
            msg: the message.
            sensor: where the sensor is, seen from the tip.
            may_repeat: whether a simulator may wait, and repeat itself until it is answered.
            waits: whether it does: its joint_states repeat, too.

        Raises:
            InvalidMessageError: if a value is not finite, or the stamp repeats or goes back.
        """
        w = wrench_from_ros(msg, msg.header.frame_id)
        stamp, now = ns_from_ros(msg.header.stamp), steady()
        last, self.repeats = self._last, may_repeat and 0 < stamp == self._stamp
        if self.repeats and last is not None and np.array_equal(w, last.w):
            if waits:
                self._received, self._is_new = now, True
            return
        is_old = now - self._received > self._timeout  # then a clock may have been set back
        if 0 < stamp == self._stamp or (0 < stamp < self._stamp and not is_old):
            raise InvalidMessageError(
                f"the stamp {stamp / 1e9:.3f} s comes after {self._stamp / 1e9:.3f} s; is the "
                "sensor stuck, or is there a second one?"
            )
        self._last, self._stamp, self._received = SensedWrench(w, sensor), stamp, now
        self._is_new = True

    def refuse(self, msg: WrenchStamped) -> None:
        """Note that a message was refused: the state of its stamp need not wait for another."""
        self._refused = ns_from_ros(msg.header.stamp)

    def is_complete(self, t: int) -> bool:
        """Whether the wrench of the state stamped t [ns] is there, or is not to be expected."""
        if self._pairing == LATEST or self._last is None or t in (self._stamp, self._refused):
            return True
        if self._clock.ros_time_is_active:
            return self._age(t) > self._timeout / 2
        return steady() - self._paired > self._timeout / 2

    def choose(self, t: int) -> bool:
        """Choose ``fresh`` for the state stamped t [ns]; return whether it is a new one."""
        is_new, self._is_new = self._is_new, False
        unpaired = self._pairing != LATEST and t not in (self._stamp, self._refused)
        if not unpaired:
            self._paired = steady()
        if self._last is None:
            return False
        if self._age(t) > self._timeout:
            self.trouble = f"no valid wrench within {self._timeout:g} s; is the sensor running?"
        elif unpaired and not self._clock.ros_time_is_active and self._waited:
            self.trouble = "no wrench has the stamp of joint_states; set wrench_pairing: latest"
        else:
            self.trouble = ""
        self.fresh = None if self.trouble else self._last
        return is_new and not self.trouble

    @property
    def _waited(self) -> bool:
        return steady() - self._paired > self._timeout / 2

    def _age(self, t: int) -> float:
        """Return the age [s] of the last wrench at the stamp t [ns]."""
        if self._clock.ros_time_is_active:
            return abs(t - self._stamp) / 1e9
        return steady() - self._received
