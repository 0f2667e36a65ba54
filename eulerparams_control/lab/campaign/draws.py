"""Which robot a sequence has, and how its user leads the arm: what is drawn of each.

The robots differ as those of the field do: in rate, delay and lag, in what their drivers report,
and in what they do when nothing comes.  A user sends whole motions, or pieces of one: poses with
or without twists, chunks as learned policies send them, goals, twists; early, late, noisy, and
stamped by another clock.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from eulerparams_control.parameters.schemes import POSITION
from eulerparams_control.robot.catalogue import RobotDescription, load_robot
from sim_bridge.drive_modes import DrivePolicy, OnSilence
from sim_bridge.parameters import SimulatorParameters

WAY_POINTS, STREAM, NOTHING = "way points", "stream", "nothing"
CHUNKS, POSES, GOALS, TWISTS = "chunks", "target poses", "goals", "target twists"
MOTIONS = (WAY_POINTS, STREAM, NOTHING)
"""Motions of the arm in a sequence of faults."""

SMOOTH_MOTIONS = (*MOTIONS, CHUNKS, POSES, GOALS, TWISTS)
"""What it does in a sequence of smooth motions."""

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
        """Return what is simulated."""
        return SimulatorParameters(
            rate=self.steps * self.rate,
            control=control,
            protective_speed=PROTECTIVE_SPEED,
            servo_lag=self.lag,
            wrap_continuous=self.turns,
            velocities=self.velocities,
        )

    def policy(self) -> DrivePolicy:
        """Return what it does about its commands; whether they cease is seen once a period."""
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


def draw_motion(random: np.random.Generator) -> str:
    """Return what the arm does."""
    return str(random.choice(SMOOTH_MOTIONS, p=_MIXED))


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
