"""The yardstick: what every law commands along fixed scenarios, to be held through changes inside.

4 laws x 7 representations x 2 arms go through scenarios whose states are open loop: they do not
answer to the commands, so that errors are large and no difference hides in a small error, or grows
by itself.  Commands, modes, causes and refusals are kept in yardstick.npz.

    python test/yardstick.py           # compare; exit code 1 where something differs
    python test/yardstick.py --write   # say what differs from the file before, and replace it

Of the package it knows what stands in the first section, the outer interface of a controller.
Kinematics are Pinocchio's, and desired motions are made here.
"""

import argparse
import json
import math
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

# --- the package: all that is used of it -----------------------------------------------
from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.frames import DesiredFrame, Placement
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.parameters.fields import from_mapping
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.robot.catalogue import load_robot

Array = NDArray[np.float64]


class Product:
    """A controller of the package, made of parameters; states and orders in, commands out."""

    def __init__(self, law, arm, values, q, sensor=""):
        about = arm.about
        frames = {"base_frame": about.base_frame, "tip_frame": about.tip_frame}
        self._info = schemes()[law]
        self._values = frames | {"joints": list(about.joints)} | values
        parameters = from_mapping(self._info.parameters, self._values)
        robot = parameters.robot(about.urdf)
        self._scheme = parameters.make_scheme(robot)
        self.controller = Controller(self._scheme, ControllerOptions.of(parameters), q)
        anywhere = Placement(turn(np.array([0.1, -0.2, 0.7])), np.array([0.0, 0.01, -0.04]))
        self._sensor = robot.placement(sensor) if sensor else anywhere
        self._now = None
        self.is_refused = False  # the last state

    @property
    def mode(self):
        """Mode and cause, as ~/status has them."""
        return f"{self.controller.mode} {self.controller.why.cause}".strip()

    def step(self, tick):
        """Return the command for a state: q and dq, or efforts, then the compliant frame."""
        if "wrench" in self._info.inputs:
            w = tick.wrench
            self._scheme.sense(None if w is None else SensedWrench(w, self._sensor))
        self.is_refused = False
        try:
            command = self.controller.step(tick.stamp, tick.q, tick.dq, tick.receipt)
        except InvalidMessageError:
            command, self.is_refused = None, True
        if command is None:
            return None
        if command.effort is None:
            return np.concatenate((command.q, command.dq))
        frame = command.frame
        if frame is None:
            return command.effort.copy()
        pose = frame.p_d, frame.R_d[:, 0], frame.R_d[:, 1], frame.dp_d, frame.omega_d
        return np.concatenate((command.effort, *pose))

    def order(self, name, *given):
        """Give an order; return whether it is obeyed."""
        controller = self.controller
        try:
            if name == "follow":
                times, frames = given
                motion = Trajectory(times, [DesiredFrame(*frame) for frame in frames])
                controller.follow(motion, None, self._now)
            elif name == "stream":
                controller.follow(SetPoint(DesiredFrame(*given), 0.1), None, self._now)
            elif name == "aim":
                controller.aim(DesiredFrame(*given), self._now)
            elif name == "jog":
                controller.jog(*given, self._now)
            elif name == "press":
                self._scheme.press(*given)
            elif name == "change":  # to other parameters, as a running node does
                self._values = self._values | given[0]
                parameters = from_mapping(self._info.parameters, self._values)
                self._scheme.change(parameters)
                controller.changed(ControllerOptions.of(parameters))
            else:
                getattr(controller, name)()
        except InvalidMessageError:
            return False
        return True

    def at(self, receipt):
        """Say when the orders that follow come [s]."""
        self._now = receipt


# --- arms ------------------------------------------------------------------------------
ARMS = ("ur5", "panda")
LAWS = ("clik", "dynamic_control", "impedance_control", "compliance_control")
REPRESENTATIONS = (
    *("euler_angles", "relative_euler_angles", "euler_parameters", "angle_axis"),
    *("rotation_vector", "rodrigues", "modified_rodrigues"),
)

