"""Plan of a sequence: its robot, its user and its faults, drawn from its seed and controller alone.

The robots differ as those of the field do: in rate, delay and lag, in what their drivers report,
and in what they do when nothing comes.  A user sends whole motions, or pieces of one: poses with
or without twists, chunks as learned policies send them, goals, twists; early, late, noisy, and
stamped by another clock.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Any, ClassVar

import numpy as np

from eulerparams_control.lab.campaign.record import AskedLimits
from eulerparams_control.lab.faults.base import FROM_ROBOT, ROBOT, TO_ROBOT, Fault
from eulerparams_control.lab.faults.kinds import random_faults
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.laws.rotations import Array, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.parameters.fields import fields_of
from eulerparams_control.parameters.schemes import POSITION, TORQUE, schemes
from eulerparams_control.robot.catalogue import RobotDescription, load_robot
from sim_bridge.drive_modes import DrivePolicy, OnSilence
from sim_bridge.parameters import SimulatorParameters

CONTROLLERS = tuple(schemes())

FAULTY, SMOOTH = "faults", "smooth"
KINDS = (FAULTY, SMOOTH)
"""Of sequences: faults around one robot; or robots and users of all kinds, with faults and without,
whose commands have to be smooth."""

FAULTS = 4.0
"""[s] of a sequence in which its faults are planned; they end well before."""

# Of the way points: from the pose of the arm at home [m], [rad], and how long to each [s].
_FARTHEST, _TURN, _LEG = 0.08, 0.4, 0.8
_SLOW_LEG = 2.0  # where a motion is sent piece by piece, so that its pieces are near each other

# A robot allows this many times the acceleration that its controller may ask for; a position loop
# is stable with this gain times its period.
_HARDER, _GAIN = 2.0, 0.4

# Of the pose to which the arm is sent at last.
_LAST_FARTHEST, _LAST_TURN = 0.08, 0.3

_PUSH_FORCE, _PUSH_MOMENT = 20.0, 2.0  # [N], [Nm] at most, along each axis
_WRENCH_NOISE = 20.0  # [N], [Nm]: four standard deviations of a fault

# What else of a controller decides how it acts on messages: the first of these parameters that it
# has.  At the rate of the sequences a loop over the measured positions is stable with less
# gain than one over its own.
_MEASURED = "measured"
_SETTINGS: dict[str, tuple[dict[str, str | float], ...]] = {
    "feedback": (
        {"feedback": "internal"},
        {"feedback": _MEASURED, "k_Pp": 30.0, "k_Po": 30.0},
    ),
    "wrench_pairing": ({"wrench_pairing": "latest"}, {"wrench_pairing": "stamp"}),
    "quaternion_sign": ({"quaternion_sign": "hysteretic"}, {"quaternion_sign": "shortest"}),
}

WAY_POINTS, STREAM, NOTHING = "way points", "stream", "nothing"
CHUNKS, POSES, GOALS, TWISTS = "chunks", "target poses", "goals", "target twists"
MOTIONS = (WAY_POINTS, STREAM, NOTHING)
"""Motions of the arm in a sequence of faults."""

SMOOTH_MOTIONS = (*MOTIONS, CHUNKS, POSES, GOALS, TWISTS)
"""Motions of the arm in a sequence of smooth motions."""

COMMAND_TIMEOUT = 0.1
"""[s] without a command after which a robot brakes."""

PROTECTIVE_SPEED = 1.5
"""A joint this many times as fast as its limit makes the robot stop by itself."""

_STEP_RATE = 1000.0  # [Hz] of the simulation, at least

# [Hz], and how often: those that take long are rare.  The damping of efforts needs the higher ones.
_RATES = {20.0: 0.2, 50.0: 0.2, 125.0: 0.25, 250.0: 0.2, 500.0: 0.1, 1000.0: 0.05}
_EFFORT_RATES = {250.0: 0.6, 500.0: 0.3, 1000.0: 0.1}

_LONGEST_LAG, _LONGEST_DELAY = 0.04, 0.01  # [s] of a position servo, of a network

_SLOWEST, _FASTEST = 5.0, 200.0  # [Hz] of a stream
_JITTER, _NOISE, _SKEW = 0.2, 1e-3, 0.05  # of a period, [m], [s] at most

_CHUNK_RATES, _CHUNKS = (2.0, 10.0), (0.4, 1.6)  # [Hz], and [s] that each reaches ahead

_MIXED = (0.2, 0.3, 0.05, 0.1, 0.15, 0.1, 0.1)  # of SMOOTH_MOTIONS


@dataclass(frozen=True)
class RobotDraw:
    """A robot of its kind.

    Attributes:
        rate: of joint_states [Hz].
        steps: of the simulation between two of them.
        lag: of its position servo [s].
        delay: commands until one acts.
        turns: whether its last joint turns for ever, and is reported in (-pi, pi].
        velocities: whether it reports any.
        on_silence: what it does without commands.
        acceleration: [rad/s^2] that position commands may ask for; 0: any.
        takes_late: whether a command may take the place of a later one.
    """

    rate: float = 250.0
    steps: int = 4
    lag: float = 0.0
    delay: int = 0
    turns: bool = False
    velocities: bool = True
    on_silence: OnSilence = OnSilence.BRAKE
    acceleration: float = 0.0
    takes_late: bool = True

    def simulator(self, control: str) -> SimulatorParameters:
        """Return the parameters of the simulation."""
        return SimulatorParameters(
            rate=self.steps * self.rate,
            control=control,
            protective_speed=PROTECTIVE_SPEED,
            servo_lag=self.lag,
            wrap_continuous=self.turns,
            velocities=self.velocities,
        )

    def policy(self) -> DrivePolicy:
        """Return how it treats commands; silence is detected once a period."""
        return DrivePolicy(
            COMMAND_TIMEOUT - 0.5 / self.rate,
            self.delay,
            takes_late=self.takes_late,
            on_silence=self.on_silence,
            max_joint_acceleration=(self.acceleration,),
        )

    def description(self) -> RobotDescription:
        """Return the arm."""
        robot = load_robot("ur5")  # at home its last joint is 0.15 rad from half a turn
        if not self.turns:
            return robot
        fixed, turning = (f'name="{robot.joints[-1]}" type="{kind}"' for kind in
                          ("revolute", "continuous"))  # fmt: skip
        return replace(robot, urdf=robot.urdf.replace(fixed, turning))


@dataclass(frozen=True)
class StreamDraw:
    """How a motion is sent piece by piece.

    Attributes:
        rate: [Hz].
        twists: whether poses come with twists.
        jitter: part of a period by which one is early or late, at most.
        noise: standard deviation of the positions [m], and of the turns [rad] five times that.
        skew: [s] by which the clock of the stamps is ahead; None: they are 0.
        ahead: [s] that each message tells of what comes; 0: one pose.
    """

    rate: float = 50.0
    twists: bool = True
    jitter: float = 0.0
    noise: float = 0.0
    skew: float | None = None
    ahead: float = 0.0


def draw_robot(random: np.random.Generator, control: str, acceleration: float) -> RobotDraw:
    """Return a robot for a kind of control, whose limit of acceleration [rad/s^2] may be on."""
    is_position = control == POSITION
    rates = _RATES if is_position else _EFFORT_RATES
    rate = float(random.choice(list(rates), p=list(rates.values())))
    has_lag, turns, is_blind, holds, is_strict = random.uniform(size=5) < (0.5, 0.3, 0.3, 0.3, 0.7)
    lag = float(random.uniform(0.005, _LONGEST_LAG)) * has_lag
    return RobotDraw(
        rate,
        max(1, round(_STEP_RATE / rate)),
        round(float(lag), 4) * is_position,
        int(random.integers(0, 1 + math.floor(_LONGEST_DELAY * rate))) * is_position,
        bool(turns),
        not (is_blind and is_position),
        OnSilence.HOLD_LAST if holds and is_position else OnSilence.BRAKE,
        acceleration * bool(is_strict and is_position),
        takes_late=False,
    )


def draw_stream(random: np.random.Generator, motion: str) -> StreamDraw:
    """Return how the pieces of a motion are sent."""
    rate = math.exp(random.uniform(math.log(_SLOWEST), math.log(_FASTEST)))
    twists, is_exact, is_stamped = random.uniform(size=3) < (0.5, 0.3, 0.5)
    jitter, noise = random.uniform(size=2) * (_JITTER, _NOISE)
    skew = float(random.uniform(-_SKEW, _SKEW))
    ahead = 0.0
    if motion == CHUNKS:
        rate, ahead = float(random.uniform(*_CHUNK_RATES)), float(random.uniform(*_CHUNKS))
    return StreamDraw(
        round(float(rate), 2),
        bool(twists),
        round(float(jitter), 3) * (not is_exact),
        round(float(noise), 6) * (not is_exact),
        round(skew, 4) if is_stamped else None,
        round(ahead, 3),
    )


Pose = tuple[Array, Array]


@dataclass(frozen=True)
class SequencePlan:
    """A sequence.

    Attributes:
        seed: makes the rest.
        controller: one of ``CONTROLLERS``.
        motion: one of ``SMOOTH_MOTIONS``: what the arm does while the faults come.
        orientation: the representation.
        setting: number of its further parameters.
        push: (6,) [N, Nm] on the tool while the faults come; None if there is no push.
        kind: one of ``KINDS``.
        robot: which one.
        stream: how the pieces of a motion are sent, if it is sent so.
        is_calm: whether there are no faults.
    """

    seed: int
    controller: str
    motion: str
    orientation: str
    setting: int
    push: tuple[float, ...] | None
    kind: str = FAULTY
    robot: RobotDraw = field(default_factory=RobotDraw)
    stream: StreamDraw = field(default_factory=StreamDraw)
    is_calm: bool = False

    max_effort_rate: ClassVar[float] = 1e4  # [Nm/s]
    state_timeout: ClassVar[float] = 0.1  # [s]

    @property
    def control(self) -> str:
        """What a command is to the robot."""
        return schemes()[self.controller].control

    @property
    def name(self) -> str:
        """Its name."""
        kind = "" if self.kind == FAULTY else f"{self.kind} "
        return f"{kind}{self.controller} {self.seed}"

    @property
    def repeat(self) -> str:
        """The command that repeats it."""
        kind = "" if self.kind == FAULTY else f"--kind {self.kind} "
        return (
            f"fault_campaign {kind}--controller {self.controller} --seed {self.seed} --sequences 1"
        )

    @property
    def contact(self) -> tuple[float, float]:
        """[N], [Nm] that may be felt along each axis, with noise."""
        senses = _senses_wrench(self.controller)
        return (_PUSH_FORCE + _WRENCH_NOISE, _PUSH_MOMENT + _WRENCH_NOISE) if senses else (0.0, 0.0)

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the controller, besides its defaults and the frames."""
        given: dict[str, Any] = {
            "orientation": self.orientation,
            "euler_sequence": "ZYX",  # whose pole is farthest from the poses
            "state_timeout": self.state_timeout,
            **_settings(self.controller)[self.setting],
        }
        if self.control == TORQUE:
            given["max_effort_rate"] = [self.max_effort_rate]
        if self.kind == SMOOTH and self.control == POSITION:
            known = fields_of(schemes()[self.controller].parameters)
            for name in ("k_Pp", "k_Po"):
                gain = given.get(name, known[name].default)
                given[name] = float(min(gain, _GAIN * self.robot.rate))
        return given

    @property
    def asked(self) -> AskedLimits | None:
        """Limits that its commands must keep; None where that is not judged.

        A loop over the measured arm corrects what the arm does: of it only speeds of the tip, and
        what the joints are asked for, are judged.
        """
        if self.kind == FAULTY:
            return None
        known = fields_of(schemes()[self.controller].parameters)
        names = {field.name: f"max_{field.name}" for field in fields(AskedLimits)}
        defaults: dict[str, Any] = {
            name: known[other].default for name, other in names.items() if other in known
        }
        if self.parameters().get("feedback") == _MEASURED:
            kept = ("linear_speed", "angular_speed", "joint_acceleration")
            defaults = {name: defaults[name] for name in kept if name in defaults}
        return AskedLimits(**defaults)

    def way_points(self, home: Pose) -> Trajectory:
        """Return the motion during the faults, from the pose of the arm at home."""
        random = self.random(1)
        is_whole = self.kind == FAULTY or self.motion == WAY_POINTS
        leg = _LEG if is_whole else _SLOW_LEG
        count = math.ceil(FAULTS / leg)
        poses = [_near(home, _FARTHEST, _TURN, random) for _ in range(count)]
        times = [leg * (i + 1) for i in range(count)]
        return Trajectory(times, [DesiredFrame(p, R) for p, R in poses])

    def last_pose(self, home: Pose) -> Pose:
        """Return where the arm is sent when the faults are over."""
        return _near(home, _LAST_FARTHEST, _LAST_TURN, self.random(2))

    def random(self, what: int) -> np.random.Generator:
        """Return the random generator of a purpose."""
        return np.random.default_rng((self.seed, CONTROLLERS.index(self.controller), what))


