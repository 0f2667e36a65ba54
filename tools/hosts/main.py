"""A robot on one host, its controller and a stream of set-points on the other.

Then the link is cut and mended, loses packets, is slow; and what both did is judged.
"""

import argparse
import json
import os
import sys
import time
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

import network
from phases import Judge, Phase, Verdict, heard
from rich.console import Console
from rich.table import Table

from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import EulerParamsError, SimulationError
from eulerparams_control.events import Event
from eulerparams_control.lab.run.processes import Nodes

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
CONTROLLER, STREAM, BRIDGE, RECORDER = "clik", "stream", "pybullet_bridge", "bag_recorder"
RATE = 250.0  # [Hz] of joint_states
START = 60.0  # [s] until the arm follows: a guard against hanging
CALM, CUT, MENDED, BAD, GOOD = 3.0, 2.0, 6.0, 5.0, 6.0  # [s] of each phase
LOSS, DELAY, JITTER = 0.1, 0.02, 0.005


class Run:
    """The processes on both hosts, and what is done to the link between them."""

    def __init__(self, net: network.Network, out: Path, stack: ExitStack) -> None:
        self._net, self._out = net, out
        hosts = (net.robot, net.controller)
        self._robot, self._controller = (stack.enter_context(self._nodes(host)) for host in hosts)

    def _nodes(self, host: network.Host) -> Nodes:
        nodes = Nodes(self._out / host.name, prefix=host.command([]))
        paths = (os.environ.get("PYTHONPATH", ""), str(ROOT), str(HERE))
        nodes.environment |= {
            "ROS_DOMAIN_ID": "0",  # nobody else is in this network
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
            "ROS_LOG_DIR": str(self._out / "ros"),
            "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        }
        return nodes

    def start(self) -> None:
        """Start robot, controller, stream and recorders; return when the stream is followed."""
        self._robot.start(BRIDGE, {"rate": RATE})
        self._controller.start(CONTROLLER, {"base_frame": "base_link"})
        self._controller.start(STREAM, {})
        moving = ["joint_states", "joint_reference"]
        for nodes, host, topics in (
            (self._robot, self._net.robot, [*moving, "/diagnostics"]),
            (self._controller, self._net.controller, ["/diagnostics"]),
        ):
            nodes.start(RECORDER, {"output": str(bag_of(self._out, host)), "topics": topics})
        for nodes in (self._robot, self._controller):
            nodes.wait_for_event(RECORDER, Event.READY, START)
        deadline = time.monotonic() + START
        while not self._follows():
            if time.monotonic() > deadline:
                raise SimulationError(f"no set-point is followed for {START:g} s: see {self._out}")
            time.sleep(0.1)

    def _follows(self) -> bool:
        self.check()
        modes = self._controller.events(CONTROLLER, Event.MODE)
        return bool(modes) and (modes[-1]["mode"], modes[-1]["cause"]) == (Mode.FOLLOWING, "")

    def check(self) -> None:
        """Raise SimulationError if a process has ended."""
        self._robot.check()
        self._controller.check()

    def calm(self) -> Phase:
        """Do nothing."""
        begin = time.time()
        time.sleep(CALM)
        return Phase("calm", begin, time.time(), time.time())

    def cut(self) -> Phase:
        """Cut the link, and mend it."""
        begin = time.time()
        self._net.cut()
        time.sleep(begin + CUT - time.time())
        end = time.time()
        self._net.restore()
        time.sleep(MENDED)
        return Phase("cut", begin, end, time.time())

    def impair(self, name: str, **how: float) -> Phase:
        """Make the link bad, and good again."""
        assert self._net.link is not None
        begin = time.time()
        self._net.link.impair(**how)
        time.sleep(BAD)
        end = time.time()
        self._net.link.impair()
        time.sleep(GOOD)
        return Phase(name, begin, end, time.time())


def bag_of(out: Path, host: network.Host) -> Path:
    """Return the bag of what is heard on a host."""
    return out / host.name / "bag"


def run(out: Path) -> dict[str, object]:
    """Run all phases; return what came of them. Raises NoHosts, SimulationError."""
    with ExitStack() as stack:
        net = stack.enter_context(network.Network())
        assert net.link is not None
        going = Run(net, out, stack)
        going.start()
        phases = [
            going.calm(),
            going.cut(),
            going.impair("loss", loss=LOSS),
            going.impair("delay", delay=DELAY, jitter=JITTER),
        ]
        going.check()
    judge = Judge(*(heard(bag_of(out, host)) for host in (net.robot, net.controller)), CONTROLLER)
    _, cut, *impaired = phases
    verdicts = [*judge.cut(cut), *(v for phase in impaired for v in judge.impaired(phase))]
    return {
        "link": net.link.kind,
        "met": all(verdict.met for verdict in verdicts),
        "criteria": [asdict(verdict) for verdict in verdicts],
        "phases": {phase.name: judge.numbers(phase) for phase in phases},
    }


def show(console: Console, result: dict[str, object], verdicts: list[Verdict]) -> None:
    """Print the report."""
    phases = result["phases"]
    assert isinstance(phases, dict)
    table = Table(title=f"Two hosts, joined by {result['link']}")
    table.add_column("figure")
    for name in phases:
        table.add_column(name, justify="right")
    for figure in next(iter(phases.values())):
        table.add_row(figure, *(f"{numbers[figure]:.4g}" for numbers in phases.values()))
    console.print(table)
    table = Table(title="What must hold")
    for name in ("link", "what", "measured", "bound", ""):
        table.add_column(name)
    for v in verdicts:
        mark = "[green]met[/]" if v.met else "[red]not met[/]"
        table.add_row(v.phase, v.text, v.measured, v.bound, mark)
    console.print(table)


def main() -> int:
    """Return 0 if all holds, 1 if something does not, 2 if there cannot be two hosts."""
    parser = argparse.ArgumentParser(
        prog="two_hosts",
        description="A robot and its controller on two hosts (network namespaces of this machine; "
        f"takes root): the link is cut for {CUT:g} s, then loses {LOSS:.0%} of the packets, then "
        f"delays them by {1e3 * DELAY:g} ms, {1e3 * JITTER:g} ms more or less.",
        epilog="Ends with 1 if something that must hold does not, with 2 if it cannot be tried.",
    )
    parser.add_argument("--out", type=Path, default=Path("out/two_hosts"), help="folder of results")
    out = parser.parse_args().out.resolve()
    console = Console() if sys.stdout.isatty() else Console(width=120)
    try:
        result = run(out)
    except (network.NoHosts, EulerParamsError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    (out / "summary.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    criteria = result["criteria"]
    assert isinstance(criteria, list)
    show(console, result, [Verdict(**one) for one in criteria])
    return 0 if result["met"] else 1


if __name__ == "__main__":
    sys.exit(main())
