"""A simulated robot and a controller in one process, and faults on what they tell each other."""

import copy
import math
from collections import deque
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from yardstick import Array, Product, Tick, arm_named, smooth, turn

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.messages.from_ros import JointStateReader
from eulerparams_control.ros.senders import UNNUMBERED
from sim_bridge.acceleration import BRIDGED, CommandAcceleration
from sim_bridge.drive import Drive
from sim_bridge.drive_modes import DrivePolicy
from sim_bridge.parameters import SimulatorParameters
from sim_bridge.simulator import Simulator

TIMEOUT = 0.1  # [s] of states and of commands
EPOCH = 10**12  # [ns] of the clock of the robot, so that it can be set back
STEP_RATE = 1000  # [Hz] of the simulation at least
PROTECTIVE = 1.5  # a joint this many times as fast as its limit makes the robot stop by itself
AT_REST = 0.01  # [rad/s]
BRAKING = 150.0  # [1/s] with which first efforts may brake the motion that they find
AT_ONCE = 1e-9  # [s] of rounding


class Fault(NamedTuple):
    """What goes wrong on a topic, from when to when [s], and how much."""

    topic: str
    kind: str
    at: float
    end: float
    size: float


class Row(NamedTuple):
    """A state as it came to a controller, and its command: q and dq, or efforts, or None."""

    t: float
    life: int
    stamp: int
    age: float
    q: Array
    dq: Array
    is_refused: bool
    command: Array | None


class Channel:
    """Messages on their way, in their order, through the faults of a topic.

    A message is when it was measured [s], its stamp [ns], and its numbers.
    """

    def __init__(self, faults, random, fastest):
        self.faults, self.random, self.fastest = faults, random, fastest
        self.firsts, self.held = {}, deque()

    def arrive(self, t, *sent):
        """Yield what comes at t [s]."""
        late = 0.0
        for fault in self.faults:
            if fault.at <= t < fault.end or (fault.kind == "jump" and t >= fault.at):
                late += fault.size * (fault.kind == "delay")
                sent = [m for one in sent for m in self.changed(fault, *copy.deepcopy(one))]
        self.held.extend((t + late, message) for message in sent)
        while self.held and self.held[0][0] <= t + AT_ONCE:
            yield self.held.popleft()[1]

    def changed(self, fault, measured, stamp, *numbers):
        """Return what becomes of a message."""
        random, kind, size = self.random, fault.kind, fault.size
        first = self.firsts.setdefault(fault, (measured, stamp, *numbers))
        if kind == "drop" and random.uniform() < size:
            return []
        if kind in ("stuck", "freeze"):
            return [(measured, first[1] if kind == "stuck" else stamp, *first[2:])]
        if kind == "nan":
            numbers[0][random.integers(len(numbers[0]))] = math.nan
        elif kind == "noise":
            numbers = [values + size * random.normal(size=len(values)) for values in numbers]
        elif kind == "fast":
            numbers[1][:] = size * self.fastest
        stamp += round(1e9 * size) * (kind == "jump")
        return [(measured, stamp, *numbers)] * (1 + (kind == "repeat"))


def along(poses, t, lasting):
    """Return the frame at t [s], ``lasting`` [s] from pose to pose, at rest at each."""
    k, s = divmod(max(0.0, t) / lasting, 1.0)
    (p, R), (p_1, R_1) = (poses[min(int(k) + i, len(poses) - 1)] for i in (0, 1))
    (s, ds, _), x = smooth(s), pin.log3(R.T @ R_1)
    return p + s * (p_1 - p), R @ turn(s * x), ds / lasting * (p_1 - p), ds / lasting * (R @ x)


