"""One tick of each law, measured state to command, against the Pinocchio calls that it needs."""

from collections.abc import Iterator, Sequence
from itertools import count, cycle
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from rows import Row
from timing import Call, compared

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.trajectories import Circle
from eulerparams_control.parameters.schemes import POSITION, SchemeInfo, schemes
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

STEP = 1_000_000  # of the stamps [ns]
CIRCLE = Circle(0.05, np.array([1.0, 0.0, 0.0]), 4.0, 8.0, 0.2)
DEFAULT = "euler_parameters"
LINK = """<link name="l{0}"><inertial><mass value="1"/><origin xyz="0 0 0.05"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="j{0}" type="revolute"><parent link="l{0}"/><child link="l{1}"/>
<origin xyz="0 0 0.1"/><axis xyz="{2}"/>
<limit lower="-3" upper="3" velocity="3" effort="300"/></joint>"""


def controller_of(info: SchemeInfo, robot: Robot, q: np.ndarray, orientation=DEFAULT) -> Controller:
    """Return a controller with the defaults of its node, that goes along the circle."""
    parameters = info.parameters(orientation=orientation, tip_frame=robot.tip_frame)
    scheme = parameters.make_scheme(robot, parameters.limits(robot))
    if "wrench" in info.inputs:
        scheme.sense(SensedWrench(np.zeros(6), robot.placement(robot.tip_frame)))
    controller = Controller(scheme, ControllerOptions.of(parameters), q)
    frame = scheme.start_frame()
    controller.orders.follow(CIRCLE.trajectory(frame.p_d, frame.R_d), None, 0.0)
    return controller


class Arm(NamedTuple):
    """A robot and its states along the circle, a millisecond apart: q, dq (n,) each."""

    robot: Robot
    urdf: str
    states: Sequence[tuple[np.ndarray, np.ndarray]]


def arm_of(urdf: str, base: str, tip: str, home: Sequence[float], ticks: int) -> Arm:
    """Return an arm that goes where clik tells it to."""
    robot, q = Robot(urdf, base, tip), np.array(home)
    controller, states = controller_of(schemes()["clik"], robot, q), [(q, np.zeros_like(q))]
    for k in range(1, ticks + 1):
        command = controller.step(k * STEP, *states[-1], k * 1e-3)
        states.append((command.q, command.dq))
    return Arm(robot, urdf, states)


def known(name: str, ticks: int) -> Arm:
    """Return an arm of the catalogue."""
    about = load_robot(name)
    return arm_of(about.urdf, about.base_frame, about.tip_frame, about.home, ticks)


def chain(n: int, ticks: int) -> Arm:
    """Return an arm of n joints, made on the fly."""
    links = [LINK.format(k) for k in range(n + 1)]
    joints = [JOINT.format(k, k + 1, "0 1 0" if k % 3 else "0 0 1") for k in range(n)]
    urdf = f'<robot name="chain">{"".join(links + joints)}</robot>'
    return arm_of(urdf, "l0", f"l{n}", np.resize([0.3, 0.6, 0.7], n), ticks)


def tick_call(info: SchemeInfo, arm: Arm, orientation: str = DEFAULT) -> Call:
    """Return a call that makes one tick after the other, as a node does."""
    robot, numbers = arm.robot, count(1)
    controller = controller_of(info, robot, arm.states[0][0], orientation)
    placement = robot.placement(robot.tip_frame)
    wrenches = cycle([SensedWrench(np.full(6, w), placement) for w in (1e-3, 2e-3)])
    sense = controller.scheme.sense if "wrench" in info.inputs else None

    def tick():
        k = next(numbers)
        if sense is not None:
            sense(next(wrenches))
        if controller.step(k * STEP, *arm.states[k], k * 1e-3) is None or controller.fault:
            raise RuntimeError(f"{info.name}, {orientation}: {controller.why}")

    return tick


