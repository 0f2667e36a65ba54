"""Hooks of mkdocs that generate tables from the code: parameters, options and causes.

A page has ``<!-- parameters: clik -->`` where the table is to be; see :data:`GENERATORS`.  Links
to files outside ``docs`` lead to copies of them.
"""

import contextlib
import io
import re
from collections.abc import Iterator
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any

from eulerparams_control.bags.ros.recorder_node import RecorderParameters
from eulerparams_control.command_line import executables
from eulerparams_control.control import clock, mode
from eulerparams_control.control.mode import Cause, Why
from eulerparams_control.errors import (
    ContactError,
    FollowingError,
    LoadError,
    OverloadError,
    SingularityError,
    UnsafeCommandError,
)
from eulerparams_control.lab.fault_injector_node import InjectorParameters
from eulerparams_control.laws.scheme import LoopGain
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.parameters.efforts import EffortParameters
from eulerparams_control.parameters.fields import allowed, default_text
from eulerparams_control.parameters.reference import ReferenceParameters
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.parameters.teleop import TeleopParameters
from eulerparams_control.parameters.watchdog import WatchdogParameters
from eulerparams_control.resources import config_names
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.ros import target_wrench, watchdog_node, wrench_input
from eulerparams_control.ros.publishers import qos_remedy
from eulerparams_control.tool.parameters import IdentifyToolParameters
from sim_bridge.bridge_parameters import BridgeParameters
from sim_bridge.drive_modes import DriveCause, DriveMode, DriveStatus
from sim_bridge.drive_words import DriveWords

ROOT = Path(__file__).resolve().parents[1]
COPIED = "NOTATION.md", "CHANGELOG.md", "config/**/*.yaml", "launch/*.py", "examples/*.py"
MARK = re.compile(r"<!-- (\w+)(?:: ([\w.]+))? -->")

OUTSIDE = re.compile(r"\[([^]]*)\]\(\.\./([^)#]*)(#[^)]*)?\)")

PARAMETERS: dict[str, type[Any]] = {name: scheme.parameters for name, scheme in schemes().items()}
PARAMETERS |= {
    "all_controllers": ControlParameters,
    "all_efforts": EffortParameters,
    "pybullet_bridge": BridgeParameters,
    "reference": ReferenceParameters,
    "teleop": TeleopParameters,
    "watchdog": WatchdogParameters,
    "identify_tool": IdentifyToolParameters,
    "bag_recorder": RecorderParameters,
    "fault_injector": InjectorParameters,
}


TOOLS = "analyze", "experiment", "live"


def table(head: str, rows: Iterator[tuple[str, ...]]) -> str:
    """Return a table in Markdown, with the words of its head and its rows of cells."""
    words = head.split(", ")
    lines = [words, ["---"] * len(words), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def parameter_table(name: str) -> str:
    """Return the parameters of a node, without those of the table of what it shares."""
    own = PARAMETERS[name]
    shared = {field.name: field for kind in (ControlParameters, EffortParameters)
              if issubclass(own, kind) and own is not kind for field in fields(kind)}  # fmt: skip

    def rows() -> Iterator[tuple[str, ...]]:
        for field in fields(own):
            meta, twin = field.metadata, shared.get(field.name)
            if twin is not None and (twin.default, twin.metadata) == (field.default, meta):
                continue
            among = ", ".join(f"`{one}`" if meta["choices"] else one for one in allowed(field))
            live = "yes" if meta["live"] else ""
            text = meta["description"].replace("|", "\\|")
            yield f"`{field.name}`", f"`{default_text(field)}`", meta["unit"], among, live, text

    return table("parameter, default, unit, allowed, live, what it is", rows())


def options(name: str) -> str:
    """Return what an executable says of its options."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        import_module(executables()[name]).main(["--help"])
    return f"```text\n{said.getvalue().strip()}\n```"


def robots(_: str) -> str:
    """Return the robots that are known by name."""
    found = [(name, load_robot(name)) for name in config_names("robots")]
    return table("robot, joints, base_frame, tip_frame, sensor_frame", (
        (f"`{name}`", str(len(robot.joints)), *(f"`{frame}`" for frame in
         (robot.base_frame, robot.tip_frame, robot.sensor_frame)))
        for name, robot in found
    ))  # fmt: skip


def remedies() -> dict[str, str]:
    """Return what a controller says is to be done about each cause, with numbers as examples."""
    gain = LoopGain("k_Pp", 100.0, 100.0)
    whys = [found for found in vars(mode).values() if isinstance(found, Why)]
    whys += [
        mode.stuck(""),
        mode.waiting(""),
        mode.contested("a, b"),
        clock.too_slow(0.02, gain, is_held=True),
        *map(mode.why_of, (SingularityError(), FollowingError(), ContactError())),
        *map(mode.why_of, (LoadError(), OverloadError(), UnsafeCommandError())),
        Why(Cause.DEFECT, remedy=mode.REPORT_IT),
        wrench_input.lost(""),
        wrench_input.STUCK,
        wrench_input.too_rare(0.125, 0.1),
        Why(Cause.INCOMPATIBLE_QOS, remedy=qos_remedy("/clik", "/joint_states", "reliability")),
        target_wrench.AT_ITS_END,
    ]
    return {why.cause.value: why.remedy for why in whys if why.cause is not Cause.NONE}


def remedy(cause: str) -> str:
    """Return the remedy of a cause, as the controller words it."""
    return f"`remedy`: *{remedies()[cause]}*"


def drive_remedy(cause: str) -> str:
    """Return what the simulated robot says and advises for a cause."""
    words = DriveWords("waiting for the first command", "joint_reference", 0.1)
    modes = {DriveCause.CLIPPED: DriveMode.OBEYING, DriveCause.SILENCE: DriveMode.BRAKED,
             DriveCause.PROTECTIVE_STOP: DriveMode.STOPPING, DriveCause.CONTESTED:
             DriveMode.CONTESTED, DriveCause.ACCELERATION: DriveMode.STOPPING}  # fmt: skip
    kind = DriveCause(cause)
    status = DriveStatus(modes.get(kind, DriveMode.OBEYING), kind, names=("a", "b"))
    said = words.describe(status)[2] or "see what the controller sends"
    return f"`remedy`: *{said}*"


def watch_words(_: str) -> str:
    """Return what the watchdog says in each mode."""
    rows = ((f"`{name}`", *words) for name, words in watchdog_node.SAYS.items())
    return table("mode, what it does, remedy", rows)


GENERATORS = {
    "parameters": parameter_table,
    "options": options,
    "robots": robots,
    "remedy": remedy,
    "drive_remedy": drive_remedy,
    "watch_words": watch_words,
}
"""What stands for a comment of this name, given the word after its colon."""


def on_files(files: Any, config: Any) -> Any:
    """Add the files that pages link to."""
    from mkdocs.structure.files import File

    for path in (path for pattern in COPIED for path in sorted(ROOT.glob(pattern))):
        name = path.relative_to(ROOT).as_posix()
        files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Return a page with what is generated, and with its links to copies; folders have none."""
    markdown = MARK.sub(lambda found: GENERATORS[found[1]](found[2] or ""), markdown)
    markdown = markdown.replace("](docs/", "](")  # of a copy
    return OUTSIDE.sub(lambda found: found[1] if (ROOT / found[2]).is_dir() else
                       f"[{found[1]}]({found[2]}{found[3] or ''})", markdown)  # fmt: skip
