"""The runtime of every executable: signals, executor, exit codes, and ``--help``."""

import gc
import inspect
import shutil
import signal
import sys
import textwrap
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from typing import Any

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from eulerparams_control.errors import EulerParamsError, defect
from eulerparams_control.events import Event, ExitCode, begin, tell
from eulerparams_control.parameters.fields import allowed, default_text, fields_of

RCLError = rclpy_implementation.RCLError
UnknownROSArgsError = rclpy_implementation.UnknownROSArgsError

# How often [s] the loop looks whether a signal came; messages are handled at once.
_POLL_SECONDS = 0.05

# ROS reads the value of a parameter as YAML, in which ": " and " #" are no text.
_XML_AS_PARAMETER = (
    "the XML after -p {name}:= is no YAML value; expected it in a parameter file: --ros-args "
    "--params-file robot.yaml, which is made by: (printf '/**:\\n  ros__parameters:\\n    {name}: "
    "|2\\n'; sed 's/^/      /' FILE.urdf) > robot.yaml"
)

# Widest and narrowest text [characters], however wide the terminal is, and how far it is indented.
_WIDEST, _NARROWEST, _INDENT = 100, 20, 6 * " "

# For so long [s] what moves may come to rest after a signal.
_STOP_SECONDS = 3.0


def run(
    make_node: Callable[[], Node],
    args: list[str] | None = None,
    *,
    tells: bool = True,
    about: type[Any] | None = None,
) -> int:
    """Run one node until it is done or SIGINT or SIGTERM arrives; return the exit code.

    With ``--help`` it says what the node is, and its parameters, instead.  Signals are handled
    here: the handlers of rclpy end the context before a last command can be published.

    Args:
        make_node: makes the node, which may have these: ``done`` ends the loop; ``error`` is why;
            ``at_rest()`` brings what moves to rest, and is called until it returns true;
            ``close()`` sends the last safe command and finishes files.
        args: of the command line; None is those of the process.
        tells: whether its events go to stdout; not where that is for people.
        about: the class of the node; None: ``make_node`` is that.
    """
    own = sys.argv[1:] if args is None else args
    if "-h" in own or "--help" in own:
        print(usage(sys.argv[0], about or make_node))
        return ExitCode.OK
    if tells:
        begin()
    code, text = _run(make_node, own)
    if text:
        print(f"error: {text}", file=sys.stderr, flush=True)
    tell(Event.ENDED, exit_code=code, text=text)
    return code


def _run(make_node: Callable[[], Node], own: list[str]) -> tuple[ExitCode, str]:
    """Run the node; return the exit code, and what was wrong."""
    loose = takewhile(lambda arg: arg != "--ros-args", own)
    if misplaced := next((arg for arg in loose if ":=" in arg), ""):
        return ExitCode.ERROR, (
            f"'{misplaced}' does nothing without --ros-args before it: a parameter is given as "
            "--ros-args -p NAME:=VALUE, another name of a topic as --ros-args -r FROM:=TO"
        )
    try:
        rclpy.init(args=own, signal_handler_options=SignalHandlerOptions.NO)
    except (RCLError, UnknownROSArgsError) as error:  # a parameter file that is not there, say
        for name, _, value in (arg.partition(":=") for arg in own):
            if value.lstrip().startswith("<"):
                return ExitCode.ERROR, _XML_AS_PARAMETER.format(name=name)
        text = " ".join(str(error).partition(", at /")[0].split())
        expected = "expected parameters as -p NAME:=VALUE"
        return ExitCode.ERROR, f"{text}; in the folder {Path.cwd()}; {expected}"
    if unknown := remove_ros_args(own):
        return ExitCode.ERROR, (
            f"unknown argument '{unknown[0]}'; parameters are given as --ros-args -p NAME:=VALUE "
            "or --ros-args --params-file FILE, see config/ and the README"
        )
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: stopped.append(received))
    node: Node | None = None
    how = ExitCode.OK, ""
    try:
        node = make_node()
        _spin(node, stopped)
    except Exception as error:
        how = _failure(error)
    try:
        getattr(node, "close", lambda: None)()
    except Exception as error:
        how = how if how[1] else _failure(error)  # the first error is the cause
    finally:
        rclpy.try_shutdown()
    return how


def _failure(error: Exception) -> tuple[ExitCode, str]:
    if isinstance(error, EulerParamsError):
        return error.exit_code, str(error)
    return ExitCode.ERROR, f"{defect(error)}; please report it"


def _spin(node: Node, stopped: list[int]) -> None:
    executor = EventsExecutor()
    executor.add_node(node)
    gc.collect()
    gc.freeze()  # a full collection of the start-up objects would cost milliseconds
    try:
        while not stopped and not getattr(node, "done", False):
            executor.spin_once(timeout_sec=_POLL_SECONDS)
        if error := getattr(node, "error", None):
            raise error
    finally:  # what moves comes to rest, also after an error
        deadline = time.monotonic() + _STOP_SECONDS
        at_rest = getattr(node, "at_rest", lambda: True)
        while not at_rest() and time.monotonic() < deadline:
            with suppress(Exception):  # it is said already why the node ends
                executor.spin_once(timeout_sec=_POLL_SECONDS)


def usage(program: str, node: Any) -> str:
    """Return the help of a node, whose class has ``parameters_type``, for the terminal.

    Args:
        program: how it was called; its name counts.
        node: its class, in a module that says what it does.
    """
    width = max(_NARROWEST, min(shutil.get_terminal_size().columns, _WIDEST))
    about = inspect.cleandoc(inspect.getmodule(node).__doc__ or "").replace("``", "")
    lines = [
        f"usage: {Path(program).name.removesuffix('_node.py')} "
        "[--ros-args --params-file FILE] [--ros-args -p NAME:=VALUE] ...",
        *("", about, "", "Parameters, with their defaults; those with * may change while it runs:"),
    ]
    fields = fields_of(node.parameters_type)
    kinds = node.parameters_type.__mro__  # what is special comes first
    for name in dict.fromkeys(name for kind in kinds for name in inspect.get_annotations(kind)):
        if name in fields:
            meta, words = fields[name].metadata, allowed(fields[name])
            star, unit = "*" if meta["live"] else "", f" {meta['unit']}" if meta["unit"] else ""
            text = meta["description"] + (f" ({' | '.join(words)})" if words else "")
            lines += ["", f"  {name}{star}: {default_text(fields[name])}{unit}"]
            wrapped = textwrap.wrap(text, width - len(_INDENT), break_on_hyphens=False)
            lines += [_INDENT + line for line in wrapped]
    return "\n".join(lines)