# Where the tip is near the pole of XYZ: its z axis along x of the base.
_AT_POLE = {
    "ur5": (-0.27, -1.65, 2.0, 2.8, -1.25, -2.99),
    "panda": (0.05, -0.4, 0.0, -2.2, 0.0, 3.34, 0.8),
}
# How far [rad] a tip is turned away: past the pole; of Rodrigues parameters, near to it.
_MOST_TURN = {"relative_euler_angles": 1.9, "rodrigues": 2.9, "modified_rodrigues": 3.9}
# The joint that is brought to its upper limit.
TO_LIMIT = {"ur5": 3, "panda": 5}

turn = pin.exp3  # the rotation (3, 3) of a rotation vector [rad]


class Arm:
    """An arm of the catalogue, on Pinocchio."""

    def __init__(self, name):
        self.name, self.about = name, load_robot(name)
        model = pin.buildModelFromXML(self.about.urdf)
        others = [model.getJointId(j) for j in model.names[1:] if j not in self.about.joints]
        self.model = pin.buildReducedModel(model, others, pin.neutral(model))
        self._data = self.model.createData()
        self.home = np.array(self.about.home)
        self.n = self.model.nq

    def pose(self, q):
        """Return position (3,) and rotation (3, 3) of the tip from the base frame."""
        pin.framesForwardKinematics(self.model, self._data, q)
        names = self.about.base_frame, self.about.tip_frame
        base, tip = (self._data.oMf[self.model.getFrameId(name)] for name in names)
        placement = base.actInv(tip)
        return placement.translation.copy(), placement.rotation.copy()


arm_named = cache(Arm)

# --- signals ---------------------------------------------------------------------------
SEED, PERIOD = 1999, 0.002


class Waves:
    """A smooth random signal (n,), 0 at 0."""

    def __init__(self, key, size):
        random = np.random.default_rng((SEED, *key))
        self._rate = 2 * math.pi * random.uniform(0.3, 1.1, (3, len(size)))
        self._phase = random.uniform(-math.pi, math.pi, (3, len(size)))
        self._size = size / 3

    def at(self, t):
        """Return value and rate at t [s]."""
        angle = self._rate * t + self._phase
        value = self._size * (np.sin(angle) - np.sin(self._phase)).sum(axis=0)
        return value, self._size * (self._rate * np.cos(angle)).sum(axis=0)


def smooth(s):
    """Return a step from 0 to 1 over s from 0 to 1, and its derivatives."""
    s = min(max(s, 0.0), 1.0)
    value = s**3 * (10 - 15 * s + 6 * s * s)
    return value, 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)


def turned(pose, n, m, a, b):
    """Return R = exp(a n) exp(b m) R_0 with omega and its rate, for a, b with two rates each."""
    A = turn(a[0] * n)
    R, axis = A @ turn(b[0] * m) @ pose[1], A @ m
    omega = a[1] * n + b[1] * axis
    return R, omega, a[2] * n + b[2] * axis + a[1] * b[1] * np.cross(n, axis)


# Frames are p_d, R_d, dp_d, omega_d, ddp_d, domega_d.
def circle(pose, radius, lasting, tilt, begin=0.0):
    """Return a circle with a turning tool as the points of a trajectory, at rest at its ends."""
    u, v = np.array([0.8, 0.6, 0.0]), np.array([0.0, 0.0, 1.0])
    n, m = np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
    times, frames = [], []
    for k in range(41):
        s, ds, dds = smooth(k / 40)
        angle, rate = 2 * math.pi * s, 2 * math.pi * ds / lasting
        accelerated = 2 * math.pi * dds / lasting**2
        arm, along = math.cos(angle) * u + math.sin(angle) * v, math.cos(angle) * v
        along = along - math.sin(angle) * u
        wave = np.array([math.sin(angle), math.cos(angle), -math.sin(angle)])
        a = tilt * np.array([wave[0], wave[1] * rate, wave[1] * accelerated + wave[2] * rate**2])
        b = tilt * np.array(
            [1 - wave[1], wave[0] * rate, wave[0] * accelerated + wave[1] * rate**2]
        )
        R, omega, domega = turned(pose, n, m, a, b)
        p = pose[0] + radius * (arm - u)
        dp, ddp = radius * rate * along, radius * (accelerated * along - rate**2 * arm)
        times.append(begin + lasting * k / 40)
        frames.append((p, R, dp, omega, ddp, domega))
    return times, frames


