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

from eulerparams_control.control.mode import Cause
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
LEAST_TOUCH = 5.0  # [N]
AT_REST, COMES_TO_REST = 0.01, 0.5  # [rad/s], [s] in which the hold of a stop brakes
BRAKING = 150.0  # [1/s] with which first efforts may brake the motion that they find
# A hand leans with this part of what the joints can exert; it presses with no more than they bear
# with the second part of their efforts, a weight at first with no more than with the third.
FIFTH, BEARABLE, LIFTED = 0.2, 0.8, 0.6
# [s] after which it leans on an arm that was halted, in which it comes to its force, and for which
# it has gone before somebody resumes
REACHES, GROWS, GONE = 0.5, 0.2, 0.3
LEADS = ("follow", "stream", "aim", "jog")  # orders that move the arm
AT_ONCE = 1e-9  # [s] of rounding
SAME = 1e-9  # relative difference of two joints that are cut each for itself
RUBBED = 0.02, 0.2  # [m], [rad] that friction keeps an arm away from where it is sent, at most
FASTEST_HAND = 1.0  # [m/s] at which a hand that follows the tip exerts nothing any more
# What textbook joints lack, and what they are.
REAL = {"friction_viscous": (1.0,), "friction_coulomb": (0.5,), "rotor_inertia": (0.1,)}


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
    is_stopped: bool
    command: Array | None


class Moment(NamedTuple):
    """The arm itself, what its controller does, and what touches it."""

    t: float
    q: Array
    dq: Array
    life: int
    is_stopped: bool
    is_held: bool  # where it stopped
    cause: str
    touched: float  # [N]


class Touch(NamedTuple):
    """What touches the tip: a wrench (6,) [N, Nm], axes of the world; a hand follows the tip."""

    wrench: Array
    is_hand: bool

    def at(self, dp_e):
        """Return the wrench (6,) on a tip at dp_e (3,) [m/s]."""
        along = dp_e @ self.wrench[:3] / max(np.linalg.norm(self.wrench[:3]), AT_ONCE)
        return self.wrench * max(0.0, 1.0 - self.is_hand * along / FASTEST_HAND)


