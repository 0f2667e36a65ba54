"""A robot on one host, its controller and a stream of set-points on the other.

Then the link is cut and restored, loses packets, is slow; and what both did is judged.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from network import Host, Network, NoHosts
from phases import BRIDGE, Judge, Phase, heard
from rich.console import Console
from rich.table import Table

from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import EulerParamsError, SimulationError
from eulerparams_control.events import Event
from eulerparams_control.lab.run.processes import Nodes

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
CONTROLLER, STREAM, RECORDER = "clik", "stream", "bag_recorder"
RATE = 250.0  # [Hz] of joint_states
START = 60.0  # [s] until the arm follows: a guard against hanging
CALM, CUT, RESTORED, BAD, GOOD = 3.0, 2.0, 6.0, 5.0, 6.0  # [s] of each phase
LOSS, DELAY, JITTER = 0.1, 0.02, 0.005


def nodes_of(host: Host, out: Path) -> Nodes:
    """Return nodes as processes on a host, with all that they need of this one."""
    nodes = Nodes(out / host.name, prefix=host.command([]))
    paths = (os.environ.get("PYTHONPATH", ""), str(ROOT), str(HERE))
    nodes.environment |= {
        "ROS_DOMAIN_ID": "0",  # nobody else is in this network
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "ROS_LOG_DIR": str(out / "ros"),
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
    }
    return nodes


def start(robot: Nodes, controller: Nodes, out: Path) -> None:
    """Start robot, controller, stream and recorders; return when the stream is followed."""
    robot.start(BRIDGE, {"rate": RATE})
    controller.start(CONTROLLER, {"base_frame": "base_link"})
    controller.start(STREAM, {})
    moving = ["joint_states", "joint_reference"]
    for nodes, name, topics in ((robot, "robot", moving), (controller, "controller", [])):
        told = {"output": str(out / name / "bag"), "topics": [*topics, "/diagnostics"]}
        nodes.start(RECORDER, told)
    for nodes in (robot, controller):
        nodes.wait_for_event(RECORDER, Event.READY, START)
    deadline = time.monotonic() + START
    while True:
        for nodes in (robot, controller):
            nodes.check()
        modes = controller.events(CONTROLLER, Event.MODE)
        if modes and (modes[-1]["mode"], modes[-1]["cause"]) == (Mode.FOLLOWING, ""):
            return
        if time.monotonic() > deadline:
            raise SimulationError(f"no set-point is followed for {START:g} s: see {out}")
        time.sleep(0.1)


def undergo(
    name: str,
    seconds: float,
    after: float = 0.0,
    spoil: Callable[[], None] = lambda: None,
    mend: Callable[[], None] = lambda: None,
) -> Phase:
    """Impair the link for a time [s], restore it, and wait for a time [s]."""
    begin = time.time()
    spoil()
    time.sleep(begin + seconds - time.time())
    end = time.time()
    mend()
    time.sleep(after)
    return Phase(name, begin, end, time.time())


def run(out: Path) -> dict[str, Any]:
    """Run all phases; return what came of them. Raises NoHosts, SimulationError."""
    with ExitStack() as stack:
        net = stack.enter_context(Network())
        hosts = (net.robot, net.controller)
        robot, controller = (stack.enter_context(nodes_of(host, out)) for host in hosts)
        start(robot, controller, out)
        slow = partial(net.impair, delay=DELAY, jitter=JITTER)
        phases = [
            undergo("calm", CALM),
            undergo("cut", CUT, RESTORED, net.cut, net.restore),
            undergo("loss", BAD, GOOD, partial(net.impair, loss=LOSS), net.impair),
            undergo("delay", BAD, GOOD, slow, net.impair),
        ]
        for nodes in (robot, controller):
            nodes.check()
    judge = Judge(*(heard(out / host.name / "bag") for host in hosts), CONTROLLER)
    _, cut, *impaired = phases
    verdicts = [*judge.cut(cut), *(v for phase in impaired for v in judge.impaired(phase))]
    return {
        "link": net.kind,
        "met": all(verdict.met for verdict in verdicts),
        "criteria": [asdict(verdict) for verdict in verdicts],
        "phases": {phase.name: judge.numbers(phase) for phase in phases},
    }


def show(console: Console, result: dict[str, Any]) -> None:
    """Print the report."""
    phases = result["phases"]
    table = Table("figure", title=f"Two hosts, joined by {result['link']}")
    for name in phases:
        table.add_column(name, justify="right")
    for figure in next(iter(phases.values())):
        table.add_row(figure, *(f"{numbers[figure]:.4g}" for numbers in phases.values()))
    console.print(table)
    table = Table("link", "what", "measured", "bound", "", title="What must hold")
    for v in result["criteria"]:
        mark = "[green]met[/]" if v["met"] else "[red]not met[/]"
        table.add_row(v["phase"], v["text"], v["measured"], v["bound"], mark)
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
    try:
        result = run(out)
    except (NoHosts, EulerParamsError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    (out / "summary.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    show(Console() if sys.stdout.isatty() else Console(width=120), result)
    return 0 if result["met"] else 1


if __name__ == "__main__":
    sys.exit(main())