def _senses_wrench(controller: str) -> bool:
    return "wrench" in schemes()[controller].inputs


def _settings(controller: str) -> tuple[dict[str, str | float], ...]:
    known = fields_of(schemes()[controller].parameters)
    return next(settings for name, settings in _SETTINGS.items() if name in known)


def make_plan(seed: int, controller: str, kind: str = FAULTY) -> SequencePlan:
    """Return the sequence of a seed."""
    random = np.random.default_rng((seed, CONTROLLERS.index(controller)))
    motion = str(random.choice(MOTIONS, p=(0.55, 0.3, 0.15)))
    orientation = str(random.choice(sorted(ORIENTATIONS)))
    push = None
    if _senses_wrench(controller) and random.uniform() < 0.5:
        force, moment = random.uniform(-1, 1, size=(2, 3))
        push = (*(_PUSH_FORCE * force).tolist(), *(_PUSH_MOMENT * moment).tolist())
    setting = int(random.integers(len(_settings(controller))))
    plan = SequencePlan(seed, controller, motion, orientation, setting, push)
    return plan if kind == FAULTY else _smooth(plan)


def _smooth(plan: SequencePlan) -> SequencePlan:
    """Return a sequence with a robot and a user of its own."""
    random = plan.random(3)
    motion = str(random.choice(SMOOTH_MOTIONS, p=_MIXED))
    plan = replace(plan, kind=SMOOTH, motion=motion)
    hardest = _HARDER * max(plan.asked.joint_acceleration) if plan.asked else 0.0
    robot = draw_robot(random, plan.control, hardest if math.isfinite(hardest) else 0.0)
    return replace(
        plan,
        robot=robot,
        stream=draw_stream(random, motion),
        is_calm=bool(random.uniform() < 0.5),
    )


