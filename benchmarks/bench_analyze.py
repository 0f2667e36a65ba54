"""Analysing a bag against reading it with mcap alone, in one run; and the memory that it takes.

    python benchmarks/bench_analyze.py [SECONDS...]

The bag is one of impedance control at 1 kHz: joint_states, wrench, compliant_frame, joint_effort,
1 MB for each second.  SECONDS are 60 and 240 for `make bench`; 3600 makes 3.7 GB.
"""

import math
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import serialize_message
from rows import Row
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from eulerparams_control.bags import BagWriter
from eulerparams_control.bags.format import Topic
from eulerparams_control.messages.to_ros import motion_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

START = 1_700_000_000_000_000_000
IMPEDANCE = {
    **{"M_p": [10.0] * 3, "D_p": [300.0] * 3, "K_p": [1000.0] * 3},
    **{"M_o": [1.0] * 3, "D_o": [20.0] * 3, "K_o": [50.0] * 3},
    "orientation": "euler_parameters",
}
_READ = """
import pathlib, sys
from mcap.reader import make_reader
for file in pathlib.Path(sys.argv[1]).glob("*.mcap"):
    with open(file, "rb") as stream:
        for _ in make_reader(stream).iter_messages():
            pass
"""
# Linux counts a process from the memory of its parent on, so that has to be a small one.
_MEASURE = """
import os, subprocess, sys, time
begin = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, usage = os.wait4(process.pid, 0)
print(time.perf_counter() - begin, usage.ru_maxrss / 1e3)
sys.exit(os.waitstatus_to_exitcode(status))
"""


class Message:
    """A serialised message whose stamp and numbers can be changed in place."""

    def __init__(self, message: Any, numbers: np.ndarray) -> None:
        self.data = bytearray(serialize_message(message))
        self._at = bytes(self.data).rindex(numbers.tobytes())  # behind the header
        self._size = numbers.nbytes

    def at(self, stamp: int, numbers: np.ndarray) -> bytes:
        self.data[4:12] = struct.pack("<iI", stamp // 10**9, stamp % 10**9)
        self.data[self._at : self._at + self._size] = numbers.tobytes()
        return bytes(self.data)


def write_bag(folder: Path, seconds: int) -> None:
    """Write a bag of an arm that moves a little, pushed, at 1 kHz."""
    ur5 = load_robot("ur5")
    robot, home = Robot(ur5.urdf, ur5.base_frame, ur5.tip_frame), np.array(ur5.home)
    state, joints = robot.state(home, np.zeros(6)), list(robot.joints)
    at_rest = Trajectory([0.0], [DesiredFrame(state.p_e, state.R_e)])
    motion = motion_to_ros(at_rest, robot.base_frame, robot.tip_frame)
    states = JointState(name=joints, position=ur5.home, velocity=[0.1] * 6)
    efforts = JointState(name=joints, effort=(20.0 * home).tolist())
    pushed = WrenchStamped()
    pushed.header.frame_id = robot.tip_frame
    still = {"/robot_description": String(data=ur5.urdf), "/reference": motion}
    moving = {  # the numbers that change: their means, and how far they swing
        "/wrench": (pushed, np.zeros(6), np.array([3.0, 2.0, 1.0, 0.3, 0.2, 0.1])),
        "/joint_states": (states, home, 0.01),
        "/compliant_frame": (motion, state.p_e, 0.01),
        "/joint_effort": (efforts, 20.0 * home, 0.0),
    }
    with BagWriter(folder) as bag:
        for name, each in {**still, **{name: each[0] for name, each in moving.items()}}.items():
            package = type(each).__module__.partition(".")[0]
            bag.add_topic(Topic(name, f"{package}/msg/{type(each).__name__}"))
        node = {"/impedance_control": {"ros__parameters": IMPEDANCE}}
        bag.attach("parameters.yaml", yaml.safe_dump(node))
        for name, each in still.items():
            bag.write(name, serialize_message(each), START, START)
        messages = {name: Message(each, mean) for name, (each, mean, _) in moving.items()}
        for k in range(1000 * seconds):
            stamp, w = START + k * 1_000_000, math.sin(5e-4 * k)
            for name, (_, mean, swing) in moving.items():
                bag.write(name, messages[name].at(stamp, mean + swing * w), stamp, stamp)


def analyze(quick: bool, *seconds: int) -> Iterator[Row]:
    """Yield the analysis of bags of so many seconds, the best of each of some rounds in turn.

    A second or so is the same for any bag: libraries, laws, the page.
    """
    _of_bag(1, 1)  # compiles what is not compiled yet
    for length in seconds or ((60,) if quick else (60, 240)):
        yield _of_bag(length, 1 if quick or length > 300 else 3)


def _of_bag(seconds: int, rounds: int) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        bag, page = Path(folder, "bag"), Path(folder, "page.html")
        write_bag(bag, seconds)
        size = sum(file.stat().st_size for file in bag.iterdir()) / 1e6
        reading = sys.executable, "-c", _READ, str(bag)
        analyzing = sys.executable, "-m", "eulerparams_control.analysis.main", str(bag)
        took = [(_took(*reading), _took(*analyzing, "--out", str(page))) for _ in range(rounds)]
    reads, pages = zip(*took, strict=True)
    read, analyzed = (size / min(t for t, _ in each) for each in (reads, pages))
    memory = max(memory for _, memory in pages)
    figure = f"{analyzed:.0f} / {read:.0f} MB/s; {memory:.0f} MB of memory"
    return Row("analyze, MB/s / mcap alone", f"{size:.0f} MB", analyzed / read, figure)


def _took(*command: str) -> tuple[float, float]:
    """Return how long [s] a command took, and how much memory [MB]."""
    measuring = sys.executable, "-c", _MEASURE, *command
    said = subprocess.run(measuring, stdout=subprocess.PIPE, text=True, check=True).stdout
    seconds, memory = map(float, said.split())
    return seconds, memory


if __name__ == "__main__":
    for row in analyze(False, *map(int, sys.argv[1:])):
        print(*row, sep=" | ")
