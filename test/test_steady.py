"""The short way of a steady state commands what the plain way does, to the bit."""

from dataclasses import replace

import numpy as np
import pytest
from arms import HOME, UR5

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Circle, Trajectory
from eulerparams_control.parameters.schemes import schemes

MS = 1_000_000  # [ns]
NAMES = sorted(schemes())


class Pair:
    """Two controllers on the same arm; one of them always goes the plain way."""

    def __init__(self, name: str, *, timed: bool, **more) -> None:
        info = schemes()[name]
        parameters = info.parameters(tip_frame=UR5.tip_frame, **more)
        self.needs_wrench, self.timed = "wrench" in info.inputs, timed
        self.parameters, self.sides = parameters, []
        for _ in range(2):
            scheme = parameters.make_scheme(UR5, parameters.limits(UR5))
            self.sides.append(Controller(scheme, ControllerOptions.of(parameters), HOME))
        self.t, self.now, self.q, self.dq = 0, 0.0, HOME, np.zeros(6)
        self.random = np.random.default_rng(7)

    def both(self, act) -> None:
        """Do the same to both; what one refuses the other does, too."""
        short, plain = map(self._outcome, self.sides, [act, act])
        assert short == plain

    def _outcome(self, side, act):
        try:
            act(side)
        except InvalidMessageError as error:
            return str(error)
        return None

    def state(self, stamp=1.0, alone=0.0, late=0.0, moved=0.0) -> None:
        """Give both the next state, this many periods later, its stamp more; it is late [s]."""
        self.t += round((stamp + alone) * MS)
        self.now += stamp / 1000
        q, dq = self.q + 1e-7 * self.random.normal(size=6) + moved, self.dq
        wrench = SensedWrench(0.1 * self.random.normal(size=6), UR5.placement(""))
        now, found = self.now + late if self.timed else None, []
        for side, is_plain in zip(self.sides, (False, True), strict=True):
            if is_plain:
                side._steady = None
            if self.needs_wrench:
                side.scheme.sense(wrench)
            self.command = None
            try:
                self.command = side.step(self.t, q, dq, now)
            except InvalidMessageError as error:
                found.append(str(error))
            else:
                found.append(numbers_of(self.command))
            found.append((side.mode, side.why, side.period.seconds, side.resets, side.set_backs))
            found.append(side.guidance.motion.last.row.tolist())
        assert found[:3] == found[3:]
        command = self.command
        if command is not None and command.q is not None:
            self.q, self.dq = command.q, command.dq

    def states(self, count: int, **how) -> None:
        for _ in range(count):
            self.state(**how)


def numbers_of(command):
    return None if command is None else [None if v is None else v.tolist() for v in command]


def circle(controller, radius=0.02, period=2.0):
    start = controller.guidance.motion.last
    motion = Circle(radius, np.eye(3)[0], period, tilt=0.1, ramp=period / 2)
    controller.follow(motion.trajectory(start.p_d, start.R_d), None)


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("name", NAMES)
def test_both_ways_command_the_same_whatever_comes(name, timed):
    pair = Pair(name, timed=timed)
    pair.states(30)
    pair.both(circle)
    pair.states(400)
    for stamp in (2.0, 3.5, 0.4, 1.0, 7.0, -1.0, 1.0, 60.0):  # lost, early, set back, a pause
        pair.state(stamp=stamp)
        pair.states(20)
    pair.states(3, alone=1.0)  # the stamps go on without time
    pair.states(40, late=0.002)
    for k in range(150):  # later and later
        pair.state(late=k / 1000)
    pair.states(20)
    pair.state(moved=1.0)  # of another arm
    pair.states(30)
    pair.both(Controller.halt)
    pair.states(100)
    pair.both(Controller.resume)
    pair.states(10)
    pair.both(lambda side: side.aim(moved_up(side)))
    pair.states(200)
    pair.both(lambda side: circle(side, radius=0.1, period=0.5))  # slowed
    pair.states(100)


@pytest.mark.parametrize("name", NAMES)
def test_both_ways_command_the_same_whatever_changes(name):
    pair = Pair(name, timed=True)
    options = ControllerOptions.of(pair.parameters)
    pair.states(30)
    pair.both(circle)
    pair.states(100)
    pair.both(lambda side: side.changed(replace(options, speed_override=0.5)))
    pair.states(50)
    pair.both(lambda side: side.changed(options))
    pair.states(300)
    assert pair.sides[0].mode is Mode.FOLLOWING
    sigma = pair.sides[0].guidance.pace._row[1]  # the motion goes towards less, and more
    pair.both(lambda side: setattr(side.guidance.pace, "threshold", 1.0001 * sigma))
    pair.states(500)
    pair.both(lambda side: setattr(side.guidance.pace, "threshold", 0.0))
    pair.both(lambda side: circle(side, period=1.0))
    pair.states(30)
    end = moved_up(pair.sides[0])
    end = end._replace(dp_d=np.array([0.0, 0.0, 0.01]))
    pair.both(lambda side: side.follow(Trajectory([0.1], [end]), None))  # it ends while it moves
    pair.states(300)
    if pair.needs_wrench:
        pair.both(circle)
        pair.states(100)
        pair.needs_wrench = False
        pair.both(lambda side: side.scheme.sense(None))
        pair.states(60)


def moved_up(side):
    last = side.guidance.motion.last
    return DesiredFrame(last.p_d + [0.0, 0.0, 0.002], last.R_d)


@pytest.mark.parametrize("name", NAMES)
def test_a_steady_stream_along_a_trajectory_makes_no_detours(name):
    pair = Pair(name, timed=True)
    pair.states(30)
    pair.both(circle)
    pair.states(10)
    short, plain = pair.sides
    before = short.detours
    pair.states(400)
    assert short.detours == before
    assert plain.detours == 440
    assert short.mode is Mode.FOLLOWING
