"""All that was seen in a soak."""

import math
import os
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eulerparams_control.lab.soak.ledger import Histogram, Missed
from eulerparams_control.parameters.schemes import TORQUE, schemes
from eulerparams_control.robot.catalogue import RobotDescription

CONTROLLERS = tuple(schemes())

_WARM_UP = 60.0  # [s] at most, a quarter of the rest at most
_QUARTERS, _PAGE = 4, 60.0

# A reference of more turns, of 60 points each, takes a controller longer to read than the robot
# waits for a command.
_TURNS, _LEAST_PERIOD, _RAMPS = 10, 8.0, 6

# With two processes in the loop at a few hundred Hz the arm bears these gains.
_GAINS = {"k_Pp": 400.0, "k_Vp": 40.0, "k_Po": 800.0, "k_Vo": 40.0}

_STATE_RATE = 5.0  # [Hz] of what is recorded

_TICK = os.sysconf("SC_CLK_TCK")
_PRIVATE = ("Private_Clean:", "Private_Dirty:")


@dataclass(frozen=True)
class SoakPlan:
    """A soak.

    Attributes:
        controllers: that run at the same time, each with a robot of its own.
        seconds: [s] that count, after the warm-up.
        rate: [Hz] of joint_states.
    """

    controllers: tuple[str, ...] = CONTROLLERS
    seconds: float = 1200.0
    rate: float = 250.0

    @property
    def warm_up(self) -> float:
        """[s] before anything counts: what is loaded, filled and discovered once."""
        return min(_WARM_UP, self.seconds / _QUARTERS)

    @property
    def pages(self) -> int:
        """Into how many parts the time is divided: a minute at most, the same in each quarter."""
        return _QUARTERS * math.ceil(self.seconds / (_QUARTERS * _PAGE))

    @property
    def page(self) -> float:
        """[s] of a part."""
        return self.seconds / self.pages

    def bridge(self, controller: str) -> dict[str, Any]:
        """Return the parameters of the robot of a controller."""
        return {"mode": "realtime", "control": schemes()[controller].control, "rate": self.rate}

    def control(self, controller: str, robot: RobotDescription) -> dict[str, Any]:
        """Return the parameters of a controller."""
        gains = _GAINS if schemes()[controller].control == TORQUE else {}
        frames = {"base_frame": robot.base_frame, "tip_frame": robot.tip_frame}
        return frames | gains | {"state_rate": _STATE_RATE}

    def reference(self, robot: RobotDescription) -> dict[str, Any]:
        """Return the parameters of a slow circle that outlasts the soak."""
        whole = 2 * (self.warm_up + self.seconds)
        period = max(_LEAST_PERIOD, whole / _TURNS)
        return {
            "base_frame": robot.base_frame,
            "tip_frame": robot.tip_frame,
            "motion": "circle",
            "circle_radius": 0.05,
            "circle_normal": [1.0, 0.0, 0.0],
            "circle_tilt": 0.3,
            "circle_period": period,
            "circle_turns": float(math.ceil(whole / period)),
            "circle_ramp": period / _RAMPS,
        }

    def topics(self) -> list[str]:
        """Return what is recorded: little, so that the bag stays small."""
        own = [f"/{c}/{c}/{name}" for c in self.controllers for name in ("pose", "error")]
        return ["/diagnostics", *own]


@dataclass(frozen=True)
class Usage:
    """What a process has taken so far.

    Attributes:
        rss: [MiB] of memory that it has mapped and touched, shared or not.
        uss: [MiB] of that, what is its own.
        cpu: [s] of processor.
    """

    rss: float
    uss: float
    cpu: float


def usage_of(pid: int) -> Usage:
    """Return what a process has taken; raises OSError if it has ended."""
    process = Path("/proc", str(pid))
    sizes = [line.split() for line in (process / "smaps_rollup").read_text().splitlines()[1:]]
    rss = sum(int(size[1]) for size in sizes if size[0] == "Rss:")
    uss = sum(int(size[1]) for size in sizes if size[0] in _PRIVATE)
    # behind the name, which may have blanks, the fields from the third one on
    fields = (process / "stat").read_text().rpartition(")")[2].split()
    return Usage(rss / 1024, uss / 1024, (int(fields[11]) + int(fields[12])) / _TICK)


def waited_of(pid: int) -> dict[int, float]:
    """Return how long [s] each thread of a process was ready, but had no processor."""
    waited = {}
    for task in Path("/proc", str(pid), "task").iterdir():
        with suppress(OSError):  # a thread that has just ended
            waited[int(task.name)] = int((task / "schedstat").read_text().split()[1]) / 1e9
    return waited


@dataclass(frozen=True)
class Page:
    """A part of the time of one robot.

    Attributes:
        begin, end: [s] since the end of the warm-up, which is negative.
        states, commands: how many.
        latencies: from state to command [s].
    """

    begin: float
    end: float
    states: int
    commands: int
    latencies: Histogram


@dataclass
class Life:
    """A process from its start to its end.

    Attributes:
        name: of the node.
        pid: of the process.
        samples: time [s] since the end of the warm-up, and what it had taken then.
    """

    name: str
    pid: int
    samples: list[tuple[float, Usage]] = field(default_factory=list)


@dataclass(frozen=True)
class Unanswered:
    """A state that was not answered, and why.

    Attributes:
        controller: that did not answer.
        missed: the state; its time since the end of the warm-up [s].
        cause: in words; "" if nothing explains it.
    """

    controller: str
    missed: Missed
    cause: str


@dataclass(frozen=True)
class SoakEvent:
    """Something that was said or done, t [s] after the end of the warm-up."""

    t: float
    who: str
    what: str


@dataclass
class SoakRecord:
    """All that was seen.

    Attributes:
        pages: by controller; the first one is the warm-up.
        lives: of all processes, also of those that were started again.
        unanswered: states after the warm-up.
        strays: commands that answer no state, by controller.
        clock_steps: how often the clock of the machine was set.
        monitor_gap: [s] longest time for which the monitor did not look.
        bag_megabytes: [MB] of what was recorded.
        death: how a node ended before its time; "" if none did.
    """

    plan: SoakPlan
    pages: dict[str, list[Page]] = field(default_factory=dict)
    lives: list[Life] = field(default_factory=list)
    unanswered: list[Unanswered] = field(default_factory=list)
    events: list[SoakEvent] = field(default_factory=list)
    strays: dict[str, int] = field(default_factory=dict)
    clock_steps: int = 0
    monitor_gap: float = 0.0
    bag_megabytes: float = 0.0
    death: str = ""

    @property
    def unexplained(self) -> list[Unanswered]:
        """States that were not answered, and nothing tells why."""
        return [one for one in self.unanswered if not one.cause]