def turning(pose, axis, most, lasting):
    """Return a turn about an axis of the base frame by ``most`` [rad], as points."""
    times, frames, still = [], [], np.zeros(3)
    for k in range(41):
        s, ds, dds = smooth(k / 40)
        a = most * np.array([s, ds / lasting, dds / lasting**2])
        R, omega, domega = turned(pose, axis, axis, a, np.zeros(3))
        times.append(lasting * k / 40)
        frames.append((pose[0], R, still, omega, still, domega))
    return times, frames


# --- scenarios -------------------------------------------------------------------------
class Tick(NamedTuple):
    """A state, what is sensed with it, and the orders that come before it."""

    stamp: int
    receipt: float | None
    q: Array
    dq: Array
    wrench: Array | None
    orders: tuple[tuple[Any, ...], ...]


class Script:
    """Writes the ticks of a scenario.

    Args:
        arm: whose states they are.
        key: of the random signals.
        q: (n,) where it begins.
        size: [rad] of what the joints do besides.
        period: [s] of the states.
        timed: whether states say when they came.

    Attributes:
        events: the ticks about which all are kept.
        is_sensed, more: whether the wrench is sensed, and what is added to it.
        force: that is to be exerted; None: none.
    """

    def __init__(self, arm, key, q, size=0.12, period=PERIOD, *, timed=True):
        self.arm, self.q_0 = arm, q
        self.pose = arm.pose(self.q_0)
        self.ticks, self.events = [], {0}
        self.period, self._timed = period, timed
        self._waves = Waves((key, 1), np.full(arm.n, size))
        self._push = Waves((key, 2), np.array([12.0] * 3 + [1.5] * 3))
        self._stamp, self._receipt = 5_000_000_000, 1000.0
        self._u, self._speed = 0.0, 1.0
        self.is_sensed, self.more, self.force = True, np.zeros(6), None
        self._drift = self._scatter = None

    def drift(self, away, lasting):
        """Let the joints go elsewhere by ``away`` (n,) from now on, while the arm moves."""
        self._drift = away, self._u, lasting

    def scatter(self):
        """Let all states be random from now on."""
        self._scatter = np.random.default_rng((SEED, 0))

    def state(self):
        """Return q, dq (n,) of now."""
        if self._scatter is not None:
            q, dq = self._scatter.uniform(-1.0, 1.0, (2, self.arm.n))
            return self.q_0 + 0.4 * q, dq
        q, dq = self._waves.at(self._u)
        q = self.q_0 + q
        if self._drift is not None:
            away, since, lasting = self._drift
            s, ds, _ = smooth((self._u - since) / lasting)
            q, dq = q + s * away, dq + ds / lasting * away
        return q, self._speed * dq

    def go(self, count, *order, speed=None, **changes):
        """Go on for so many states, to the end at another speed of the arm: 0 is at rest.

        Before that give an order, if there is one, or change attributes: that is an event.
        """
        vars(self).update(changes)
        if order or changes:
            self.events.add(len(self.ticks))
        begin, end = self._speed, self._speed if speed is None else speed
        orders = [order] if order else []
        for k in range(count):
            q, dq = self.state()
            w = self._push.at((self._stamp - 5_000_000_000) / 1e9)[0] + self.more
            receipt = self._receipt if self._timed else None
            sensed = w if self.is_sensed else None
            if self.force is not None:
                orders.append(("press", self.force))
            self.ticks.append(Tick(self._stamp, receipt, q, dq, sensed, tuple(orders)))
            orders = []
            self._speed = begin + (end - begin) * smooth((k + 1) / count)[0]
            self._advance(self.period, self.period)

    def jump(self, stamps, seconds):
        """Let no states come for a while [s], in which the stamps go on by another."""
        self._advance(stamps - self.period, seconds - self.period)
        self.events.add(len(self.ticks))

    def _advance(self, stamps, seconds):
        self._stamp += round(1e9 * stamps)
        self._receipt += seconds
        self._u += self._speed * seconds


