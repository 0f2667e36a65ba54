"""Which measured states are believed."""

import numpy as np

from eulerparams_control.control.latency import Latency
from eulerparams_control.control.runaway import AT_REST
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import Robot

# A measured position may be this far [rad or m] from where the last one could have led, a speed
# this many times its limit: further, it is the measurement that is wrong.
_MOST_ASTRAY, _MOST_SPEED = 0.1, 3.0

# So many stamps in a row that are behind, but rise, are those of a clock that was set back.
_SET_BACK = 3

# Measured positions that stay the same to the bit, while the measured speeds would have led this
# far [rad or m] away, are not measured any more.
_FROZEN = 0.01


class StateCheck:
    """Refuses states that the robot cannot have reached, and those that come too late.

    Args:
        robot: the arm.
        timeout: [s] gap in the stamps after which the arm may be anywhere.
        max_latency: [s] by which a state may come later than the best one did.
        strict: whether positions and speeds are checked; else stamps and ages only.
    """

    def __init__(self, robot: Robot, timeout: float, max_latency: float, strict: bool) -> None:
        self._robot, self._timeout, self._strict = robot, timeout, strict
        self._latency = Latency(max_latency)
        self._last: tuple[int, Array] | None = None
        self._back, self._back_at = 0, 0  # stamps in a row that are behind, and the last [ns]
        self._unmoved = np.zeros(robot.n)  # how far [rad or m] positions that stay should be

    def refuse(
        self, t: int, q: Array, dq: Array, now: float | None, *, patient: bool = False
    ) -> None:
        """Raise InvalidMessageError unless the state can be one of the robot, and of now.

        Args:
            t: stamp [ns].
            q, dq: (n,) measured.
            now: when it came, steady clock [s]; None: in simulated time nothing is late.
            patient: whether states that stay late are taken in the end.
        """
        dt = 0.0 if self._last is None else (t - self._last[0]) / 1e9
        if -self._timeout < dt < 0:
            self._note_back(t)
            raise InvalidMessageError(
                f"the stamp goes back by {-dt:g} s; is there a second publisher of joint_states?"
            )
        if self._back >= _SET_BACK:
            self._latency.forget()
        self._back = 0
        if self._strict:
            self._refuse_impossible(dt, q, dq)
        if now is not None:
            self._refuse_late(t, dt, now, patient)

    def _note_back(self, t: int) -> None:
        """Count stamps that are behind, but go on: then the clock was set back, nothing is late."""
        self._back = self._back + 1 if t > self._back_at else 1
        self._back_at = t

    def take(self, t: int, q: Array) -> None:
        """Take a state that was believed for the last one."""
        self._last = t, q

    def is_frozen(self, dt: float, q: Array, dq: Array) -> bool:
        """Whether the positions are not measured ones: they stay although the arm moves."""
        if self._last is None or not self._strict or (q != self._last[1]).any():
            self._unmoved = np.zeros(self._robot.n)
            return False
        self._unmoved = self._unmoved + dt * np.where(np.abs(dq) > AT_REST, dq, 0.0)
        return bool(np.abs(self._unmoved).max() > _FROZEN)

    def _refuse_impossible(self, dt: float, q: Array, dq: Array) -> None:
        """Raise InvalidMessageError for a state that is too fast or too far away."""
        robot = self._robot
        fast = np.abs(dq) > _MOST_SPEED * robot.limits.velocity
        if fast.any():
            i = int(np.argmax(fast))
            raise InvalidMessageError(
                f"the joint {robot.joints[i]} moves at {dq[i]:.3g} rad/s, more than "
                f"{_MOST_SPEED:g} times its limit"
            )
        if self._last is None or not 0 <= dt <= self._timeout:
            return
        moved = robot.limits.deviation(q, self._last[1])
        far = moved > _MOST_ASTRAY + _MOST_SPEED * dt * robot.limits.velocity
        if far.any():
            i = int(np.argmax(far))
            raise InvalidMessageError(
                f"the joint {robot.joints[i]} jumps by {moved[i]:.3g} rad within {dt:g} s"
            )

    def _refuse_late(self, t: int, dt: float, now: float, patient: bool) -> None:
        """Raise InvalidMessageError for a state that comes too late to control by."""
        if self._last is not None and dt == 0:
            return  # how often it may be repeated is not told by its age
        if dt < 0:
            self._latency.forget()
        late, most = self._latency.of(t, now, patient=patient), self._latency.most
        if late > most:
            raise InvalidMessageError(
                f"the state comes {late:.3f} s later than the best one, more than max_latency "
                f"{most:g} s: is the network or the computer overloaded? If they stay so late, "
                "deactivate and activate; a simulation that is not in real time needs use_sim_time"
            )
