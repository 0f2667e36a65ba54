"""The short way of a state commands what the long way does, to the bit."""

from collections import deque
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arms import HOME, UR5

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.control.mode import Mode, Why, contested
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import Circle, Trajectory
from eulerparams_control.parameters.schemes import schemes

MS = 1_000_000  # [ns]
OURS = "eulerparams_control"
NAMES = sorted(schemes())


class Pair:
    """Two controllers on the same arm; one of them always goes the long way."""

    def __init__(self, name: str, *, timed: bool, robot=UR5, home=HOME, **more) -> None:
        info, self.robot, self.name = schemes()[name], robot, name
        parameters = info.parameters(tip_frame=robot.tip_frame, **more)
        self.needs_wrench, self.timed = "wrench" in info.inputs, timed
        self.parameters, self.sides = parameters, []
        for _ in range(2):
            scheme = parameters.make_scheme(robot, parameters.limits(robot))
            self.sides.append(Controller(scheme, ControllerOptions.of(parameters), home))
        self.t, self.now, self.q, self.dq = 0, 0.0, home, np.zeros(robot.n)
        self.random = np.random.default_rng(7)

    def both(self, act) -> None:
        """Do the same to both; what one refuses the other does, too."""
        short, long = map(self._outcome, self.sides, [act, act])
        assert short == long

    def _outcome(self, side, act):
        try:
            act(side)
        except InvalidMessageError as error:
            return str(error)
        return None

    def state(self, stamp=1.0, alone=0.0, late=0.0, moved=0.0, fast=0.0, noise=1e-7) -> None:
        """Give both the next state.

        Args:
            stamp: periods after the last one; ``alone``: by how many more its stamp goes on.
            late: [s] that it is late.
            moved: [rad] that each joint is away.
            fast: speed of each joint, as a multiple of its limit.
            noise: [rad] of the positions.
        """
        self.t += round((stamp + alone) * MS)
        self.now += stamp / 1000
        dq = self.dq
        q = self.q + noise * self.random.normal(size=len(dq)) + moved
        dq = fast * self.robot.limits.velocity if fast else dq
        wrench = SensedWrench(0.1 * self.random.normal(size=6), self.robot.placement(""))
        now, found = self.now + late if self.timed else None, []
        for side, is_long in zip(self.sides, (False, True), strict=True):
            if is_long:
                side.short_way.forget()
            if self.needs_wrench:
                side.scheme.sense(wrench)
            self.command = None
            try:
                self.command = side.step(self.t, q, dq, now)
            except InvalidMessageError as error:
                found.append(str(error))
            else:
                found.append(numbers_in(self.command))
            found.append((side.mode, side.why))
        assert found[:2] == found[2:]
        command = self.command
        if command is not None and command.q is not None:
            self.q, self.dq = command.q, command.dq

    def states(self, count: int, **how) -> None:
        for _ in range(count):
            self.state(**how)
        self.compare()

    def compare(self) -> None:
        """Assert that all that they know is the same."""
        short, long = map(numbers_in, self.sides)
        assert short == long


# What is prepared, scratch, or kept in another form.
UNALIKE = {"short_way", "work", "robot", "leg", "sample", "then", "end"}


def numbers_in(thing, path="", seen=None) -> dict[str, str]:
    """Return all numbers of an object and of its parts, by name, to the bit."""
    seen, found = set() if seen is None else seen, {}
    if isinstance(thing, DesiredFrame):  # also where it is a row
        thing = thing.row
    if isinstance(thing, np.ndarray):
        return {path: str(thing.ravel().tolist())}
    if isinstance(thing, dict):
        parts = thing
    elif isinstance(thing, list | tuple | deque):
        parts = {str(k): part for k, part in enumerate(thing)}
    elif callable(thing) or id(thing) in seen:
        return {}
    elif type(thing).__module__.startswith(OURS) and hasattr(thing, "__dict__"):
        seen.add(id(thing))
        parts = vars(thing)
    else:
        return {path: repr(thing)}
    for name, part in parts.items():
        if name not in UNALIKE:
            found |= numbers_in(part, f"{path}.{name}", seen)
    return found


@cache
def circle_from(row, radius, period):
    """Return the times and frames of a circle that begins at a frame, whose numbers are given."""
    start = DesiredFrame.of(np.array(row))
    motion = Circle(radius, np.eye(3)[0], period, tilt=0.1, ramp=period / 2)
    found = motion.trajectory(start.p_d, start.R_d)
    return found.times, found.frames


def circle(controller, radius=0.02, period=2.0):
    start = tuple(controller.guidance.motion.last.row)
    controller.orders.follow(Trajectory(*circle_from(start, radius, period)), None)


def moved_up(side):
    last = side.guidance.motion.last
    return DesiredFrame(last.p_d + [0.0, 0.0, 0.002], last.R_d)


def stamps(*steps):
    """Return what gives states at these steps [ms]."""

    def act(pair):
        for step in steps:
            pair.state(stamp=step)
        pair.compare()

    return act


def halted_and_resumed(pair):
    pair.both(lambda side: side.orders.halt())
    pair.states(100)
    pair.both(lambda side: side.orders.resume())


def halted_resumed_silent_and_halted(pair):
    pair.both(lambda side: side.orders.halt())
    pair.states(600)
    pair.both(lambda side: side.orders.resume())
    pair.state(stamp=300.0)
    pair.states(100)
    pair.both(lambda side: side.orders.halt())
    pair.states(3, fast=0.6)


