"""One tick of each controller, from state to command, beside the least that it takes.

That is Pinocchio's calls and one solve with numpy; for clik also one solve_ik of pink.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from itertools import count, cycle

import numpy as np
import pinocchio as pin

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.trajectories import Circle
from eulerparams_control.parameters.schemes import POSITION, SchemeInfo, schemes
from eulerparams_control.robot.catalogue import RobotDescription, load_robot
from eulerparams_control.robot.robot import Robot

type Call = Callable[[], object]

STEP = 1_000_000  # of the stamps [ns]
CIRCLE = Circle(0.05, np.array([1.0, 0.0, 0.0]), 4.0, 8.0, 0.2)
BLOCK = 20  # ticks of one call before the turn of the next


def report(title: str, rows: Sequence[tuple[str, Sequence[float], str, Sequence[float]]]) -> None:
    """Print p50 and p99 [us] of times [s], of their reference, and the ratios."""
    print(f"{title:33} p50      p99   reference [us] {'':11} p50      p99   ratio p50   p99")
    for name, own, reference, bare in rows:
        a, b = (1e6 * np.percentile(times, (50, 99)) for times in (own, bare))
        print(
            f"{name:28} {a[0]:9.1f} {a[1]:8.1f}   {reference:21} {b[0]:8.1f} {b[1]:8.1f} "
            f"{a[0] / b[0]:11.2f} {a[1] / b[1]:5.2f}"
        )


def in_turn(calls: Sequence[Call], ticks: int) -> list[list[float]]:
    """Return the times [s] of each call, measured in blocks in turn, so that noise meets all."""
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(ticks // BLOCK):
        for call, mine in zip(calls, times, strict=True):
            for _ in range(BLOCK):
                begin = time.perf_counter()
                call()
                mine.append(time.perf_counter() - begin)
    return times


def controller_of(info: SchemeInfo, robot: Robot, q: np.ndarray, **options: str) -> Controller:
    """Return a controller with the defaults of its node, that goes along the circle."""
    parameters = info.parameters(tip_frame=robot.tip_frame, **options)
    scheme = parameters.make_scheme(robot)
    if "wrench" in info.inputs:
        scheme.sense(SensedWrench(np.zeros(6), robot.placement(robot.tip_frame)))
    controller = Controller(scheme, ControllerOptions.of(parameters), q)
    frame = scheme.start_frame()
    controller.follow(CIRCLE.trajectory(frame.p_d, frame.R_d), None, 0.0)
    return controller


class Arm:
    """An arm, and its states (q, dq) along the circle, a millisecond apart."""

    def __init__(self, about: RobotDescription, ticks: int) -> None:
        self.urdf = about.urdf
        self.robot = Robot(about.urdf, about.base_frame, about.tip_frame)
        q = np.array(about.home)
        controller, self.states = controller_of(schemes()["clik"], self.robot, q), [(q, 0.0 * q)]
        for k in range(1, ticks + 1):
            command = controller.step(k * STEP, *self.states[-1], k * 1e-3)
            self.states.append((command.q, command.dq))

    def tick(self, info: SchemeInfo, orientation: str) -> Call:
        """Return a call that makes one tick after the other, as a node does."""
        numbers, first = count(1), self.states[0][0]
        controller = controller_of(info, self.robot, first, orientation=orientation)
        placement = self.robot.placement(self.robot.tip_frame)
        wrenches = cycle([SensedWrench(np.full(6, w), placement) for w in (1e-3, 2e-3)])
        sense = controller.scheme.sense if "wrench" in info.inputs else None

        def tick() -> None:
            k = next(numbers)
            if sense is not None:
                sense(next(wrenches))
            if controller.step(k * STEP, *self.states[k], k * 1e-3) is None or controller.fault:
                raise RuntimeError(f"{info.name}: {controller.why}")

        return tick

    def bare(self, control: str) -> Call:
        """Return the bare calls: J and a solve; for efforts also B, C dq + g and dJ dq of (33)."""
        model = pin.buildModelFromXML(self.urdf)
        data, tip = model.createData(), model.getFrameId(self.robot.tip_frame)
        v, axes, states = np.ones(6), pin.LOCAL_WORLD_ALIGNED, iter(self.states)

        def calls() -> None:
            q, dq = next(states)
            J = pin.computeFrameJacobian(model, data, q, tip, axes)
            _ = np.linalg.solve(J, v) if model.nv == 6 else J.T @ np.linalg.solve(J @ J.T, v)
            if control != POSITION:
                pin.crba(model, data, q)
                pin.computeGeneralizedGravity(model, data, q)
                pin.nonLinearEffects(model, data, q, dq)
                pin.forwardKinematics(model, data, q, dq, dq)
                pin.getFrameClassicalAcceleration(model, data, tip, axes)

        return calls

    def pink(self) -> Call:
        """Return one solve_ik of pink for the target of the first state."""
        import pink

        model, states = pin.buildModelFromXML(self.urdf), iter(self.states)
        configuration = pink.Configuration(model, model.createData(), self.states[0][0])
        task = pink.tasks.FrameTask(self.robot.tip_frame, 1.0, 1.0)
        task.set_target_from_configuration(configuration)

        def solve() -> None:
            configuration.update(next(states)[0])
            pink.solve_ik(configuration, [task], 1e-3, solver="quadprog")

        return solve


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="ur5", help="of config/robots")
    parser.add_argument("--orientation", default="euler_parameters", help="the representation")
    parser.add_argument("--ticks", type=int, default=2000, help="of each controller")
    options = parser.parse_args()
    arm = Arm(load_robot(options.robot), options.ticks)
    names, bare = list(schemes()), "Pinocchio and a solve"
    calls = [arm.tick(info, options.orientation) for info in schemes().values()]
    calls += [arm.bare(info.control) for info in schemes().values()]
    has_pink = find_spec("pink") is not None
    *times, pink = in_turn([*calls, arm.pink() if has_pink else lambda: None], options.ticks)
    own, least = times[: len(names)], times[len(names) :]
    rows = [(name, a, bare, b) for name, a, b in zip(names, own, least, strict=True)]
    if has_pink:
        rows.append(("clik", own[names.index("clik")], "pink's solve_ik", pink))
    report("tick [us]", rows)


if __name__ == "__main__":
    main()