# Large errors are within all bounds of the tip, and no joint is at a limit of its effort.
_WIDE = {"max_error_position": 1.0, "max_error_rotation": math.pi, "slow_below": 0.0}
_FAST = {
    "max_linear_speed": 2.0, "max_angular_speed": 10.0, "max_linear_acceleration": 100.0,
    "max_angular_acceleration": 500.0, "max_linear_jerk": 1e5, "max_angular_jerk": 1e5,
    "max_joint_acceleration": [1000.0],
}  # fmt: skip
_EFFORTS = {"max_effort_rate": [1e5]}
_GAINS = {
    "clik": {"k_Pp": 3.0, "k_Po": 2.0},
    "dynamic_control": _EFFORTS | {"k_Pp": 60.0, "k_Vp": 12.0, "k_Po": 40.0, "k_Vo": 8.0},
    "impedance_control": _EFFORTS
    | {"k_Pp": 60.0, "k_Vp": 12.0, "k_Po": 80.0, "k_Vo": 8.0}
    | {"max_ripple_force": 1e5, "max_ripple_torque": 1e5},
    "compliance_control": _EFFORTS
    | {"K_p": [200.0] * 3, "K_o": [8.0] * 3}
    | {"error_clip_position": 0.5, "error_clip_rotation": 3.0},
}
_MEASURED = {"feedback": "measured", "max_deviation": 100.0}


class Scenario(NamedTuple):
    """A scenario: its states and orders, and the parameters besides those of all."""

    write: Callable[[Script, str], None]
    script: dict[str, Any] = {}  # noqa: RUF012
    q_0: Callable[[Arm, str], Array] = lambda arm, _: arm.home
    laws: tuple[str, ...] = LAWS
    values: dict[str, Any] = {}  # noqa: RUF012
    of_law: dict[str, dict[str, Any]] = {}  # noqa: RUF012

    def parameters(self, law):
        return _WIDE | _FAST | _GAINS[law] | self.values | self.of_law.get(law, {})


def _circle(script, _):
    script.go(440, "follow", *circle(script.pose, 0.06, 0.8, 0.4))


def _random(script, _):
    """Random states and wrenches, at random times, far from a motion that is there at first."""
    random = np.random.default_rng((SEED, 10))
    p, R = script.pose
    start = p + np.array([0.1, -0.08, 0.06]), turn(np.array([0.5, -0.4, 0.6])) @ R
    order = "follow", *circle(start, 0.1, 0.2, 0.5)
    script.scatter()
    for _ in range(45):
        period = random.uniform(0.001, 0.006)
        more = random.uniform(-1.0, 1.0, 6) * np.array([40.0] * 3 + [5.0] * 3)
        script.go(1, *order, period=period, more=more)
        order = ()


def _push(script, _):
    """At rest, pushed away and back, jogged; then to a pose; states come seldom."""
    p, R = script.pose
    script.drift(np.random.default_rng((SEED, 9)).uniform(-0.2, 0.2, script.arm.n), 0.3)
    script.go(50, is_sensed=True)
    script.go(40, more=np.array([25.0, -15.0, 20.0, 1.0, 2.0, -1.5]))
    script.go(50, "jog", np.array([0.1, -0.1, 0.05, 0.3, 0.2, -0.4]))
    goal = p + np.array([0.03, -0.05, 0.02]), turn(np.array([0.2, -0.3, 0.3])) @ R
    script.go(90, "aim", *goal, more=np.zeros(6))


def _near_pole(arm, orientation):
    return np.array(_AT_POLE[arm.name]) if orientation == "euler_angles" else arm.home


def _pole(script, orientation):
    """Close to a pole of the representation, and past it."""
    if orientation == "euler_angles":
        script.go(340, "follow", *circle(script.pose, 0.03, 0.6, 0.3))
        return
    about = {"relative_euler_angles": (0.03, 1.0, -0.02)}.get(orientation, (0.5, -0.6, 0.7))
    axis = script.pose[1] @ np.array(about)
    axis /= np.linalg.norm(axis)
    most = _MOST_TURN.get(orientation, 3.5)
    script.go(340, "follow", *turning(script.pose, axis, most, 0.6))


