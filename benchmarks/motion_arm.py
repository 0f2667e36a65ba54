"""A controller that drives an arm which does exactly what it is told, in one process.

A command of positions is the next state; efforts move the arm as its model says.  What is measured
are the commands: of the tip by the kinematics, and of the joints.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array, exp
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import way_points
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.robot.catalogue import find_urdf, load_robot
from eulerparams_control.robot.robot import Robot

LASTING = 0.1  # [s] of a set-point
KINOVA = "example-robot-data:kinova_description/robots/kinova.urdf"
# Robots with a way along which they can go: configuration, direction.  The Kinova's joint 6 is 0.15
# rad before pi.
WAYS = {
    "ur5": ((), (0.0, 1.0, 0.0)),
    "panda": ((), (0.0, 1.0, 0.0)),
    "kinova": ((0.3, 2.9, 1.3, -2.07, 1.4, math.pi - 0.15), (-1.0, 0.0, 0.0)),
}


@cache
def arm_of(name: str) -> tuple[Robot, Array, Array]:
    """Return a robot, its configuration and its way."""
    home, way = WAYS[name]
    if name == "kinova":
        text = find_urdf(KINOVA, Path()).read_text(encoding="utf-8")
        return Robot(text, "base", "j2s6s200_end_effector"), np.array(home), np.array(way)
    about = load_robot(name)
    robot = Robot(about.urdf, about.base_frame, about.tip_frame, about.joints)
    return robot, np.array(about.home), np.array(way)


class Bench:
    """A controller and its arm, at a rate of joint_states [Hz]; drivers wrap continuous joints."""

    def __init__(self, scheme: str, arm: str, rate: float) -> None:
        self.robot, self.q, self.way = arm_of(arm)
        self.dq, self.dt = np.zeros(self.robot.n), 1 / rate
        self.time, self.stamps = 0.0, 0.0
        self.parameters = schemes()[scheme].parameters()
        law = self.parameters.make_scheme(self.robot, self.parameters.limits(self.robot))
        if scheme == "impedance_control":
            law.sense(SensedWrench(np.zeros(6), self.robot.placement(self.robot.tip_frame)))
        self.controller = Controller(law, ControllerOptions.of(self.parameters), self.measured)
        state = self.robot.state(self.q, self.dq)
        self.start = DesiredFrame(state.p_e, state.R_e)
        self.rows: list[tuple[Array, Array]] = []
        self.refused = self.silent = 0
        self.fault = ""

    @property
    def measured(self) -> Array:
        """The positions, those of continuous joints within a turn."""
        wrapped = np.pi - (np.pi - self.q) % (2 * np.pi)
        return np.where(np.isinf(self.robot.limits.upper), wrapped, self.q)

    @property
    def stamp(self) -> int:
        """Of the newest state [ns]."""
        return round(1e9 * (10.0 + self.time + self.stamps))

    def at(
        self, x: float, angle: float = 0.0, speed: float = 0.0, noise: Array | float = 0.0
    ) -> DesiredFrame:
        """Return a frame along the way [m], turned [rad], moving [m/s]."""
        p_d = self.start.p_d + x * self.way + noise
        return DesiredFrame(p_d, self.start.R_d @ exp(angle * np.eye(3)[1]), speed * self.way)

    def send(self, reference: Any, start: int | None = None) -> None:
        """Follow a reference, a pose to aim at, or a twist, unless it is refused."""
        try:
            if isinstance(reference, DesiredFrame):
                self.controller.aim(reference, self.time)
            elif isinstance(reference, np.ndarray):
                self.controller.jog(reference, self.time)
            else:
                self.controller.follow(reference, start, self.time)
        except InvalidMessageError:
            self.refused += 1

    def change(self, **values: float) -> None:
        """Change parameters while running."""
        self.parameters = replace(self.parameters, **values)
        limits = self.parameters.limits(self.robot)
        self.parameters.change_scheme(self.controller.scheme, limits)
        self.controller.changed(ControllerOptions.of(self.parameters))

    def run(self, events: "Events", duration: float) -> "Bench":
        """Run for a time [s] with what happens then."""
        left = sorted(events, key=lambda event: event[0])
        for k in range(1, round(duration / self.dt) + 1):
            self.time = k * self.dt
            while left and left[0][0] <= self.time:
                left.pop(0)[1](self)
            self._step()
        return self

    def _step(self) -> None:
        command = None
        with suppress(InvalidMessageError):
            command = self.controller.step(self.stamp, self.measured, self.dq, self.time)
        self.fault = self.fault or self.controller.fault
        if command is None:
            self.silent += 1
        elif command.q is not None and command.dq is not None:
            self.q, self.dq = command.q, command.dq
        elif command.effort is not None:
            self._move(command.effort)
        self.rows.append((self.q, self.dq))

    def _move(self, effort: Array) -> None:
        for _ in range(count := max(1, round(2000 * self.dt))):
            model = self.robot.dynamic_state(self.q, self.dq)
            ddq = np.linalg.solve(model.B, effort - model.C_dq - model.g)
            self.dq = self.dq + self.dt / count * ddq
            self.q = self.q + self.dt / count * self.dq

    def measure(self) -> "Measured":
        """Return what was commanded."""
        q, dq = (np.array(column) for column in zip(*self.rows, strict=True))
        tip = self.robot.states(q, dq)
        ddq = np.abs(np.diff(dq, axis=0)).max(axis=1) / self.dt
        bend = np.abs(np.diff(q, 2, axis=0)).max(axis=1) / self.dt**2
        return Measured(
            tip.p_e,
            np.linalg.norm(tip.dp_e, axis=1),
            np.linalg.norm(np.diff(tip.dp_e, axis=0), axis=1) / self.dt,
            np.maximum(ddq[1:], bend if self.parameters.scheme.control == "position" else 0.0),
            float(np.abs(np.diff(q, axis=0)).max()),
        )


class Measured(NamedTuple):
    """Of the tip: places, speeds, accelerations; of the joints: accelerations, largest step."""

    p: Array
    speed: Array
    acceleration: Array
    joints: Array
    step: float


Events = list[tuple[float, Callable[[Bench], object]]]


def stream(rate: float, v: float, *, seconds: float = 2.0, twists: bool = False,
           jitter: float = 0.0, noise: tuple[float, float] = (0.0, 0.0), latency: float = 0.0,
           ahead: float | None = None) -> Events:  # fmt: skip
    """Return a stream along the way at v [m/s], from 0.1 s on.

    Args:
        rate: [Hz].
        v: [m/s].
        seconds: that it takes.
        twists: whether it has twists.
        jitter: of the periods.
        noise: of position [m] and rotation [rad].
        latency: [s] between stamp and receipt.
        ahead: [s] by which the stamps are ahead of the newest state; None: stamps of 0.
    """
    rng = np.random.default_rng(1)
    events: Events = []
    for k in range(int(seconds * rate)):
        t = k / rate
        sent = 0.1 + t + jitter / rate * rng.uniform(-1, 1)
        off, turn = noise[0] * rng.normal(size=3), noise[1] * rng.normal()

        def send(bench: Bench, t: float = t, sent: float = sent, off: Array = off,
                 turn: float = turn) -> None:  # fmt: skip
            frame = bench.at(v * t, turn, v if twists else 0.0, off)
            start = None if ahead is None and not latency else round((10 + sent) * 1e9)
            if ahead is not None:
                start = bench.stamp + round(ahead * 1e9)
            bench.send(SetPoint(frame, LASTING), start)

        events.append((max(sent, 0.0) + latency, send))
    return events


def to(
    x: float, T: float, *, back: float | None = None, after: float | None = None
) -> Callable[[Bench], None]:
    """Return the sending of a trajectory to x [m] in T [s], or from ``back``, ``after`` [s]."""

    def send(bench: Bench) -> None:
        begin = [] if back is None else [bench.at(back)]
        poses = [(frame.p_d, frame.R_d) for frame in (*begin, bench.at(x))]
        times = [T] if back is None else [0.0, T]
        start = None if after is None else bench.stamp + round(after * 1e9)
        bench.send(way_points(times, poses), start)

    return send


def turn_joint(angle: float) -> Callable[[Bench], None]:
    """Return the sending of a trajectory that turns the last joint by an angle [rad] in 1.5 s."""

    def send(bench: Bench) -> None:
        goal = bench.controller.scheme.frame_at(bench.q + angle * np.eye(bench.robot.n)[-1])
        bench.send(way_points([1.5], [(goal.p_d, goal.R_d)]))

    return send
