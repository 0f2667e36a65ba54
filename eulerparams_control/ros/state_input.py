"""The newest joint_states: read, aged, counted, answered once; and whose they are."""

from collections import deque
from collections.abc import Callable, Sequence
from statistics import quantiles
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from eulerparams_control.control.admission import Admission
from eulerparams_control.control.clock import steady
from eulerparams_control.control.mode import NO_STATES, Why, contested, replaced, stuck
from eulerparams_control.errors import InvalidMessageError, listed
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import JointStateReader, ns_from_ros
from eulerparams_control.messages.joint_states import JointStateBytes
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.message_info import deserialized
from eulerparams_control.ros.publishers import names_of_publishers, unheard
from eulerparams_control.ros.ros_time import RosTime
from eulerparams_control.ros.senders import Source

# joint_states that came within this time [s] at least are fresh.
_FRESH = 0.1

# In simulated time joint_states have stopped after this time [s] of the steady clock.
_SIMULATION_STANDS = 0.5

# Number of answers whose latencies are remembered.
_REMEMBERED = 2000

MOVES = 0.05
"""A joint that is faster [rad/s or m/s] moves."""

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
    """Takes joint_states, and knows whether they still come, and whose they are.

    Args:
        node: that listens to them.
        time: of the node: whether it is simulated.
        timeout: [s] of silence, unless the states come more seldom.
        on_dispute: called when ``dispute`` has changed.

    Attributes:
        subscription: by which they come.
        source: who is believed to publish them.
        dispute: why it is not known who does; Why() if it is.
        measured: stamp [ns], q, dq (n,) of the last valid ones; None before the first.
        unanswered: their stamp as it came; None when they are answered.
        came: when the last valid ones came, steady clock [s].
        receipt: the same; None where time is simulated, so that stamps count.
        repeats: whether the last ones said the same as those before, stamp included.
        is_commanded: whether a command has answered one since it was forgotten.
        answers: how many states were answered between the last two readings.
    """

    subscription: Subscription

    def __init__(
        self, node: Node, time: RosTime, timeout: float, on_dispute: Callable[[Why], None]
    ) -> None:
        self._node, self._timeout, self._on_dispute = node, timeout, on_dispute
        self.time = time
        self._reader: JointStateReader | None = None
        self._bytes: JointStateBytes | None = None  # like those of the last valid ones
        self.source, self.dispute = Source(), Why()
        self._rivals: list[str] = []  # the names of who publish them, in a dispute
        self.came = self._stood = 0.0  # the latter: since when their stamp is the same
        self.receipt: float | None = None
        self._latencies: deque[float] = deque(maxlen=_REMEMBERED)
        self._count, self._longest, self._read_at = 0, 0.0, steady.now()
        self.answers = 0
        self.forget()

    def expect(self, robot: Robot, needs_velocity: bool) -> None:
        """Read the joints of a robot from now on."""
        self.source.forget()
        self._reader, self._bytes = JointStateReader(robot.joints, needs_velocity), None
        self._joints, self._limits = robot.joints, robot.limits

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

    @property
    def efforts(self) -> Array | None:
        """Efforts (n,) [Nm] of the last valid joint_states; None if they may brake the arm."""
        if self._reader is None or self.measured is None:
            return None
        if self._moved is not None and 0 <= self.measured[0] - self._moved < _CALM * 1e9:
            return None
        try:
            return self._reader.read(deserialized(self._last, JointState), "effort")
        except InvalidMessageError:
            return None  # it has none that can be used

    def take(self, data: bytes, number: int) -> Sequence[str]:
        """Take a message at its bytes, with its number among those of its publisher.

        Returns:
            The joints in it, if none of the arm is among them; else none.

        Raises:
            InvalidMessageError: if it is broken, or its publisher is not the one that is believed.
        """
        try:
            return self._take(data, number)
        finally:
            if self.source.is_disputed is not bool(self.dispute.fault):
                self.review_dispute()

    def _take(self, data: bytes, number: int) -> Sequence[str]:
        now, last, reader = steady.now(), self.measured, self._reader
        assert reader is not None
        found = None if self._bytes is None else self._bytes.read(data)
        if found is None:
            msg = deserialized(data, JointState)
            if not reader.concerns(msg):  # others publish their joints on the topic, too
                return list(msg.name)
        if not self.source.hear(number, now):
            raise InvalidMessageError("another publisher of joint_states is listened to")
        if found is None:
            found = msg.header.stamp, *reader.from_ros(msg)[1:]
            self._bytes = JointStateBytes(msg, self._joints) if reader.has_velocity else None
        self.unanswered, q, dq = found
        t = ns_from_ros(self.unanswered)
        state = self.measured = t, q, dq
        if last is None or t != last[0]:
            self._stood = now
        if last is not None and not self.source.is_believed and self._contradict(last, state):
            self.source.contradict(now)
        if not self.is_commanded and max(map(abs, dq.tolist())) > MOVES:
            self._moved = t
        self.repeats = last is not None and t == last[0] and np.array_equal(q, last[1])
        self._last = data
        self._count += 1
        if self.came:
            self._longest = max(self._longest, now - self.came)
        if not reader.has_velocity:
            self._mark(t, q)
        self._before, self.came = self.came, now
        self.receipt = None if self.time.is_simulated else now
        return ()

    def _contradict(self, one: State, other: State) -> bool:
        """Return whether an arm cannot have been measured so, one state after the other."""
        dt, limits = (other[0] - one[0]) / 1e9, self._limits
        way = np.abs(limits.difference(other[1], one[1]))
        return dt < 0 or bool((way > _SAME_ARM + dt * limits.velocity).any())

    def _mark(self, t: int, q: Array) -> None:
        """Remember positions q (n,) stamped t [ns] from time to time."""
        if self._marks and not 0 <= t - self._marks[-1][0] <= _LONGEST_SPAN * 1e9:
            self._marks.clear()
        if not self._marks or t - self._marks[-1][0] >= _SPAN * 1e9:
            self._marks.append((t, q))

    def motion(self, robot: Robot) -> str:
        """Return why the arm is not, or not known to be, at rest; "" if it is."""
        assert self.measured is not None
        assert self._reader is not None
        t, q, speeds = self.measured
        if not (self._reader.has_velocity or self.repeats):  # a repeated state waits for its answer
            t_0, q_0 = self._marks[0]
            span = (t - t_0) / 1e9
            if span < _SPAN:
                return "whether the arm is at rest is not known yet: joint_states has no velocities"
            speeds = self._limits.difference(q, q_0) / span
        i = int(np.abs(speeds).argmax())
        if abs(speeds[i]) <= MOVES:
            return ""
        unit = "m/s" if robot.is_prismatic[i] else "rad/s"
        return (
            f"the arm moves, {robot.joints[i]} at {speeds[i]:.3g} {unit}; expected at most "
            f"{MOVES:g}: bring it to rest"
        )

    def refused(self, admission: Admission) -> None:
        """Take the last state, which was not admitted, for one that never came."""
        self.came = self._before
        self._see_contest(admission)

    def answered(self, admission: Admission, *, is_commanded: bool) -> None:
        """Count the answer to the last state, which may be that nothing is commanded."""
        self._answered, self._period = self.came, admission.rate.period
        if is_commanded:
            self.is_commanded = True
            self._latencies.append(steady.now() - self.came)
        self._see_contest(admission)

    def _see_contest(self, admission: Admission) -> None:
        """See two publishers by states that contradict each other, where they are not numbered."""
        if admission.is_contested and not self.source.is_numbered and self._has_several():
            self.source.contradict(steady.now())
            self.review_dispute()

    # --- whether they come -----------------------------------------------------------------

    @property
    def timeout(self) -> float:
        """After which silence [s] they have stopped: not before the next one is due.

        Simulated time may stop for a while.
        """
        timeout = max(self._timeout, 2 * self._period)
        return max(timeout, _SIMULATION_STANDS) if self.time.is_simulated else timeout

    @property
    def is_silent(self) -> bool:
        """Whether they have stopped."""
        return steady.now() - self.came > self.timeout

    @property
    def is_stale(self) -> bool:
        """Whether the last valid ones are not of now."""
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

    # --- whose they are --------------------------------------------------------------------

    def doubt(self) -> Why:
        """Return why it is not known whose they are; Why() if it is, or will be soon."""
        return self.dispute if self.dispute.fault else unheard(self._node, self.subscription)

    def are_believed(self) -> bool:
        """Return whether they are believed to be the arm's, after a look at who publishes them."""
        return self.source.look(steady.now(), self._has_several)

    def _has_several(self) -> bool:
        return bool(self._node.count_publishers(self.subscription.topic_name) > 1)

    def accept(self) -> None:
        """Believe the publisher that a dispute has left; raises InvalidMessageError if two do."""
        self.source.accept(steady.now())
        self.review_dispute()
        self.refuse_in_dispute()

    def refuse_in_dispute(self) -> None:
        """Raise InvalidMessageError while it is not known whose they are."""
        if self.dispute.fault:
            raise InvalidMessageError(f"{self.dispute.fault}; {self.dispute.remedy}")

    def review_dispute(self) -> None:
        """Look again who publishes them, if that is in dispute."""
        before, self.dispute = self.dispute, Why()
        if self.source.is_disputed:
            names = names_of_publishers(self._node, self.subscription.topic_name)
            if not before.fault or len(names) >= len(self._rivals):  # who has ended is named still
                self._rivals = names
            if self.source.is_contested:
                self.dispute = contested(listed(self._rivals))
            else:
                self.dispute = replaced(listed(names))
        if self.dispute != before:
            self._on_dispute(self.dispute)

    # --- figures ---------------------------------------------------------------------------

    def read(self) -> dict[str, Any]:
        """Return the figures since it was read last, and start again."""
        now = steady.now()
        seconds = max(now - self._read_at, 1e-9)
        figures: dict[str, float | int] = {
            "joint_states per second": self._count / seconds,
            "answers per second": len(self._latencies) / seconds,
            "longest gap of joint_states [ms]": 1e3 * self._longest,
        }
        if len(self._latencies) > 1:
            cuts = quantiles(self._latencies, n=100)
            figures |= {"latency p50 [ms]": 1e3 * cuts[49], "latency p99 [ms]": 1e3 * cuts[98]}
        self.answers = len(self._latencies)
        self._latencies.clear()
        self._count, self._read_at, self._longest = 0, now, 0.0
        return figures