def _beside_limit(arm, _, by=-0.12):
    q, joint = arm.home.copy(), TO_LIMIT[arm.name]
    q[joint] = arm.model.upperPositionLimit[joint] + by
    return q


def _limit(script, _):
    """A pose beyond the limit of a joint, and the joint going there."""
    arm = script.arm
    script.drift(0.11 * (np.arange(arm.n) == TO_LIMIT[arm.name]), 0.5)
    script.go(340, "aim", *arm.pose(_beside_limit(arm, _, by=0.25)))


def _gap(script, _):
    """States are lost; the stamps jump; no state comes; the stamps go back; between, motions."""
    script.go(80, "follow", *circle(script.pose, 0.06, 0.8, 0.4))
    script.jump(0.012, 0.012)
    script.go(60)
    script.jump(0.3, PERIOD)
    script.go(100)
    again = "follow", *circle(script.pose, 0.05, 0.5, 0.3, begin=0.2)
    script.go(60, *again)
    for stamps, seconds, count in ((0.25, 0.25, 40), (0.09, 0.115, 40), (0.04, 0.25, 20)):
        script.jump(stamps, seconds)
        script.go(count)
    script.go(50, *again)
    script.jump(-2.0, PERIOD)
    script.go(60)


def _halt(script, _):
    """A halt on the path; orders that are refused; a resume, and on."""
    script.go(110, "follow", *circle(script.pose, 0.06, 0.8, 0.4))
    script.go(10, "halt")
    script.go(90, "resume", speed=0.0)
    script.go(40, "follow", *circle(script.pose, 0.05, 0.5, 0.3, begin=0.2))
    script.go(280, "resume")  # a stream has to pause
    here = script.arm.pose(script.state()[0])
    script.go(120, "follow", *circle(here, 0.05, 0.3, 0.3, begin=0.1), speed=1.0)
    script.go(50, "end", speed=0.0)


def _fault(script, _):
    """The arm goes where its errors are too large; it is held until the reference comes again."""
    script.go(40, "follow", *circle(script.pose, 0.04, 0.6, 0.2))
    script.drift(np.random.default_rng((SEED, 8)).uniform(0.25, 0.4, script.arm.n), 0.5)
    script.go(50, is_sensed=True)
    script.go(20, speed=0.0)
    for count, speed in ((135, None), (60, 0.5)):
        here = script.arm.pose(script.state()[0])
        script.go(count, "follow", *circle(here, 0.04, 0.6, 0.2, begin=0.1), speed=speed)
    script.go(30, more=np.array([150.0, 0.0, 0.0, 0.0, 0.0, 0.0]))


def _no_wrench(script, _):
    """The wrench is lost on the path, and is back twice: near, and far away."""
    script.go(100, "follow", *circle(script.pose, 0.05, 0.8, 0.3))
    script.go(50, is_sensed=False)
    script.go(50, is_sensed=True)
    script.go(150, more=np.array([90.0, 30.0, 0.0, 0.0, 0.0, 0.0]))
    script.go(30, is_sensed=False)
    script.go(60, is_sensed=True)


def _press(script, _):
    """A force is exerted while the tip moves, then another one, then none."""
    script.go(60, "follow", *circle(script.pose, 0.05, 0.8, 0.3))
    script.go(140, force=np.array([0.0, 0.0, 20.0]))
    script.go(140, force=np.array([0.0, 0.0, -8.0]))
    script.go(40, "halt", force=None)


def _change(script, orientation):
    """Parameters change while the tip moves: gains, limits, pace, and the representation."""
    script.go(60, "follow", *circle(script.pose, 0.06, 0.9, 0.4))
    script.go(80, "gains")
    script.go(80, "change", {"speed_override": 0.4, "max_angular_speed": 0.3})
    script.go(100, "change", {"orientation": _OTHER[orientation]})
    script.go(100, "change", {"speed_override": 1.0, "max_angular_speed": 5.0})


# The representation that a run changes to.
_OTHER = dict(zip(REPRESENTATIONS, (*REPRESENTATIONS[2:], *REPRESENTATIONS[:2]), strict=True))