class Order(NamedTuple):
    """An order that was given to a controller at a time [s]."""

    t: float
    name: str
    is_obeyed: bool


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
        joints: of the simulator: their friction and rotors.

    Attributes:
        rows, truth, asked: all answers, moments and orders.
        touching: what touches the tip, by names; ``hardest`` (6,) of each component so far.
        may_start: whether a controller is started where there is none.
    """

    def __init__(self, law, arm, values, rate, faults, random, fastest, joints):
        self.law, self.arm, self.values, self.rate = law, arm_named(arm), values, rate
        self.friction = joints["friction_viscous"][0], joints["friction_coulomb"][0]
        self.is_position, self.steps = law == "clik", max(1, round(STEP_RATE / rate))
        control, about = "position" if self.is_position else "torque", self.arm.about
        given = SimulatorParameters(
            rate=float(self.steps * rate),
            control=control,
            protective_speed=PROTECTIVE,
            **joints,
        )
        self.simulator = Simulator(about, given)
        self.drive = Drive(self.simulator, DrivePolicy(TIMEOUT - 0.5 / rate))
        self.reader = JointStateReader(about.joints, needs_velocity=not self.is_position)
        self.states, self.commands = (
            Channel([f for f in faults if f.topic == topic], random, fastest)
            for topic in ("states", "commands")
        )
        self.rows, self.truth, self.asked = [], [], []
        self.touching, self.hardest = {}, np.zeros(6)
        self._parts, self._stopped = {}, {}
        self.product, self.life, self.k, self.may_start = None, 0, 0, True

    @property
    def t(self):
        """The time [s]."""
        return self.k / self.rate

    @property
    def is_stopped(self):
        """Whether there is a controller that keeps the arm stopped."""
        return self.product is not None and self.product.controller.state.is_halted

    def tick(self):
        """Measure, command, move on."""
        is_stopped, cause, is_held = self.is_stopped, Cause.NONE, False
        if is_stopped:
            controller = self.product.controller
            cause, is_held = controller.why.cause, not controller.guidance.is_braking
        touched = np.linalg.norm(sum(touch.wrench[:3] for touch in self.touching.values()))
        life = self.life if self.product else 0
        about = life, is_stopped, is_held, cause, float(touched)
        self.truth.append(Moment(self.t, *self.simulator.motion, *about))
        state = self.drive.state
        measured = self.t, EPOCH + round(1e9 * self.t), state.q, state.dq, state.wrench
        for found in self.states.arrive(self.t, measured):
            self._control(*found)
        self._obey()
        for _ in range(self.steps):
            self._touch()
            self.drive.step(self.t)
        self.k += 1

    def press(self, fault, wrench):
        """Let a wrench act as a fault says, as far as the joints bear it.

        A hand leans on a halted arm; one that shoves it presses ever more until the arm is stopped.
        """
        t, kind, is_lean = self.t, fault.kind, fault.kind == "lean"
        is_hand = kind in ("lean", "shove")
        if kind == "shove" and self.is_stopped:
            self._stopped.setdefault(fault, t)
        stopped = self._stopped.get(fault, math.inf)
        begin, end = fault.at + REACHES * is_lean, fault.end - GONE * is_lean
        self.touch(kind)
        if not begin <= t < min(end, stopped + fault.size):
            return
        if fault not in self._parts:  # of a weight: the arm may sink
            self._parts[fault] = (
                self.bears(wrench / FIFTH, 1.0) if is_lean else self.bears(wrench, LIFTED)
            )
        if is_hand:
            grown = min(1.0, (min(t, stopped) - begin) / GROWS)
            part = grown * min(self._parts[fault] if is_lean else 1.0, self.bears(wrench, BEARABLE))
        else:
            part = self._parts[fault]
        self.touch(kind, part * wrench, is_hand=is_hand)

    def touch(self, name, wrench=None, *, is_hand=False):
        """Let a wrench (6,) act on the tip from now on, axes of the world; None ends it."""
        if self.touching.pop(name, None) and wrench is None:
            self.drive.push(None)
        elif wrench is not None:
            self.touching[name] = Touch(wrench, is_hand)
            self.hardest = np.maximum(self.hardest, np.abs(wrench))

    def _touch(self):
        if self.touching:
            q, dq = self.simulator.motion
            J, R = self._tip(q)
            wrench = sum(touch.at(J[:3] @ dq) for touch in self.touching.values())
            self.drive.push(np.concatenate((R.T @ wrench[:3], R.T @ wrench[3:])))

    def bears(self, wrench, part):
        """Return how much of a wrench (6,) on the tip, all at most, this part of efforts bears.

        It comes on top of the weight and of what touches the tip already.
        """
        model, (q, _) = self.arm.model, self.simulator.motion
        J, _ = self._tip(q)
        acting = sum((touch.wrench for touch in self.touching.values()), np.zeros(6))
        needed = pin.rnea(model, model.createData(), q, 0 * q, 0 * q) - J.T @ acting
        more = -J.T @ wrench
        room = part * model.effortLimit - np.sign(more) * needed
        return float(np.clip((room / np.maximum(np.abs(more), AT_ONCE)).min(), 0.0, 1.0))

    def _tip(self, q):
        """Return J (6, n) and R_e (3, 3) of the tip, which is the sensor too, from the world."""
        model, frame = self.arm.model, pin.LOCAL_WORLD_ALIGNED
        data, tip = model.createData(), model.getFrameId(self.arm.about.tip_frame)
        J = pin.computeFrameJacobian(model, data, q, tip, frame)
        return J, pin.updateFramePlacement(model, data, tip).rotation

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
        self.rows.append(Row(*about, self.is_stopped, command))

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
        self.asked.append(Order(self.t, name, self.product.order(name, *given)))
        return self.asked[-1].is_obeyed

    def times_of(self, *names):
        """Return when [s] these orders were obeyed."""
        return [order.t for order in self.asked if order.is_obeyed and order.name in names]

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

    def led_on(self, pause):
        """Yield where a stopped arm is led on otherwise than by a resume, or after a pause [s].

        What led it and was refused has to pause after a resume, too.  After a halt, and after the
        arm ran away, there has to be one.
        """
        before, begun, asked, needs_resume = None, -math.inf, -math.inf, False
        orders = deque(self.asked)
        for now in self.truth:
            is_new, is_left = before is None or now.life != before.life, False
            was_stopped = not is_new and before.is_stopped
            if is_new:
                asked, needs_resume = -math.inf, False
            while orders and orders[0].t <= now.t:
                t, name, is_obeyed = orders.popleft()
                if name in LEADS and is_obeyed:
                    if needs_resume or t - asked < pause:
                        yield t, f"{name} leads an arm on that is stopped since {begun:.3f} s"
                    is_left, asked = True, -math.inf
                elif name in LEADS and was_stopped:
                    asked = t
                elif name == "halt" and is_obeyed:
                    needs_resume = True
                elif name == "resume" and is_obeyed and was_stopped:
                    is_left, needs_resume = True, False
                    asked = -math.inf if asked == begun else asked
            if now.is_stopped and (is_left or not was_stopped):
                asked = begun = now.t
            elif was_stopped and not (now.is_stopped or is_left):
                yield now.t, "the arm is stopped no more, and nobody asked for that"
            needs_resume = needs_resume or now.cause == Cause.RUNAWAY
            before = now

    def gives_way(self, most, in_contact, contact, blind):
        """Yield where a stop gives way by more than ``most`` [m], ``in_contact`` if it begins so.

        It begins where the arm is at rest, or ought to be, or a force of ``contact`` [N] touches
        it; not within the spans [s] in which states or commands are wrong.
        """
        start, since = None, math.inf
        for now in self.truth:
            if not now.is_held or any(a <= now.t < b for a, b in blind):
                start, since = None, math.inf
                continue
            p, since = self.arm.pose(now.q)[0], min(since, now.t)
            rests = np.abs(now.dq).max() < AT_REST or now.t > since + COMES_TO_REST
            if start is None and (rests or now.touched > contact):
                start, allowed = (now.t, p), in_contact if now.touched > LEAST_TOUCH else most
            if start is None:
                continue
            way = np.linalg.norm(p - start[1])
            if way > allowed:
                yield now.t, f"a stop gives way by {way:.4f} m since {start[0]:.3f} s"
                return

    def cut_apart(self, row, steps, efforts):
        """Yield where efforts were cut joint by joint: two joints are at their bounds at once.

        Args:
            row: with the efforts.
            steps: (n,) [s] in which they may change as they did.
            efforts: (n,) parts of their limits.
        """
        for least, parts in ((0.1 / self.rate, steps), (1.0 - SAME, efforts)):
            second, first = np.sort(parts)[-2:]
            if second > least and first - second < SAME * first:
                yield row.t, f"the efforts {row.command} are cut joint by joint"

    def is_at(self, goal, way, angle):
        """Return whether the tip is within a way [m] and an angle [rad] of a pose.

        A law without an integral leaves an arm where the friction of its joints balances it.
        """
        q, dq = self.simulator.motion
        p, R = self.arm.pose(q)
        gone, turned = np.linalg.norm(p - goal[0]), np.linalg.norm(pin.log3(R.T @ goal[1]))
        if gone < way and turned < angle:
            return True
        efforts = None if self.is_position or not self.rows else self.rows[-1].command
        if efforts is None or self.is_stopped or gone > RUBBED[0] or turned > RUBBED[1]:
            return False
        model, (viscous, coulomb) = self.arm.model, self.friction
        weight = pin.rnea(model, model.createData(), q, 0 * q, 0 * q)
        return bool((np.abs(efforts - weight) < viscous * np.abs(dq) + coulomb).all())

    def beside_weight(self, row, push):
        """Return how far [Nm] efforts are from the weight, and what brakes and balances a push."""
        model, q, dq = self.arm.model, row.q, row.dq
        data, (J, _) = model.createData(), self._tip(q)
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