class FaultyArm:
    """An arm with a controller.

    Args:
        law, arm, values: of the controller: its name, that of its arm, its parameters.
        rate: of the states [Hz].
        faults: of ``states`` and ``commands``.
        random: of what they do.
        fastest: (n,) [rad/s] of the joints.

    Attributes:
        rows, truth, orders: all answers; t, q, dq of the arm itself; times and names of the orders
            that were obeyed.
        may_start: whether a controller is started where there is none.
    """

    def __init__(self, law, arm, values, rate, faults, random, fastest):
        self.law, self.arm, self.values, self.rate = law, arm_named(arm), values, rate
        self.is_position, self.steps = law == "clik", max(1, round(STEP_RATE / rate))
        control, about = "position" if self.is_position else "torque", self.arm.about
        given = SimulatorParameters(
            rate=float(self.steps * rate), control=control, protective_speed=PROTECTIVE
        )
        self.simulator = Simulator(about, given)
        self.drive = Drive(self.simulator, DrivePolicy(TIMEOUT - 0.5 / rate))
        self.reader = JointStateReader(about.joints, needs_velocity=not self.is_position)
        self.states, self.commands = (
            Channel([f for f in faults if f.topic == topic], random, fastest)
            for topic in ("states", "commands")
        )
        self.rows, self.truth, self.orders = [], [], []
        self.product, self.life, self.k, self.may_start = None, 0, 0, True

    @property
    def t(self):
        """The time [s]."""
        return self.k / self.rate

    def tick(self):
        """Measure, command, move on."""
        self.truth.append((self.t, *self.simulator.motion))
        state = self.drive.state
        measured = self.t, EPOCH + round(1e9 * self.t), state.q, state.dq, state.wrench
        for found in self.states.arrive(self.t, measured):
            self._control(*found)
        self._obey()
        for _ in range(self.steps):
            self.drive.step(self.t)
        self.k += 1

    def _message(self, stamp, **numbers):
        values = {name: row.tolist() for name, row in numbers.items()}
        msg = JointState(name=list(self.arm.about.joints), **values)
        msg.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        return msg

    def _control(self, measured, stamp, q, dq, wrench):
        """Let the controller answer; one that is to begin waits for rest, as a node does."""
        try:
            _, q, dq = self.reader.from_ros(self._message(stamp, position=q, velocity=dq))
        except InvalidMessageError:
            return
        if self.product is None:
            if not self.may_start or np.abs(dq).max() > AT_REST:
                return
            self.life += 1
            sensor = self.arm.about.sensor_frame
            self.product = Product(self.law, self.arm, self.values, q, sensor)
        command = self.product.step(Tick(stamp, self.t, q, dq, wrench, ()))
        assert "defect" not in self.product.mode, self.product.controller.why
        if command is not None:
            command = command[: (1 + self.is_position) * self.arm.n]
            self._obey((self.t, stamp, *np.split(command, 1 + self.is_position)))
        about = self.t, self.life, stamp, self.t - measured, q, dq, self.product.is_refused
        self.rows.append(Row(*about, command))

    def _obey(self, *commands):
        names = ("position", "velocity") if self.is_position else ("effort",)
        for _, stamp, *numbers in self.commands.arrive(self.t, *commands):
            msg = self._message(stamp, **dict(zip(names, numbers, strict=True)))
            self.drive.command(msg, UNNUMBERED, self.t)

    def order(self, name, *given):
        """Give an order to the controller, if there is one; return whether it is obeyed."""
        if self.product is None:
            return False
        self.product.at(self.t)
        is_obeyed = self.product.order(name, *given)
        self.orders += [(self.t, name)] * is_obeyed
        return is_obeyed

    @property
    def answers(self):
        """The rows with a command."""
        return [row for row in self.rows if row.command is not None]

    def follows(self, before, row):
        """Return whether a command acts while the one before, or None, still does."""
        return before and before.life == row.life and row.t - before.t <= TIMEOUT + AT_ONCE

    def too_hard(self, most):
        """Yield positions that ask for more than ``most`` [rad/s^2], as a robot sees it.

        Of several at once it takes the last.  What came late is caught up with, and so is a gap
        where the three periods that are stepped over are more than a robot bridges.
        """
        rows, period, late, n = self.answers, 1 / self.rate, -1.0, self.arm.n
        no = np.zeros(n, dtype=bool)
        robot = CommandAcceleration(self.arm.about.joints, np.full(n, most), no, no, 1 / STEP_RATE)
        pairs = zip([None, *rows], rows, [*rows[1:], None], strict=False)
        for before, row, after in pairs if self.is_position else ():
            if not self.follows(before, row):
                robot.rest()
            gap = row.t - before.t if before else period
            is_far = gap > period + BRIDGED and 2 * period > BRIDGED
            late = row.t if is_far or (gap < period / 2 and row.stamp != before.stamp) else late
            if after is None or after.t > row.t:
                text = robot.judge(row.command[:n], row.command[n:], row.stamp, row.t, row.q)
                if text and row.t > late + TIMEOUT:
                    yield row.t, text

    def is_at(self, goal, way, angle):
        """Return whether the tip is within a way [m] and an angle [rad] of a pose."""
        p, R = self.arm.pose(self.simulator.motion[0])
        turned = np.linalg.norm(pin.log3(R.T @ goal[1]))
        return np.linalg.norm(p - goal[0]) < way and turned < angle

    def beside_weight(self, row, push):
        """Return how far [Nm] efforts are from the weight, and what brakes and balances a push."""
        model, q, dq = self.arm.model, row.q, row.dq
        data, tip = model.createData(), model.getFrameId(self.arm.about.tip_frame)
        J = pin.computeFrameJacobian(model, data, q, tip, pin.LOCAL_WORLD_ALIGNED)
        weight, B = pin.rnea(model, data, q, dq, 0 * q), np.abs(pin.crba(model, data, q))
        allowed = 1.0 + B @ np.abs(BRAKING * dq) + np.abs(J.T) @ push
        return np.abs(row.command - weight), allowed

    def tip_rates(self, path, shaken, orders):
        """Yield times [s] and the norms of speed, acceleration, jerk of the tip, to an order.

        Args:
            path: times and joints (n,).
            shaken: spans [s] in which there are none.
            orders: how many there are at most.
        """
        rates = []
        for (t_0, q_0), (t, q) in pairwise(path):
            (p_0, R_0), (p, R) = self.arm.pose(q_0), self.arm.pose(q)
            found = [self.rate * np.array([p - p_0, pin.log3(R @ R_0.T)])]
            for before in rates[: orders - 1]:
                found.append(self.rate * (found[-1] - before))
            is_next = 0.5 < (t - t_0) * self.rate < 1.5
            rates = found if is_next and not any(a <= t < b for a, b in shaken) else []
            yield t, [np.linalg.norm(rate, axis=1) for rate in rates]
