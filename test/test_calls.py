"""How few calls and files lie between joint_states and a command: a reader follows them all."""

import sys
from collections import Counter
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from arms import HOME, STILL, UR5
from ros_processes import FRAMES, Controlled, pose, reference

from eulerparams_control.control.clock import SteadyClock
from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.laws.compiled import IS_COMPILED
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Circle
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.ros.control_node import ControlNode

PACKAGE = str(Path(sys.modules[Controller.__module__].__file__).parents[1])
MS = 1_000_000  # [ns]
TICKS = 10  # among them one that looks at singularities and limits

pytestmark = pytest.mark.skipif(not IS_COMPILED, reason="formulas are calls, too")


def calls_of(act, until=""):
    """Return the calls of functions of the package, by file and name, that ``act`` makes.

    Those until the last return of a function ``until``, if one is named.  The clock of the world
    is set meanwhile, by who listens in the same process.
    """
    found, seen = Counter(), Counter()

    def see(frame, event, _):
        code, file = frame.f_code, frame.f_code.co_filename
        is_ours = file.startswith(PACKAGE) and not file.startswith(f"{PACKAGE}/lab")
        if event == "call" and is_ours and code is not SteadyClock.go_by.__code__:
            seen[file.removeprefix(PACKAGE), code.co_qualname] += 1
        if event == "return" and until in ("", code.co_qualname):
            found.update(seen)
            seen.clear()

    before = sys.getprofile()
    sys.setprofile(see)
    try:
        act()
    finally:
        sys.setprofile(before)
    return found


def assert_few(ticks, most_calls, most_files):
    """Assert that no tick has more calls, in more files."""
    for found in ticks:
        files = {file for file, _ in found}
        assert 0 < found.total() <= most_calls, found
        assert 0 < len(files) <= most_files, sorted(files)


@pytest.mark.parametrize("name", sorted(schemes()))
def test_a_steady_tick_of_a_controller_is_few_calls_in_few_files(name):
    info, times = schemes()[name], count(1)
    parameters = info.parameters(tip_frame=UR5.tip_frame)
    scheme = parameters.make_scheme(UR5, parameters.limits(UR5))
    controller, q = Controller(scheme, ControllerOptions.of(parameters), HOME), HOME
    start = scheme.start_frame()
    circle = Circle(0.01, np.eye(3)[0], 4.0, ramp=1.0).trajectory(start.p_d, start.R_d)
    controller.orders.follow(circle, None, 0.0)

    def tick():
        nonlocal q
        k = next(times)
        if "wrench" in info.inputs:
            scheme.sense(SensedWrench(1e-3 * k * np.ones(6), UR5.placement("")))
        found = calls_of(lambda: controller.step(k * MS, q, STILL + 1e-9 * k, k / 1000))
        assert controller.fault == ""
        q = q + 1e-9
        return found

    for _ in range(50):
        tick()
    assert_few([tick() for _ in range(TICKS)], 22, 12)


@pytest.mark.parametrize(
    ("name", "calls", "files"),
    [
        ("clik", 20, 13),
        ("dynamic_control", 23, 13),
        ("compliance_control", 25, 15),
        ("impedance_control", 32, 18),
    ],
)
def test_from_joint_states_to_the_bytes_of_the_command_are_few_calls(
    name, calls, files, world, monkeypatch
):
    ticks, original = [], ControlNode._on_joint_states

    def counted(node, data):
        ticks.append(calls_of(lambda: original(node, data), "CommandPublisher.publish"))

    monkeypatch.setattr(ControlNode, "_on_joint_states", counted)
    running, (p, R) = Controlled(world, name, FRAMES), pose(HOME)
    for is_following in (False, True):
        if is_following:
            running.follow(reference(DesiredFrame(p + [0.0, 0.05, 0.0], R), times=(1.0,)))
        running.arm.ticks(50)
        ticks.clear()
        running.arm.ticks(TICKS)
        assert len(ticks) == TICKS
        assert_few(ticks, calls, files)
