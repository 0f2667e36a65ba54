"""Phases of the link between two hosts: the messages heard, and the conditions on them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from eulerparams_control.bags.reader import Bag
from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.messages.keys import CAUSE, MODE
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

BRIDGE = "pybullet_bridge"
OBEYING, BRAKED, SILENCE = "obeying", ("braked", "stopping", "contested"), "silence"
"""Modes of the robot and a cause: of ``sim_bridge.drive``, which would load PyBullet."""

MOVES, STANDS = 1e-3, 1e-5
"""Fastest joint, of its limit: above the first the arm moves, below the second it is at rest."""

FULL_SPEED = 1.001
"""Speed of a joint by its limit, which commands may ask for: the servo leaves 1e-4."""

COMMAND_TIMEOUT = STATE_TIMEOUT = 0.1
"""[s] of the robot and of the controller: their defaults."""

SCHEDULING = 0.15
"""[s] that a tick, a watch of 20 Hz and a busy machine may add to a timeout."""

LONG = 0.5
"""[s] of a gap of commands that is judged."""

RECOVERS = 5.0
"""[s] within which the motion is to resume: the middleware asks for what was lost every 3 s."""

_ERROR = 2  # level of a status
_LATE = "joint_states rejected"  # a counter of the controller


@dataclass(frozen=True)
class Verdict:
    """One thing that must hold: what was measured, its bound, whether it is met."""

    phase: str
    text: str
    measured: str
    bound: str
    met: bool


@dataclass(frozen=True)
class Heard:
    """Messages heard on a host, each with the time t [s] of its publication, of a command receipt.

    {"t": ..., "speed": ..., "stamp": ...}     joint_states: the fastest joint, of its limit
    {"t": ..., "command": ...}                 a command: its stamp [s]
    {"t": ..., "who": ..., "says": ..., "level": ..., "values": {...}}   a status of /diagnostics
    """

    lines: Sequence[dict[str, Any]]

    def between(self, begin: float, end: float, key: str) -> list[dict[str, Any]]:
        """Return the lines that have a key, from ``begin`` to ``end`` [s]."""
        return [line for line in self.lines if key in line and begin <= line["t"] < end]

    def first(
        self, begin: float, end: float, key: str, holds: Callable[[dict[str, Any]], bool]
    ) -> float | None:
        """Return how long [s] after ``begin`` something was heard first; None if it was not."""
        found = (line["t"] for line in self.between(begin, end, key) if holds(line))
        return next((t - begin for t in found), None)


def heard(path: Path) -> Heard:
    """Return the messages of a bag; raises BagError."""
    arm = load_robot("ur5")
    limits = Robot(arm.urdf, arm.base_frame, arm.tip_frame).limits.velocity
    lines: list[dict[str, Any]] = []
    for topic, received, sent, msg in Bag(path).messages():
        if topic == "/joint_states":
            fastest = np.abs(np.array(msg.velocity[: len(limits)]) / limits).max()
            stamp = ns_from_ros(msg.header.stamp) / 1e9
            lines.append({"t": sent / 1e9, "speed": float(fastest), "stamp": stamp})
        elif topic == "/joint_reference":
            lines.append({"t": received / 1e9, "command": ns_from_ros(msg.header.stamp) / 1e9})
        elif topic == "/diagnostics":
            for status in msg.status:
                values = {pair.key: pair.value for pair in status.values}
                told = {"who": status.name, "says": status.message, "values": values}
                lines.append({"t": sent / 1e9, "level": int(status.level), **told})
    return Heard(sorted(lines, key=lambda line: line["t"]))


def says(
    who: str, mode: str | None = None, cause: str | None = None
) -> Callable[[dict[str, Any]], bool]:
    """Return whether a line is a status of a node, in a mode, for a cause; None is any."""
    return lambda line: (
        line["who"] == who
        and all(
            wanted in (None, line["values"].get(key))
            for key, wanted in ((MODE, mode), (CAUSE, cause))
        )
    )


def is_braked(line: dict[str, Any]) -> bool:
    """Return whether a line is a status of the robot while it is braked."""
    return line["who"] == BRIDGE and line["values"].get(MODE) in BRAKED


@dataclass(frozen=True)
class Phase:
    """Something that was done to the link, from ``begin`` to ``end`` [s]; judged to ``judged``."""

    name: str
    begin: float
    end: float
    judged: float

    def within(self, text: str, after: float | None, bound: float) -> Verdict:
        """Return the verdict on what has to happen after a time [s] at most; None: never."""
        measured = "never" if after is None else f"after {after:.3f} s"
        met = after is not None and after <= bound
        return Verdict(self.name, text, measured, f"within {bound:.2f} s", met)

    def fastest(self, text: str, lines: Sequence[dict[str, Any]], bound: float) -> Verdict:
        """Return the verdict on the fastest joint in joint_states, of its limit; none are bad."""
        value = max((line["speed"] for line in lines), default=bound + 1)
        measured = f"{value:.2g} (fastest joint, of its limit)"
        return Verdict(self.name, text, measured, f"< {bound:g}", value < bound)


class Judge:
    """Judges what was heard on both hosts.

    Args:
        robot, controller: what was heard there.
        name: of the controller's node.
    """

    def __init__(self, robot: Heard, controller: Heard, name: str) -> None:
        self._robot, self._controller, self._name = robot, controller, name

    def cut(self, phase: Phase) -> Iterator[Verdict]:
        """Judge the link that was cut: the robot brakes, both say why, the motion resumes."""
        robot, begin, end, within = self._robot, phase.begin, phase.end, phase.within
        brakes = robot.first(begin, end, "who", says(BRIDGE, cause=SILENCE))
        yield within("the robot says that it brakes", brakes, COMMAND_TIMEOUT + SCHEDULING)
        at_rest = robot.first(begin, end, "speed", lambda line: line["speed"] < STANDS)
        rest = COMMAND_TIMEOUT + 2 * SCHEDULING
        yield within("all its joints are at rest", at_rest, rest)
        told = self._controller.first(begin, end, "who", says(self._name, cause=Cause.NO_STATES))
        yield within("the controller says why", told, STATE_TIMEOUT + SCHEDULING)
        said = self._controller.between(begin + (told or 0.0), end, "who")
        better = [s["says"] for s in said if s["who"] == self._name and s["level"] < _ERROR]
        text, met = "and says nothing better meanwhile", told is not None and not better
        measured = f"{len(better)} times" + (f": {better[0]}" if better else "")
        yield Verdict(phase.name, text, measured, "0 times", met)
        late = robot.between(begin + rest, end, "speed")
        yield phase.fastest("and stay there", late, STANDS)
        yield from self._resumes(phase)

    def _resumes(self, phase: Phase) -> Iterator[Verdict]:
        robot, end, judged = self._robot, phase.end, phase.judged
        obeys = robot.first(end, judged, "who", says(BRIDGE, OBEYING))
        yield phase.within("restored: the robot obeys again", obeys, RECOVERS)
        back = end + (obeys or 0.0)
        heard = self._controller.first(back, judged, "who", says(self._name, Mode.FOLLOWING, ""))
        follows = None if obeys is None or heard is None else obeys + heard
        yield phase.within("restored: the set-points are followed again", follows, RECOVERS)
        yield phase.within("restored: the arm moves again", self._moves(phase), RECOVERS)
        yield self._fastest(phase)

    def impaired(self, phase: Phase) -> Iterator[Verdict]:
        """Judge a bad link: no joint is too fast, gaps are braked in, the motion recovers."""
        yield self._fastest(phase)
        yield self._gaps(phase)
        yield phase.within("a good link again: the arm moves", self._moves(phase), RECOVERS)

    def _moves(self, phase: Phase) -> float | None:
        """Return how long after the link was good again the arm moved."""
        end, judged = phase.end, phase.judged
        return self._robot.first(end, judged, "speed", lambda line: line["speed"] > MOVES)

    def _fastest(self, phase: Phase) -> Verdict:
        states = self._robot.between(phase.begin, phase.judged, "speed")
        return phase.fastest("no joint is faster than its limit", states, FULL_SPEED)

    def _gaps(self, phase: Phase) -> Verdict:
        """Judge that in each long gap of the commands the robot was braked.

        The listener and the robot read the same commands, but not the same retransmissions: what
        is a gap for one is shorter for the other, so only long ones are judged.
        """
        commands = self._robot.between(phase.begin, phase.judged, "command")
        times = [phase.begin, *(line["t"] for line in commands), phase.judged]
        gaps = [(a, b) for a, b in pairwise(times) if b - a > LONG]
        unbraked = [a for a, b in gaps if not self._was_braked(a, b)]
        measured = f"{len(gaps)} gaps, {len(unbraked)} without"
        text, met = f"in each gap of commands > {LONG} s it brakes", bool(commands) and not unbraked
        return Verdict(phase.name, text, measured, "none without", met)

    def _was_braked(self, begin: float, end: float) -> bool:
        """Whether the robot said that it brakes, or had said so last before."""
        said = [s for s in self._robot.between(0, end, "who") if s["who"] == BRIDGE]
        return any(map(is_braked, [*(s for s in said if s["t"] >= begin), *said[-1:]]))

    def numbers(self, phase: Phase) -> dict[str, float]:
        """Return the numbers of a phase."""
        begin, end, seconds = phase.begin, phase.end, phase.end - phase.begin
        states, answers, told = (
            self._robot.between(begin, end, key) for key in ("speed", "command", "who")
        )
        edges = [begin, *(line["t"] for line in answers), end]
        sent = {line["stamp"]: line["t"] for line in self._robot.between(0, end, "speed")}
        trips = [a["t"] - sent[a["command"]] for a in answers if a["command"] in sent]
        braked = [is_braked(line) for line in told if line["who"] == BRIDGE]
        said = self._controller.between(begin, phase.judged, "who")
        late = [int(s["values"].get(_LATE, 0)) for s in said if s["who"] == self._name]
        return {
            "seconds": seconds,
            "states_per_s": len(states) / seconds,
            "commands_per_s": len(answers) / seconds,
            "longest_gap_of_commands_s": max(b - a for a, b in pairwise(edges)),
            "round_trip_p50_ms": 1e3 * _percentile(trips, 50),
            "round_trip_p99_ms": 1e3 * _percentile(trips, 99),
            "brakes": sum(now and not before for before, now in pairwise([False, *braked])),
            "refused_as_late": late[-1] - late[0] if late else 0,
            "fastest_joint_of_limit": max((line["speed"] for line in states), default=0.0),
        }


def _percentile(values: Sequence[float], percent: float) -> float:
    return float(np.percentile(values, percent, method="lower")) if values else float("nan")
