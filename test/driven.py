"""A UR5, or another arm, under a controller: states in, commands out, without ROS."""

from functools import partial

import numpy as np
from arms import HOME, STILL, UR5
from arms import pose_of as tip_pose
from samples import about

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.trajectories import way_points

MS = 1_000_000  # [ns]
T_0 = 1_700_000_000_000_000_000  # [ns]
DT = 0.001  # [s]
LIMITS = MotionLimits(0.25, 1.0, 1.0, 4.0, 20.0, 80.0)
CHECKED = ControllerOptions(check_states=True)

pose_of = partial(tip_pose, UR5)


def moved(x=0.0, angle=0.0):
    """Return home's pose moved along and turned about the base's x."""
    home = pose_of(HOME)
    return DesiredFrame(home.p_d + x * np.eye(3)[0], about(0, angle) @ home.R_d)


class Driver:
    """An arm, its controller, and the time of both.

    Args:
        scheme: of the controller.
        q: (n,) where the arm is.
        options: of the controller.
        period: [s] of the states.
        real: whether states say when they came.
        obeys: whether the arm goes where positions are commanded; under efforts it stays.
        wraps: whether continuous joints are reported within (-pi, pi].

    Attributes:
        t, now: stamp [ns] of the last state, and when it came [s].
        q, dq: (n,) of the arm.
        commands: all answers.
    """

    def __init__(
        self, scheme, q=HOME, options=CHECKED, period=DT, *, real=True, obeys=True, wraps=False
    ):
        self.robot, self.period, self.real = scheme.robot, period, real
        self.obeys, self.wraps = obeys, wraps
        self.q, self.dq = q.copy(), np.zeros(scheme.robot.n)
        self.t, self.now, self.commands = T_0, 50.0, []
        self.controller = Controller(scheme, options, self.measured)

    def __getattr__(self, name):
        return getattr(self.controller, name)

    @property
    def measured(self):
        """The positions that the driver reports."""
        q = self.q.copy()
        if self.wraps:
            turning = np.isinf(self.robot.limits.upper)
            q[turning] = np.pi - (np.pi - q[turning]) % (2 * np.pi)
        return q

    @property
    def receipt(self):
        return self.now if self.real else None

    @property
    def here(self):
        """The pose of the tip, at rest."""
        return self.scheme.frame_at(self.q)

    def step(self, dt=None, *, stamps=None, q=None, dq=None, late=0.0):
        """Let a time pass, by the stamps perhaps another, and obey; return the command.

        The arm may be moved to ``q`` and ``dq`` by others; the state may come late.
        """
        dt = self.period if dt is None else dt
        self.now += dt
        self.t += round(1e9 * (dt if stamps is None else stamps))
        self.q = self.q if q is None else q
        self.dq = self.dq if dq is None else dq
        receipt = self.now + late if self.real else None
        command = self.controller.step(self.t, self.measured, self.dq, receipt)
        self.commands.append(command)
        if self.obeys and command is not None and command.q is not None:
            turns = 2 * np.pi * np.round((self.q - command.q) / (2 * np.pi))
            turns[np.isfinite(self.robot.limits.upper)] = 0
            self.q, self.dq = command.q + turns * self.wraps, command.dq
        return command

    def run(self, seconds, **state):
        """Go on for a time [s]; return the commands."""
        return [self.step(**state) for _ in range(round(seconds / self.period))]

    def go(self, *frames, seconds=1.0):
        """Send the motion to frames, so long [s] to each."""
        path = [(frame.p_d, frame.R_d) for frame in frames]
        times = [seconds * (k + 1) for k in range(len(path))]
        self.controller.follow(way_points(times, path), None, self.receipt)


def on_its_way(scheme, **options):
    """Return an arm halfway to a goal; under efforts it has stayed."""
    arm = Driver(scheme, **options)
    arm.go(moved(0.1, 0.4))
    arm.run(0.2)
    return arm


def assert_holds(arm, q, within=1e-12, steps=3):
    """Assert that the arm, at rest at q, is held there from now on."""
    for command in (arm.step(q=q, dq=STILL) for _ in range(steps)):
        np.testing.assert_allclose(command.q, q, rtol=0, atol=within)
        np.testing.assert_allclose(command.dq, 0, atol=100 * within)
