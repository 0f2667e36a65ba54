"""Controlled simulation beside real time at 1 kHz, and analysis of a bag beside mcap alone."""

import argparse
import subprocess
import sys
import tempfile
import time
from collections import deque
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from node import PERIOD, UR5, session
from tick import STEP, controller_of

from eulerparams_control.events import Event
from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.parameters.schemes import SchemeInfo, schemes
from eulerparams_control.robot.robot import Robot
from sim_bridge.simulator import Simulator, SimulatorParameters

BRIDGE, TIP = "pybullet_bridge", {"tip_frame": UR5.tip_frame}
CIRCLE = {"motion": "circle", "circle_normal": [1.0, 0.0, 0.0], "circle_turns": 8.0, **TIP}


def in_one_process(info: SchemeInfo, steps: int) -> float:
    """Return the steps a second of a simulated arm that goes along a circle."""
    model, home = Robot(UR5.urdf, UR5.base_frame, UR5.tip_frame), np.array(UR5.home)
    simulator = Simulator(UR5, SimulatorParameters(control=info.control))
    controller, placement = controller_of(info, model, home), model.placement(UR5.sensor_frame)
    begin = time.perf_counter()
    for k in range(1, steps + 1):
        state = simulator.read()
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
    return steps / (time.perf_counter() - begin)


def in_lockstep(name: str, seconds: float) -> float:
    """Return the steps a second of a control node and the bridge, from a tenth to the end."""
    setup = CONTROLLERS[name]
    with session() as here:
        bridge = {"mode": "lockstep", "control": setup.control, "duration": seconds}
        here.nodes.start(BRIDGE, bridge)
        here.nodes.start(name, setup.nodes[0].parameters(False) | {"wait_for_subscribers": 1} | TIP)
        here.nodes.start("reference", CIRCLE)
        here.nodes.wait_for_event(BRIDGE, Event.PROGRESS, 180.0)
        begin = time.perf_counter()
        while len(here.nodes.events(BRIDGE, Event.PROGRESS)) < 10:
            here.nodes.ended(BRIDGE)
            time.sleep(0.01)
        return 0.9 * seconds / PERIOD / (time.perf_counter() - begin)


def analyze(bag: Path) -> tuple[float, float]:
    """Return the MB/s of ``analyze`` as a process, and of reading the bag with mcap alone."""
    size = sum(file.stat().st_size for file in bag.glob("*.mcap")) / 1e6
    begin = time.perf_counter()
    for file in bag.glob("*.mcap"):
        with open(file, "rb") as stream:
            deque(make_reader(stream).iter_messages(), maxlen=0)
    read = time.perf_counter() - begin
    command = [sys.executable, "-m", "eulerparams_control.analysis.main", str(bag)]
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        subprocess.run(
            [*command, "--out", f"{folder}/page.html"], stdout=subprocess.DEVNULL, check=True
        )
        return size / (time.perf_counter() - begin), size / read


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=5, help="simulated, of each controller")
    parser.add_argument("--bag", type=Path, help="instead: analyse this bag, beside mcap alone")
    options = parser.parse_args()
    if options.bag:
        rate, alone = analyze(options.bag)
        print(f"analyze {rate:.1f} MB/s, mcap alone {alone:.1f} MB/s, ratio {rate / alone:.2f}")
        return
    steps, real = round(options.seconds / PERIOD), 1 / PERIOD
    print(f"{'simulation':32} steps/s   by real time")
    for name, info in schemes().items():
        found = in_one_process(info, steps), in_lockstep(name, options.seconds)
        for how, rate in zip(("in one process", "over DDS, in lock-step"), found, strict=True):
            print(f"{name + ' ' + how:40} {rate:6.0f} {rate / real:8.2f}")


if __name__ == "__main__":
    main()