_NEW_GAINS = {
    "clik": {"k_Pp": 5.0, "k_Po": 1.0},
    "dynamic_control": {"k_Pp": 90.0, "k_Vp": 10.0, "k_Po": 20.0, "k_Vo": 9.0},
    "impedance_control": {"K_p": [1600.0, 500.0, 900.0], "M_o": [1.5, 1.0, 2.0], "k_Vo": 9.0},
    "compliance_control": {"K_p": [400.0, 200.0, 100.0], "K_o": [20.0, 10.0, 5.0]},
}

# Full matrices, a tool, friction, tilted gravity, a centre away from the tip: all that a law has.
_TOOL = {"tool_mass": 0.8, "tool_com": [0.01, -0.02, 0.06]} | {
    "tool_inertia": [0.003, 0.0002, -0.0001, 0.004, 0.0003, 0.002]
}
_FRICTION = {"compensate_friction": True, "friction_viscous": [1.5], "friction_coulomb": [2.0]}
_K_P, _K_O = [900.0, 150.0, -80.0, 600.0, 60.0, 1200.0], [40.0, 6.0, -3.0, 30.0, 5.0, 55.0]
_FULL = {
    "clik": _MEASURED | {"damping_eps": 0.5, "damping_max": 0.2},
    "dynamic_control": _TOOL | _FRICTION | {"gravity": [0.8, -0.5, -9.7], "damping_eps": 0.5},
    "compliance_control": _TOOL
    | {"K_p": _K_P, "K_o": _K_O, "translational_frame": "desired"}
    | {"error_clip_position": 0.04, "error_clip_rotation": 0.1, "damping_ratio_p": 0.7},
    "impedance_control": _TOOL
    | {"M_p": [12.0, 1.0, -0.5, 9.0, 0.8, 14.0], "K_p": _K_P, "K_o": _K_O}
    | {"D_p": [300.0, 20.0, -10.0, 250.0, 15.0, 350.0], "M_o": [1.2, 0.1, 0.05, 0.9, -0.1, 1.4]}
    | {"translational_frame": "desired", "compliance_offset": [0.02, -0.03, 0.1]}
    | {"wrench_sign": -1, "wrench_bias": [0.5, -0.3, 1.0, 0.02, 0.05, -0.03]}
    | {"force_dead_band": 1.0, "torque_dead_band": 0.1, "wrench_cutoff": 20.0},
}

_FREE = {"enforce_limits": False, "max_jump_position": 1.0, "max_jump_rotation": math.pi}

_FAR = {"clik": {"max_deviation": 2.0}}
_LOOSE = {"max_error_position": 0.15, "max_error_rotation": 0.5}
SCENARIOS = {
    "random": Scenario(_random, values=_FREE, of_law={"clik": _MEASURED}),
    "circle": Scenario(_circle, of_law={"clik": _MEASURED}),
    "push": Scenario(
        _push,
        {"size": 0.03, "period": 0.008, "timed": False},
        values={"euler_sequence": "ZXY", "slow_below": 0.3},
        of_law=_FULL,
    ),
    "pole": Scenario(_pole, {"size": 0.06}, _near_pole, values=_FREE, of_law={"clik": _MEASURED}),
    "limit": Scenario(_limit, {"size": 0.02}, _beside_limit),
    "gap": Scenario(_gap, of_law=_FAR | {"impedance_control": {"inner_loop": False}}),
    "halt": Scenario(_halt, of_law=_FAR),
    "fault": Scenario(
        _fault,
        {"size": 0.03, "period": 0.004},
        values=_LOOSE,
        of_law={"clik": {"max_deviation": 0.2}},
    ),
    "no_wrench": Scenario(_no_wrench, laws=("impedance_control",)),
    "press": Scenario(_press, laws=("impedance_control", "compliance_control")),
    "change": Scenario(_change, of_law={"clik": _MEASURED}),
}


# --- a run -----------------------------------------------------------------------------
EVERY, BEFORE, AFTER = 25, 1, 3  # ticks that are kept: of all; about an event


