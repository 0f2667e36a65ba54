"""The newest joint_states: read, aged, counted, answered once."""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from eulerparams_control.control.admission import Admission
from eulerparams_control.control.clock import steady
from eulerparams_control.control.mode import NO_STATES, Why, stuck
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import JointStateReader, ns_from_ros
from eulerparams_control.messages.joint_states import JointStateBytes
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.message_info import deserialized
from eulerparams_control.ros.publishers import names_of_publishers, unheard
from eulerparams_control.ros.senders import Source

# A robot whose state was answered within this time [s] at least is heard.
_FRESH = 0.1

# In simulated time joint_states have stopped after this time [s] of the steady clock.
_SIMULATION_STANDS = 0.5

# A joint that is faster [rad/s or m/s] moves.
_MOVES = 0.05

# Time [s] after an arm moved in which its efforts may brake it: they are no gravity compensation.
_CALM = 0.1

# Speeds that are not measured are differences of positions over the first time [s] at least, and
# over the second one at most.
_SPAN, _LONGEST_SPAN = 0.05, 0.5

# While it is looked at whose states come, a joint that is this distance [rad or m] from where its
# largest speed could have led it is another's.
_SAME_ARM = 0.01

State = tuple[int, Array, Array]
"""A measured state: stamp [ns], q, dq (n,)."""


