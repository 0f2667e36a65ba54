"""The simulated robot: in one process, in lock-step and in real time, against bare PyBullet."""

import time
from collections.abc import Iterator, Mapping
from itertools import count
from typing import Any

import numpy as np
import pybullet
from bench_node import ECHO, NODES, PERIOD, SENSING, UR5, Answers, Session, echo, session
from bench_tick import STEP, controller_of
from rows import Row
from sensor_msgs.msg import JointState
from timing import Call, compared, cpu_time

from eulerparams_control.events import Event
from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.parameters.schemes import POSITION, SchemeInfo, schemes
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.message_info import with_info
from sim_bridge.simulator import Simulator, SimulatorParameters

MODEL = Robot(UR5.urdf, UR5.base_frame, UR5.tip_frame)
HOME = np.array(UR5.home)
TIP = {"tip_frame": UR5.tip_frame}
CIRCLE = {"motion": "circle", "circle_normal": [1.0, 0.0, 0.0], "circle_turns": 8.0, **TIP}
BRIDGE = "pybullet_bridge"


def bare_step(control: str) -> Call:
    """Return a step of PyBullet alone: a command of all joints, the step, joints and sensor."""
    simulator = Simulator(UR5, SimulatorParameters(control=control))
    engine, n = simulator.engine, MODEL.n
    body, me = engine.body, engine.client
    infos = [pybullet.getJointInfo(body, k, me) for k in range(pybullet.getNumJoints(body, me))]
    arm = [info[0] for info in infos if info[1].decode() in UR5.joints]
    sensed, command = [*arm, engine.sensor_link], {"forces": MODEL.limits.effort.tolist()}
    if control == POSITION:
        mode = pybullet.VELOCITY_CONTROL
        command["targetVelocities"] = [0.0] * n
    else:
        mode = pybullet.TORQUE_CONTROL
        command["forces"] = MODEL.dynamic_state(HOME, np.zeros(n)).g.tolist()
        simulator.command_effort(command["forces"])  # its motors are off from now on

    def step():
        pybullet.setJointMotorControlArray(body, arm, mode, **command, physicsClientId=me)
        engine.step()
        *joints, felt = pybullet.getJointStates(body, sensed, me)
        return [joint[0] for joint in joints], [joint[1] for joint in joints], felt[2]

    return step


def controlled_step(info: SchemeInfo) -> Call:
    """Return a step of a simulated arm that goes along the circle."""
    simulator = Simulator(UR5, SimulatorParameters(control=info.control))
    controller, numbers = controller_of(info, MODEL, HOME), count(1)
    placement = MODEL.placement(UR5.sensor_frame)

    def step():
        k, state = next(numbers), simulator.read()
        if "wrench" in info.inputs:
            controller.scheme.sense(SensedWrench(state.wrench, placement))
        command = controller.step(k * STEP, state.q, state.dq, k * PERIOD)
        if command is None or controller.fault:
            raise RuntimeError(f"{info.name}: {controller.why}")
        if command.effort is None:
            simulator.command_position(command.q, command.dq)
        else:
            simulator.command_effort(command.effort)
        simulator.step()

    return step


def in_process(quick: bool) -> Iterator[Row]:
    """Yield simulations without ROS."""
    bare = {info.control: bare_step(info.control) for info in schemes().values()}
    what = "bare PyBullet step / controlled step in one process"
    pairs = [(what, info.name, bare[info.control], controlled_step(info))
             for info in schemes().values()]  # fmt: skip
    yield from compared(pairs, 25 if quick else 100)


class BareRobot:
    """PyBullet alone on ROS topics: steps at each command in lock-step, or when it is told to."""

    def __init__(self, here: Session, control: str, lockstep: bool) -> None:
        self._step, self._lockstep, self.steps = bare_step(control), lockstep, 0
        self._state = JointState(name=list(UR5.joints))
        self._states = here.driver.create_publisher(JointState, f"{ECHO}/joint_states", 10)
        topic = f"{ECHO}/joint_reference"
        here.driver.create_subscription(JointState, topic, self._on_command, 10)

    def _on_command(self, msg: JointState) -> None:
        if self._lockstep and msg.header.stamp == self._state.header.stamp:
            self.turn()

    def turn(self) -> None:
        """Make a step and publish what is measured."""
        self._state.position, self._state.velocity, _ = self._step()
        self.steps += 1
        stamp = self._state.header.stamp
        stamp.sec, stamp.nanosec = divmod(self.steps * STEP, 10**9)
        self.show()

    def show(self) -> None:
        """Publish what was measured last."""
        self._states.publish(self._state)