def other_gains(pair):
    """Change law and limits as a node does, while the arm moves."""
    scale = replace(pair.parameters, velocity_scale=0.5)
    for each in (scale, replace(scale, orientation="rotation_vector"), pair.parameters):
        pair.both(lambda side, each=each: change(side, each))
        pair.states(60)


def change(side, parameters):
    parameters.change_scheme(side.scheme, parameters.limits(UR5))
    side.changed(ControllerOptions.of(parameters))


def presses(pair):
    pair.both(lambda side: hasattr(side.scheme, "press") and side.scheme.press(np.ones(3)))


def wrench_lost_and_back(pair):
    loses_its_wrench(pair)
    pair.states(60)
    pair.needs_wrench = "wrench" in schemes()[pair.name].inputs


def slower_and_back(pair):
    options = ControllerOptions.of(pair.parameters)
    pair.both(lambda side: side.changed(replace(options, speed_override=0.5)))
    pair.states(50)
    pair.both(lambda side: side.changed(options))
    pair.states(100)


def near_a_singularity(pair):
    for threshold in (1.0, 0.0):  # of a singular value
        pair.both(lambda side, most=threshold: setattr(side.guidance.pace, "threshold", most))
        pair.states(100)


def ends_while_it_moves(pair):
    end = moved_up(pair.sides[0])._replace(dp_d=np.array([0.0, 0.0, 0.01]))
    pair.both(lambda side: side.orders.follow(Trajectory([0.2], [end]), None))
    pair.states(260)


def a_stream(pair):
    for _ in range(30):
        point = SetPoint(pair.sides[0].guidance.motion.last.moved(1e-3), 0.05)
        pair.both(lambda side, point=point: side.orders.follow(point, pair.t + MS))
        pair.state()
    pair.states(60)


def later(pair):
    pair.both(
        lambda side: side.orders.follow(Trajectory([0.2], [moved_up(side)]), pair.t + 50 * MS)
    )
    pair.states(100)


def loses_its_wrench(pair):
    pair.needs_wrench = False
    pair.both(lambda side: hasattr(side.scheme, "sense") and side.scheme.sense(None))


def contested_for_a_while(pair):
    pair.both(lambda side: side.supervisor.distrust(contested("a, b")))
    pair.states(5)
    pair.both(lambda side: side.supervisor.trust())


EVENTS = {
    "nothing": lambda pair: None,
    "still": lambda pair: pair.states(30, noise=0.0),
    "lost": stamps(2.0, 1.0, 3.5, 1.0, 7.0),
    "early": stamps(0.4),
    "back": stamps(-1.0),
    "set back": stamps(-5.0, 1.0, 1.0, 1.0),
    "silence": stamps(60.0),
    "slower": stamps(*np.linspace(1.0, 4.9, 200), *[4.9] * 150),
    "slow": stamps(*np.linspace(1.0, 9.0, 300)),
    "stamps alone": lambda pair: pair.states(3, alone=0.6),
    "late": lambda pair: pair.states(40, late=0.0015),
    "later": lambda pair: [pair.state(late=k / 1000) for k in range(150)],
    "another arm": lambda pair: pair.state(moved=1.0),
    "too fast": lambda pair: pair.states(3, fast=2.0),
    "runs away": lambda pair: pair.states(3, fast=0.6),
    "halted": halted_and_resumed,
    "halted again": halted_resumed_silent_and_halted,
    "silence alone": lambda pair: pair.state(late=0.2),
    "other gains": other_gains,
    "presses": presses,
    "not a number": lambda pair: pair.state(moved=np.nan),
    "goal": lambda pair: pair.both(lambda side: side.orders.aim(moved_up(side))),
    "stream": a_stream,
    "motion to come": later,
    "twist": lambda pair: pair.both(lambda side: side.orders.jog(np.full(6, 0.01))),
    "beyond limits": lambda pair: pair.both(lambda side: circle(side, 0.1, 0.5)),
    "slower and back": slower_and_back,
    "near a singularity": near_a_singularity,
    "ends": ends_while_it_moves,
    "wrench lost": loses_its_wrench,
    "wrench lost and back": wrench_lost_and_back,
    "settled": lambda pair: pair.both(lambda side: side.orders.settle(Why())),
    "contested": contested_for_a_while,
}


@pytest.mark.parametrize("event", EVENTS)
@pytest.mark.parametrize("name", NAMES)
def test_both_ways_command_the_same_whatever_comes(name, event):
    more = {"max_latency": 1.0} if event == "silence alone" else {}
    if (name, event) == ("clik", "slower"):
        more = {"k_Pp": 200.0}  # [1/s]: the states are too rare for it
    # without a clock of the machine, only who commands positions or efforts makes a difference
    for timed in (True, False) if name in ("clik", "dynamic_control") else (True,):
        pair = Pair(name, timed=timed, **more)
        short = pair.sides[0]
        pair.states(30)
        before = short.short_way.detours
        pair.states(5)
        assert short.short_way.detours == before  # a pose that is held is steady, too
        pair.both(circle)
        pair.states(60)
        assert short.short_way.detours == before + 1
        EVENTS[event](pair)
        pair.states(60)


def test_a_halt_that_is_over_counts_for_no_other():
    pair = Pair("dynamic_control", timed=True)
    pair.states(30)
    halted_resumed_silent_and_halted(pair)
    assert pair.sides[0].mode is Mode.STOPPED  # not released, as one that does not stop
