"""Plan of a sequence, drawn from its seed and its controller alone."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import numpy as np

from eulerparams_control.lab.campaign.draws import (
    MOTIONS,
    WAY_POINTS,
    RobotDraw,
    StreamDraw,
    draw_motion,
    draw_robot,
    draw_stream,
)
from eulerparams_control.lab.campaign.record import AskedLimits
from eulerparams_control.lab.faults import FROM_ROBOT, ROBOT, TO_ROBOT, Fault, random_faults
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.laws.rotations import Array, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.parameters.fields import fields_of
from eulerparams_control.parameters.schemes import POSITION, TORQUE, schemes

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

# A robot bears this many times the acceleration that its controller may ask for; and a position
# loop this gain times its period.
_HARDER, _GAIN = 2.0, 0.4

# Of the pose to which the arm is sent at last.
_LAST_FARTHEST, _LAST_TURN = 0.08, 0.3

_PUSH_FORCE, _PUSH_MOMENT = 20.0, 2.0  # [N], [Nm] at most, along each axis
_NOISE = 20.0  # [N], [Nm]: four standard deviations of a fault

# What else of a controller decides how it acts on messages: the first of these parameters that it
# has.  At the rate of the sequences a loop over the measured positions bears less gain than one
# over its own.
_MEASURED = "measured"
_SETTINGS: dict[str, tuple[dict[str, str | float], ...]] = {
    "feedback": (
        {"feedback": "internal"},
        {"feedback": _MEASURED, "k_Pp": 30.0, "k_Po": 30.0},
    ),
    "wrench_pairing": ({"wrench_pairing": "latest"}, {"wrench_pairing": "stamp"}),
    "quaternion_sign": ({"quaternion_sign": "hysteretic"}, {"quaternion_sign": "shortest"}),
}

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
        """What tells it from the others."""
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
        return (_PUSH_FORCE + _NOISE, _PUSH_MOMENT + _NOISE) if senses else (0.0, 0.0)

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
        """What its commands may ask for at most; None where that is not judged.

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
        """Return what draws for a purpose."""
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
    motion = draw_motion(random)
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
    """Return a pose at most so far [m], [rad] from another."""
    p, R = home
    step, axis = random.normal(size=(2, 3))
    step *= farthest * random.uniform(0.3, 1.0) / np.linalg.norm(step)
    axis *= most * random.uniform(0.3, 1.0) / np.linalg.norm(axis)
    return p + step, exp(axis) @ R


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