class StateInput:
    """Takes joint_states, and knows whether they still come.

    Args:
        node: that listens to them.
        timeout: [s] of silence, unless the states come more seldom.
        on_dispute: called when it is, or is no more, in dispute whose they are.

    Attributes:
        subscription: by which they come.
        source: who is believed to publish them.
        measured: stamp [ns], q, dq (n,) of the last valid ones; None before the first.
        unanswered: their stamp as it came; None when they are answered.
        came: when the last valid ones came, steady clock [s].
        repeats: whether the last ones said the same as those before, stamp included.
        is_commanded: whether a command has answered one since it was forgotten.
        answers: how many states were answered between the last two readings.
        is_simulated: whether the time of the node is, so that the stamps count.
    """

    subscription: Subscription
    _robot: Robot
    _reader: JointStateReader

    def __init__(self, node: Node, timeout: float, on_dispute: Callable[[Why], None]) -> None:
        self._node, self._clock, self._timeout = node, node.get_clock(), timeout
        self.is_simulated: bool = self._clock.ros_time_is_active
        self._bytes: JointStateBytes | None = None  # like those of the last valid ones
        self.source = Source(partial(names_of_publishers, node, "joint_states"), on_dispute)
        self.came = self._stood = 0.0  # the latter: since when their stamp is the same
        self._arrivals: list[float] = []  # the last one before the last reading, and those since
        self._latencies: list[float] = []  # since then
        self._read_at, self.answers = steady.now(), 0
        self.forget()

    def expect(self, robot: Robot, needs_velocity: bool) -> None:
        """Read the joints of a robot from now on."""
        self.source.forget()
        self._reader, self._bytes = JointStateReader(robot.joints, needs_velocity), None
        self._robot = robot

    def forget(self) -> None:
        """Forget the last state."""
        self.measured: State | None = None
        self._last = b""  # the message
        self._moved: int | None = None  # stamp [ns] of the last one that moved uncommanded
        self.unanswered: Any = None
        self.is_commanded = self.repeats = False
        self._marks: deque[tuple[int, Array]] = deque(maxlen=2)  # stamps [ns] and q (n,)
        self._answered = self._before = 0.0  # when those came that were answered last [s]
        self._period = 0.0  # the usual one [s], as far as it is known

    def take(self, data: bytes, number: int) -> Sequence[str]:
        """Take a message at its bytes, with its number among those of its publisher.

        Returns:
            The joints in it, if none of the arm is among them; else none.

        Raises:
            InvalidMessageError: if it is broken, or its publisher is not the one that is believed.
        """
        now, last, reader = steady.now(), self.measured, self._reader
        self.is_simulated = self._clock.ros_time_is_active
        found = None if self._bytes is None else self._bytes.read(data)
        if found is None:
            msg = deserialized(data, JointState)
            if not reader.concerns(msg):  # others publish their joints on the topic, too
                return list(msg.name)
        self.source.hear(number, now)
        if found is None:
            found = msg.header.stamp, *reader.from_ros(msg)[1:]
            self._bytes = JointStateBytes(msg, self._robot.joints) if reader.has_velocity else None
        self.unanswered, q, dq = found
        t, self._last = ns_from_ros(self.unanswered), data
        self.measured = t, q, dq
        self.repeats = last is not None and t == last[0] and np.array_equal(q, last[1])
        if last is None or t != last[0]:
            self._stood = now
        if last is not None and not self.source.is_believed:
            dt, limits = (t - last[0]) / 1e9, self._robot.limits
            way = np.abs(limits.difference(q, last[1]))
            if dt < 0 or (way > _SAME_ARM + dt * limits.velocity).any():
                self.source.contradict(now)
        if not self.is_commanded and max(map(abs, dq.tolist())) > _MOVES:
            self._moved = t
        if not reader.has_velocity:
            self._mark(t, q)
        self._before, self.came = self.came, now
        self._arrivals.append(now)
        return ()

    def _mark(self, t: int, q: Array) -> None:
        """Remember positions q (n,) stamped t [ns] from time to time."""
        if self._marks and not 0 <= t - self._marks[-1][0] <= _LONGEST_SPAN * 1e9:
            self._marks.clear()
        if not self._marks or t - self._marks[-1][0] >= _SPAN * 1e9:
            self._marks.append((t, q))

    def motion(self) -> str:
        """Return why the arm is not, or not known to be, at rest; "" if it is."""
        assert self.measured is not None
        (t, q, speeds), robot = self.measured, self._robot
        if not (self._reader.has_velocity or self.repeats):  # a repeated state waits for its answer
            t_0, q_0 = self._marks[0]
            span = (t - t_0) / 1e9
            if span < _SPAN:
                return "whether the arm is at rest is not known yet: joint_states has no velocities"
            speeds = robot.limits.difference(q, q_0) / span
        i = int(np.abs(speeds).argmax())
        if abs(speeds[i]) <= _MOVES:
            return ""
        unit = "m/s" if robot.is_prismatic[i] else "rad/s"
        return (
            f"the arm moves, {robot.joints[i]} at {speeds[i]:.3g} {unit}; expected at most "
            f"{_MOVES:g}: bring it to rest"
        )

    @property
    def efforts(self) -> Array | None:
        """Efforts (n,) [Nm] of the last valid joint_states; None if they may brake the arm."""
        if self.measured is None:
            return None
        if self._moved is not None and 0 <= self.measured[0] - self._moved < _CALM * 1e9:
            return None
        try:
            return self._reader.read(deserialized(self._last, JointState), "effort")
        except InvalidMessageError:
            return None  # it has none that can be used

    def refused(self, admission: Admission) -> None:
        """Take the last state, which was not admitted, for one that never came."""
        self.came = self._before
        if admission.is_contested:
            self.source.see_contest(steady.now())

    def answered(self, admission: Admission, *, is_commanded: bool) -> None:
        """Count the answer to the last state, which may be that nothing is commanded."""
        self._answered, self._period = self.came, admission.rate.period
        if is_commanded:
            self.is_commanded = True
            self._latencies.append(steady.now() - self.came)
        if admission.is_contested:
            self.source.see_contest(steady.now())

    # --- whether they come -----------------------------------------------------------------

    @property
    def receipt(self) -> float | None:
        """When the last valid ones came [s]; None where the stamps count."""
        return None if self.is_simulated else self.came

    @property
    def timeout(self) -> float:
        """After which silence [s] they have stopped: not before the next one is due.

        Simulated time may stop for a while.
        """
        least = _SIMULATION_STANDS if self.is_simulated else 0.0
        return max(self._timeout, 2 * self._period, least)

    @property
    def is_silent(self) -> bool:
        """Whether they have stopped."""
        return steady.now() - self.came > self.timeout

    @property
    def is_stale(self) -> bool:
        """Whether an arm must not be activated where the last valid ones have it."""
        return steady.now() - self.came > max(self._timeout, _FRESH)

    @property
    def is_followed(self) -> bool:
        """Whether a robot that was commanded still tells its state."""
        return self.is_commanded and steady.now() - self._answered <= max(self._timeout, _FRESH)

    @property
    def stands(self) -> bool:
        """Whether states come and are answered, but under one stamp.

        A robot in lock-step may wait so while its controller waits for a reference.
        """
        return self.is_commanded and self.came - self._stood > self.timeout

    def standing(self) -> Why:
        """Return why there is no time to move by, where time stands."""
        t = self.measured[0] if self.measured is not None else 0
        return stuck(f"joint_states come, but their stamp stays at {t / 1e9:g} s")

    def silent(self) -> Why:
        """Return why nothing is commanded, where they have stopped."""
        return NO_STATES._replace(
            fault=f"no valid joint_states within {self.timeout:g} s: no commands; is the robot "
            "running?"
        )

    # --- whose they are, and how many ------------------------------------------------------

    def doubt(self) -> Why:
        """Return why it is not known whose they are; Why() if it is, or will be soon."""
        dispute = self.source.dispute
        return dispute if dispute.fault else unheard(self._node, self.subscription)

    def read(self) -> dict[str, Any]:
        """Return the figures since it was read last, and start again."""
        gaps, now, latencies = np.diff(self._arrivals), steady.now(), self._latencies
        seconds, self._read_at = max(now - self._read_at, 1e-9), now
        self.answers, self._arrivals, self._latencies = len(latencies), self._arrivals[-1:], []
        figures = {
            "joint_states per second": len(gaps) / seconds,
            "answers per second": self.answers / seconds,
            "longest gap of joint_states [ms]": 1e3 * gaps.max(initial=0.0),
        }
        if latencies:
            p50, p99 = 1e3 * np.percentile(latencies, (50, 99))
            figures |= {"latency p50 [ms]": p50, "latency p99 [ms]": p99}
        return figures