def bare_call(info: SchemeInfo, arm: Arm) -> Call:
    """Return the bare calls: J with forward kinematics, a solve; B, C dq, g and dJ dq for (33)."""
    model = pin.buildModelFromXML(arm.urdf)
    data, tip = model.createData(), model.getFrameId(arm.robot.tip_frame)
    v, axes, states = np.ones(6), pin.LOCAL_WORLD_ALIGNED, iter(arm.states)
    is_square = model.nv == 6

    def kinematics():
        q, dq = next(states)
        J = pin.computeFrameJacobian(model, data, q, tip, axes)
        x = np.linalg.solve(J, v) if is_square else J.T @ np.linalg.solve(J @ J.T, v)
        return q, dq, x, data.oMf[tip].rotation, data.oMf[tip].translation

    def dynamics():
        q, dq, *_ = kinematics()
        pin.crba(model, data, q)
        pin.computeGeneralizedGravity(model, data, q)
        pin.nonLinearEffects(model, data, q, dq)
        pin.forwardKinematics(model, data, q, dq, dq)
        return pin.getFrameClassicalAcceleration(model, data, tip, axes).vector

    return kinematics if info.control == POSITION else dynamics


def bare_calls(arm: Arm) -> dict[str, Call]:
    """Return the bare calls by what the robot is commanded."""
    return {info.control: bare_call(info, arm) for info in schemes().values()}


def pink_call(arm: Arm) -> Call:
    """Return one solve_ik of pink for the same robot and the target of its first state."""
    import pink

    model, states = pin.buildModelFromXML(arm.urdf), iter(arm.states)
    configuration = pink.Configuration(model, model.createData(), arm.states[0][0])
    task = pink.tasks.FrameTask(arm.robot.tip_frame, position_cost=1.0, orientation_cost=1.0)
    task.set_target_from_configuration(configuration)

    def solve():
        configuration.update(next(states)[0])
        return pink.solve_ik(configuration, [task], 1e-3, solver="quadprog")

    return solve


def ticks(quick: bool) -> Iterator[Row]:
    """Yield each law with each representation, and pink against clik."""
    repeat = 25 if quick else 100
    arm = known("ur5", 20 * repeat)
    bare, laws = bare_calls(arm), schemes().values()
    pairs = [(f"tick / bare calls: {info.name}", orientation, tick_call(info, arm, orientation),
              bare[info.control]) for info in laws for orientation in ORIENTATIONS]  # fmt: skip
    clik = tick_call(schemes()["clik"], arm)
    pairs.append(("pink's solve_ik / tick of clik", "", pink_call(arm), clik))
    yield from compared(pairs, repeat)


def cold_ticks(quick: bool) -> Iterator[Row]:
    """Yield each law, a millisecond after its last tick."""
    repeat, what = 10 if quick else 40, "cold tick / cold bare calls"
    arm = known("ur5", 10 * repeat)
    bare, laws = bare_calls(arm), schemes().values()
    pairs = [(what, info.name, tick_call(info, arm), bare[info.control]) for info in laws]
    yield from compared(pairs, repeat, 10, cold=True)


def growth(quick: bool) -> Iterator[Row]:
    """Yield how ticks grow with the number of joints, and of controllers in one process."""
    repeat = 25 if quick else 50
    n = 20 * repeat
    for info in schemes().values():
        one, *others = known("ur5", n), known("kuka_iiwa", n), chain(14, n)
        what = f"tick / bare calls, by joints: {info.name}"
        pairs = [(what, f"{arm.robot.n} joints", tick_call(info, arm), bare_call(info, arm))
                 for arm in (one, *others)]  # fmt: skip
        what, alone = f"tick among arms / of one arm: {info.name}", tick_call(info, one)
        for k in (2, 4, 8):
            several = cycle([tick_call(info, one) for _ in range(k)])
            pairs.append((what, f"{k} arms", lambda several=several: next(several)(), alone))
        yield from compared(pairs, repeat)