def bare_lockstep(control: str, seconds: float) -> float:
    """Return the steps a second of an echo and PyBullet alone."""
    with session() as here, echo(here):
        robot = BareRobot(here, control, lockstep=True)
        while robot.steps < 100:
            robot.show()  # until it is answered
            here.spin_until(time.perf_counter() + 0.1)
        begin, first = time.perf_counter(), robot.steps
        here.spin_until(begin + seconds)
        return (robot.steps - first) / (time.perf_counter() - begin)


def own_lockstep(name: str, seconds: float) -> float:
    """Return the steps a second of a control node and the bridge, from a tenth to the end."""
    setup = CONTROLLERS[name]
    with session() as here:
        given = {"mode": "lockstep", "control": setup.control, "duration": seconds}
        here.nodes.start(BRIDGE, given)
        here.nodes.start(name, setup.nodes[0].parameters(False) | {"wait_for_subscribers": 1} | TIP)
        here.nodes.start("reference", CIRCLE)
        here.nodes.wait_for_event(BRIDGE, Event.PROGRESS, 120.0)
        begin = time.perf_counter()
        while len(here.nodes.events(BRIDGE, Event.PROGRESS)) < 10:
            here.nodes.ended(BRIDGE)
            time.sleep(0.01)
        return 900 * seconds / (time.perf_counter() - begin)


def lockstep(quick: bool) -> Iterator[Row]:
    """Yield simulations in lock-step over ROS."""
    seconds, rounds = (2.0, 1) if quick else (5.0, 2)
    for name in NODES:
        control = CONTROLLERS[name].control
        both = [(own_lockstep(name, seconds), bare_lockstep(control, 2.0)) for _ in range(rounds)]
        own, bare = np.median(both, axis=0)
        kind = "lock-step with wrench" if name in SENSING else "lock-step"
        what = f"{kind}, steps/s / bare echo and PyBullet step"
        yield Row(what, name, own / bare, f"{own:.0f} / {bare:.0f} steps/s")


def bridge(quick: bool) -> Iterator[Row]:
    """Yield the processor time of the bridge in real time, which an echo answers."""
    turns, seconds, own, bare = 4, 0.5 if quick else 1.25, 0.0, 0.0
    with session() as here, echo(here, namespace="bridge"), echo(here):
        here.nodes.start(BRIDGE, {}, "/bridge")
        here.nodes.wait_for_event(BRIDGE, Event.COMMANDED, 30.0)
        robot, pid = BareRobot(here, POSITION, lockstep=False), here.nodes.processes[BRIDGE].pid
        for _ in range(turns):
            cpu = cpu_time(pid)
            time.sleep(seconds)
            own += cpu_time(pid) - cpu
            begin, cpu = time.perf_counter(), time.process_time()
            for k in range(round(seconds / PERIOD)):
                here.spin_until(begin + k * PERIOD)
                robot.turn()
            bare += time.process_time() - cpu
    what, steps = "bridge in real time, processor time / bare PyBullet step and echo", robot.steps
    yield Row.of_times(what, "", own / steps, bare / steps)


def soak(minutes: float) -> Iterator[Row]:
    """Yield all controllers at 1 kHz together, with one bridge, along a circle that clik leads."""
    shared = ("joint_states", "wrench", "robot_description", "reference", "joint_reference")
    period = max(4.0, 60 * minutes / 6)
    with session() as here:
        for name in NODES:
            here.nodes.start(name, TIP, f"/{name}", {topic: f"/{topic}" for topic in shared})
        topics = {name: f"/{name}/{topic}" for name, topic in NODES.items()}
        topics["clik"] = "/joint_reference"
        pids = {name: here.nodes.processes[name].pid for name in NODES}
        answers = {name: Answers(here, name, pids[name], topics[name]) for name in NODES}

        def on_state(data: bytes, info: Mapping[str, Any]) -> None:
            for each in answers.values():
                each.expect(data[4:12], info["source_timestamp"])

        hear = with_info(on_state)
        here.driver.create_subscription(JointState, "/joint_states", hear, 1000, raw=True)
        here.nodes.start(BRIDGE, {})
        slow = {"circle_period": period, "circle_ramp": period / 6}
        here.nodes.start("reference", CIRCLE | slow | {"wait_for_subscribers": len(NODES)})
        here.nodes.wait_for_event("reference", Event.SENT, 120.0)
        here.spin_until(time.perf_counter() + 5.0)
        for each in answers.values():
            each.clear()
        here.spin_until(time.perf_counter() + 60 * minutes)
        here.nodes.check()
    for name, each in answers.items():
        count, p = len(each.times), f"p50 {each.p(50):.0f} us, p99 {each.p(99):.0f} us"
        what = "all controllers and a bridge at 1 kHz together: answered / sent"
        figure = f"{count} of {each.sent}, {p}, {each}"
        yield Row(what, f"{name}, {minutes:g} min", count / each.sent, figure)