@cache
def script_of(scenario, arm, orientation):
    about, key = SCENARIOS[scenario], list(SCENARIOS).index(scenario)
    of = arm_named(arm)
    script = Script(of, key, about.q_0(of, orientation), **about.script)
    if about.write is not _random:
        script.go(10)
    about.write(script, orientation)
    return script


@cache
def kept_of(scenario, arm, orientation):
    """Return the ticks whose commands are kept one by one."""
    script = script_of(scenario, arm, orientation)
    about = {k for event in script.events for k in range(event - BEFORE, event + AFTER)}
    return sorted(k for k in range(len(script.ticks)) if k in about or k % EVERY == 0)


class Run(NamedTuple):
    """What a controller did along a scenario.

    Attributes:
        commands: (K, m) of the ticks that are kept; NaN: nothing was commanded.
        mean: (m,) of the commands of all ticks.
        log: mode and cause, and what was refused, by the tick at which they changed.
    """

    commands: Array
    mean: Array
    log: list[str]


def run(law, orientation, arm, scenario, **more):
    """Run a controller through a scenario; ``more`` are other parameters."""
    script = script_of(scenario, arm, orientation)
    values = SCENARIOS[scenario].parameters(law) | {"orientation": orientation} | more
    product = Product(law, script.arm, values, script.q_0)
    rows, log, before = [], [], ""
    for k, tick in enumerate(script.ticks):
        product.at(tick.receipt)
        for name, *given in tick.orders:
            if name == "gains":
                name, given = "change", [_NEW_GAINS[law]]
            if not product.order(name, *given):
                log.append(f"{k} {name} refused")
        rows.append(product.step(tick))
        silent = ", state refused" if product.is_refused else ", no command"
        now = product.mode + (silent if rows[-1] is None else "")
        if now != before:
            log.append(f"{k} {now}")
            before = now
    width = max(len(row) for row in rows if row is not None)
    commands = np.array([np.full(width, np.nan) if row is None else row for row in rows])
    kept = kept_of(scenario, arm, orientation)
    return Run(commands[kept], np.nanmean(commands, axis=0), log)


# --- the file --------------------------------------------------------------------------
FILE = Path(__file__).with_suffix(".npz")
TOLERANCE = 1e-9


def cells():
    """Return each law, orientation, arm and scenario: a cell."""
    for law in LAWS:
        for arm in ARMS:
            for name, scenario in SCENARIOS.items():
                if law in scenario.laws:
                    yield from ((law, orientation, arm, name) for orientation in REPRESENTATIONS)


def write(runs):
    """Keep the runs, by cell, in the file: an array of commands for each, what they say as JSON."""
    arrays = {" ".join(cell): np.vstack((r.commands, r.mean)) for cell, r in runs.items()}
    logs = {" ".join(cell): r.log for cell, r in runs.items()}
    text = json.dumps(logs, separators=(",", ":")).encode()
    np.savez_compressed(FILE, log=np.frombuffer(text, np.uint8), **arrays)


@cache
def read():
    """Return the runs that are kept, by cell; none if there is no file."""
    if not FILE.is_file():
        return {}
    with np.load(FILE, allow_pickle=False) as held:
        logs = json.loads(held["log"].tobytes())
        rows = {name: held[name] for name in held.files if name != "log"}
    return {tuple(name.split()): Run(of[:-1], of[-1], logs[name]) for name, of in rows.items()}


class Difference(NamedTuple):
    """Where a run differs most from the one that is kept.

    Attributes:
        ratio: of the deviation to what is allowed; infinite where it did something else.
        text: where, and by how much.
    """

    ratio: float
    text: str


