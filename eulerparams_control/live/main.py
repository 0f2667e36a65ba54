"""The executable ``live``: a simulated robot, a controller, and the page that shows them."""

import argparse
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from eulerparams_control.command_line import whole_number
from eulerparams_control.errors import ConfigurationError, SimulationError
from eulerparams_control.lab.run.processes import Nodes
from eulerparams_control.live.page import LOCAL
from eulerparams_control.parameters.fields import fields_of
from eulerparams_control.parameters.schemes import SchemeInfo, schemes
from eulerparams_control.resources import config_folder, config_names
from eulerparams_control.robot.catalogue import RobotDescription, load_robot

_BRIDGE = "pybullet_bridge"
_DISCOVERY = 0.7  # [s] in which it is found who is there already
_EASY = {"rate": 500.0, "max_command_age": 0.005, "command_timeout": 0.5}
"""Of the robot on a computer that draws, too: time waits for the law."""

_PUSH = {"external_wrench_timeout": 0.5}  # [s] it ends when the page has gone

_PATIENT = {"use_sim_time": True, "state_timeout": 0.5}  # the same for the law

_FRICTIONLESS: dict[str, Any] = {
    "friction_viscous": [0.0],
    "friction_coulomb": [0.0],
}  # some is too stiff

_ENCODERS = {"noise_position": 1e-4, "noise_velocity": 1e-3}
"""Noise of a good encoder [rad, rad/s]: without it the tool keeps off the pole by luck."""


def main(args: list[str] | None = None) -> int:
    """Run the page, and what it shows unless it is only attached; return the exit code."""
    from eulerparams_control.live.ros.live_node import LiveNode  # the ROS layer
    from eulerparams_control.ros.runtime import run

    given = sys.argv[1:] if args is None else args
    at = given.index("--ros-args") if "--ros-args" in given else len(given)
    options, ros = _parser().parse_args(given[:at]), given[at:]
    scheme = schemes()[options.controller]
    if not options.attach:  # what is started here is for this computer
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGINT))  # no terminal
    if options.attach:
        return run(lambda: LiveNode(options.host, options.port, scheme), ros)
    robot = load_robot(options.robot)
    with (
        tempfile.TemporaryDirectory(prefix="live_") as folder,
        Nodes(Path(folder), own_domain=False) as nodes,
    ):
        start = partial(_start, nodes, robot, scheme)
        return run(lambda: LiveNode(options.host, options.port, scheme, robot, start), ros)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="live",
        description="Serve a page on which a person moves an arm: a simulated one with a "
        "controller, which are started and ended with it, or one that runs already (--attach).",
    )
    parser.add_argument(
        "--robot", default="ur5", choices=config_names("robots"), help="(default: %(default)s)"
    )
    parser.add_argument(
        "--controller", default="impedance_control", choices=list(schemes()),
        help="(default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--attach", action="store_true", help="start nothing: nodes run already")
    parser.add_argument(
        "--host", default=LOCAL,
        help="address to listen at; any but %(default)s lets others on the network move the arm",
    )  # fmt: skip
    parser.add_argument(
        "--port", type=whole_number(), default=8080, help="or the next free one; 0: any"
    )
    return parser


def _refuse(what: str, who: list[Any]) -> None:
    """Raise ConfigurationError if somebody is there who would mix with the simulation."""
    if who:
        raise ConfigurationError(
            f"{what}, by {who[0].node_name}: use live --attach, or another ROS_DOMAIN_ID"
        )


def _start(
    nodes: Nodes, robot: RobotDescription, scheme: SchemeInfo, node: Any
) -> Callable[[], str]:
    """Start robot and controller; return what tells which has ended."""
    end = time.monotonic() + _DISCOVERY
    while time.monotonic() < end:
        for topic in ("joint_states", "/clock"):
            _refuse(f"{topic} is published already", node.get_publishers_info_by_topic(topic))
        who = node.get_subscriptions_info_by_topic(scheme.command)
        _refuse(f"{scheme.command} is subscribed to already, maybe by a robot", who)
        time.sleep(0.05)
    own = {"robot": robot.name, "control": scheme.control, **_EASY, **_PUSH}
    own |= _FRICTIONLESS | _ENCODERS
    law = {"base_frame": robot.base_frame, "tip_frame": robot.tip_frame, **_PATIENT}
    if "rotor_inertia" in fields_of(scheme.parameters) and robot.rotor_inertia:
        law["rotor_inertia"] = list(robot.rotor_inertia)
    namespace = node.get_namespace()
    for name, given in ((_BRIDGE, own), (scheme.name, law)):
        file = yaml.safe_load((config_folder() / f"{name}.yaml").read_text(encoding="utf-8"))
        nodes.start(name, file["/**"]["ros__parameters"] | given, namespace)

    def ended() -> str:
        try:
            nodes.check()
        except SimulationError as error:
            return str(error)
        return ""

    return ended


if __name__ == "__main__":
    sys.exit(main())
