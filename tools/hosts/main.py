"""A robot on one host, its controller and a stream of set-points on the other.

Then the link is cut and mended, loses packets, is slow; and what both did is judged.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

import network
from phases import MOVES, Heard, Judge, Phase, Verdict, says
from rich.console import Console
from rich.table import Table

from eulerparams_control.control.mode import Mode

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
CONTROLLER = "clik"
RATE = 250.0  # [Hz] of joint_states
START = 60.0  # [s] until the arm moves: a guard against hanging
CALM, CUT, MENDED, BAD, GOOD = 3.0, 2.0, 6.0, 5.0, 6.0  # [s] of each phase
LOSS, DELAY, JITTER = 0.1, 0.02, 0.005


class Run:
    """The processes on both hosts, and what is done to the link between them."""

    def __init__(self, net: network.Network, out: Path, stack: ExitStack) -> None:
        self._net, self._out, self._stack = net, out, stack
        self._children: list[subprocess.Popen[bytes]] = []
        self.robot, self.controller = self._watch(net.robot), self._watch(net.controller)

    def _start(self, host: network.Host, name: str, words: list[str]) -> Path:
        """Start a process on a host; return the file of what it says."""
        path = self._out / f"{name}.log"
        environment = os.environ | {
            "ROS_DOMAIN_ID": "0",  # nobody else is in this network
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
            "ROS_LOG_DIR": str(self._out / "ros"),
            "RCUTILS_COLORIZED_OUTPUT": "0",
            "PYTHONPATH": os.pathsep.join([os.environ.get("PYTHONPATH", ""), str(ROOT)]).lstrip(
                ":"
            ),
            "PYTHONUNBUFFERED": "1",
        }
        with open(path, "wb") as log, open(path.with_suffix(".err"), "wb") as errors:
            command = host.command([sys.executable, *words])
            child = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=errors, env=environment
            )
        self._children.append(child)
        self._stack.callback(_end, child)
        return path

    def _watch(self, host: network.Host) -> Heard:
        words = [str(HERE / "watch.py"), host.name]
        return Heard(self._start(host, f"watch_{host.name}", words))

    def start(self) -> None:
        """Start robot, controller and stream; return when the arm moves."""
        node = ["--ros-args", "-p"]
        bridge = ["-m", "sim_bridge.bridge_node", *node, f"rate:={RATE}"]
        self._start(self._net.robot, "bridge", bridge)
        module = f"eulerparams_control.ros.{CONTROLLER}_node"
        self._start(
            self._net.controller, CONTROLLER, ["-m", module, *node, "base_frame:=base_link"]
        )
        self._start(self._net.controller, "stream", [str(HERE / "stream.py")])
        deadline = time.monotonic() + START
        while not self._moves():
            if time.monotonic() > deadline:
                raise network.NoHosts(f"the arm has not moved for {START:g} s: see {self._out}")
            time.sleep(0.1)

    def _moves(self) -> bool:
        self.update()
        now = time.time()
        lately = self.robot.between(now - 1.0, now, "speed")
        follows = self.controller.first(0, now, "who", says(CONTROLLER, Mode.FOLLOWING, ""))
        return follows is not None and bool(lately) and lately[-1]["speed"] > MOVES

    def update(self) -> None:
        """Read what the listeners have heard."""
        self.robot.update()
        self.controller.update()
        dead = [child.args for child in self._children if child.poll() is not None]
        if dead:
            raise network.NoHosts(f"a process has ended: {dead[0]}; see {self._out}")

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


def _end(child: subprocess.Popen[bytes]) -> None:
    child.terminate()
    try:
        child.wait(10)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def run(out: Path) -> dict[str, object]:
    """Run all phases; return what came of them. Raises NoHosts."""
    out.mkdir(parents=True, exist_ok=True)
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
        going.update()
        judge = Judge(going.robot, going.controller, CONTROLLER)
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
    except network.NoHosts as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    (out / "summary.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    criteria = result["criteria"]
    assert isinstance(criteria, list)
    show(console, result, [Verdict(**one) for one in criteria])
    return 0 if result["met"] else 1


if __name__ == "__main__":
    sys.exit(main())