def difference(cell, now, before):
    """Return the largest difference between two runs of a cell.

    A command may differ by TOLERANCE times the largest of its kind in the same tick (positions,
    velocities, efforts, the compliant frame), and TOLERANCE [rad, rad/s, Nm, m] where that is less
    than 1.
    """
    _, orientation, arm, scenario = cell
    if now.log != before.log:
        both = zip([*now.log, "nothing"], [*before.log, "nothing"], strict=False)
        a, b = next((a, b) for a, b in both if a != b)
        return Difference(math.inf, f"{scenario}: tick {a!r}, where it was {b!r}")
    shapes = now.commands.shape, before.commands.shape
    if shapes[0] != shapes[1]:
        return Difference(math.inf, f"{scenario}: {shapes[0]} commands, not {shapes[1]}")
    if (np.isnan(now.commands) != np.isnan(before.commands)).any():
        return Difference(math.inf, f"{scenario}: a command is not finite, or no command is")
    n, ticks = arm_named(arm).n, [*kept_of(scenario, arm, orientation), "mean of all"]
    ours, theirs = (np.nan_to_num(np.vstack((r.commands, r.mean))) for r in (now, before))
    away, allowed = np.abs(ours - theirs), np.empty_like(ours)
    for kind in (slice(n), slice(n, None)):
        size = np.abs(theirs[:, kind]).max(axis=1, initial=1.0, keepdims=True)
        allowed[:, kind] = TOLERANCE * size
    ratio = away / allowed
    k, column = np.unravel_index(np.argmax(ratio), ratio.shape)
    what = f"joint {column + 1}" if column < n else f"number {column - n + 1} after the joints"
    text = (
        f"{scenario}: tick {ticks[k]}, {what}: {ours[k, column]:.17g}, where it was "
        f"{theirs[k, column]:.17g}: {away[k, column]:.2g} away; allowed {allowed[k, column]:.2g}"
    )
    return Difference(float(ratio[k, column]), text)


# --- the command line ------------------------------------------------------------------
# The main gains of the laws.
GAINS = {
    "clik": ("k_Pp", "k_Po"),
    "dynamic_control": ("k_Pp", "k_Vp", "k_Po", "k_Vo"),
    "impedance_control": (
        *("k_Pp", "k_Vp", "k_Po", "k_Vo", "M_p", "K_p", "M_o", "K_o"),
        *("damping_ratio_p", "damping_ratio_o"),
    ),
    "compliance_control": ("K_p", "K_o", "damping_ratio_p", "damping_ratio_o"),
}


def changed(law, gain, scenario, by=1e-6):
    """Return the gain in a scenario, changed by a part of it."""
    default = getattr(schemes()[law].parameters(), gain)
    value = SCENARIOS[scenario].parameters(law).get(gain, default)
    if isinstance(value, float):
        return {gain: value * (1 + by)}
    return {gain: [each * (1 + by) for each in value]}


def sensitivity():
    """Print what a change of a gain by one millionth does, beside what is allowed."""
    for law, gains in GAINS.items():
        for gain in gains:
            seen = {}
            for cell in cells():
                if cell[0] == law:
                    _, orientation, arm, scenario = cell
                    now = run(*cell, **changed(law, gain, scenario))
                    ratio = difference(cell, now, read()[cell]).ratio
                    seen[orientation, arm] = max(ratio, seen.get((orientation, arm), 0.0))
            least = min(seen, key=seen.__getitem__)
            print(f"{law} {gain}: at least {seen[least]:.3g} times what is allowed ({least})")


def report(runs):
    """Print, by law and scenario, what differs from the file; return how many runs do."""
    held, count, new = read(), 0, Difference(math.inf, "new")
    for law, name in dict.fromkeys((cell[0], cell[3]) for cell in runs):
        here = [cell for cell in runs if (cell[0], cell[3]) == (law, name)]
        found = [(difference(c, runs[c], held[c]) if c in held else new, c) for c in here]
        bad, (most, cell) = sum(not each.ratio <= 1 for each, _ in found), max(found)
        print(f"{law:18} {name:10} {bad} of {len(here)} differ; most, {cell[1]}, {cell[2]}:")
        print(f"    {most.ratio:.2g} of what is allowed: {most.text}")
        count += bad
    return count


def main():
    parser = argparse.ArgumentParser(description="What every law commands along fixed scenarios.")
    parser.add_argument("--write", action="store_true", help="replace the file")
    parser.add_argument("--sensitivity", action="store_true", help="what a gain changes")
    asked = parser.parse_args()
    if asked.sensitivity:
        sensitivity()
        return 0
    runs = {cell: run(*cell) for cell in cells()}
    count = report(runs)
    if not asked.write:
        return 1 if count else 0
    write(runs)
    print(f"{FILE}: {FILE.stat().st_size / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