def _near(home: Pose, farthest: float, most: float, random: np.random.Generator) -> Pose:
    """Return a random pose near another, at most ``farthest`` [m] and ``most`` [rad] from it."""
    p, R = home
    step, axis = random.normal(size=(2, 3))
    step *= farthest * random.uniform(0.3, 1.0) / np.linalg.norm(step)
    axis *= most * random.uniform(0.3, 1.0) / np.linalg.norm(axis)
    return p + step, exp(axis) @ R


@cache
def faults_of(plan: SequencePlan) -> tuple[Fault, ...]:
    """Return the faults of a sequence."""
    return () if plan.is_calm else random_faults(plan.seed, plan.controller, FAULTS)


def shaken(
    faults: Sequence[Fault],
    beginning: float,
    released: float | None = None,
    topics: Sequence[str] = (*FROM_ROBOT, ROBOT, *TO_ROBOT),
) -> list[tuple[float, float]]:
    """Return from when to when [s] the arm is moved by what is not the controller, or seems to be.

    Args:
        faults: of a sequence.
        beginning: [s] of the sequence at which their times begin, and a push.
        released: when the push ends [s]; None where there is none.
        topics: whose faults count.
    """
    found = [
        (beginning + fault.at, beginning + fault.end)
        for fault in faults
        if fault.shakes and fault.topic in topics
    ]
    return found if released is None else [*found, (beginning, beginning), (released, released)]
