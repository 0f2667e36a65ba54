"""The command of the soak: ``python -m eulerparams_control.lab.soak.main``, or ``make soak``."""

import argparse
import signal
import sys
from pathlib import Path

from rich.console import Console

from eulerparams_control.command_line import make_console, say
from eulerparams_control.errors import ConfigurationError, EulerParamsError
from eulerparams_control.lab.experiments.processes import RunStopped
from eulerparams_control.lab.soak.page import write_page
from eulerparams_control.lab.soak.record import CONTROLLERS, SoakPlan, SoakRecord
from eulerparams_control.lab.soak.summary import sentence, tables, write_summary
from eulerparams_control.lab.soak.verdict import judge

_MINUTES = 20.0
_LEAST_SECONDS = 25.0  # enough samples of memory at both ends
_EVERY = 60.0  # [s] between two lines of progress


def main(args: list[str] | None = None) -> int:
    """Run ``[--minutes M | --seconds S] [--controller C] [--rate HZ] [--out DIR]``.

    Returns:
        the exit code: 0 if all criteria are met, 1 if one is not, 2 after an error, 130 after an
        interrupt.
    """
    options = _parse(args)
    console = make_console()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the nodes, as Ctrl-C does
    try:
        record = _soak(_plan(options), options.out, console)
        return _report(record, options.out, console)
    except EulerParamsError as error:
        say(console, f"error: {error}", "red")
        return 2
    except (KeyboardInterrupt, RunStopped):
        say(console, "stopped; nothing was written", "red")
        return 130


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="soak",
        description="All nodes in real time, as processes, for long: does memory grow, does the "
        "round trip get slower, does a command go missing that nothing explains?",
        epilog="Ends with 1 if something that must hold does not.",
    )
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--minutes", type=float, default=_MINUTES, help="default %(default)g")
    length.add_argument("--seconds", type=float, help="instead of minutes")
    parser.add_argument("--controller", choices=CONTROLLERS, help="only this one")
    parser.add_argument("--rate", type=float, default=250.0, help="[Hz] of joint_states")
    parser.add_argument("--out", type=Path, default=Path("out/soak"), help="folder of the results")
    return parser.parse_args(args)


def _plan(options: argparse.Namespace) -> SoakPlan:
    """Return the plan of the options; raises ConfigurationError."""
    seconds = 60 * options.minutes if options.seconds is None else options.seconds
    if not _LEAST_SECONDS <= seconds <= 1e6:
        raise ConfigurationError(f"a soak of {seconds:g} s; expected {_LEAST_SECONDS:g} s to 1e6 s")
    if not 100 <= options.rate <= 1000:  # the servo of the robot needs as much
        raise ConfigurationError(f"--rate {options.rate:g}; expected 100 to 1000 Hz")
    controllers = (options.controller,) if options.controller else CONTROLLERS
    return SoakPlan(controllers, seconds, options.rate)


def _soak(plan: SoakPlan, out: Path, console: Console) -> SoakRecord:
    """Run it, with a line of progress a minute."""
    from eulerparams_control.lab.soak.ros.monitor import run_soak  # only here it takes ROS

    said = -plan.warm_up - _EVERY

    def progress(record: SoakRecord, t: float) -> None:
        nonlocal said
        if t - said >= _EVERY:
            said = t
            missing = len(record.unanswered)
            done = f"{t:.0f} of {plan.seconds:g} s" if t >= 0 else "warming up"
            say(console, f"{done}, {missing} states without a command")

    folder = out / "nodes"
    if folder.exists():
        raise ConfigurationError(f"{folder} exists; remove it, or choose another --out")
    return run_soak(plan, folder, progress)


def _report(record: SoakRecord, out: Path, console: Console) -> int:
    verdicts = judge(record)
    try:
        write_summary(out / "summary.json", record, verdicts)
        write_page(out / "index.html", record, verdicts)
    except OSError as error:
        raise ConfigurationError(f"cannot write to {out}: {error}") from error
    console.print(tables(record, verdicts))
    met = all(verdict.met for verdict in verdicts)
    say(console, sentence(record, verdicts), "bold" if met else "bold red")
    say(console, f"The page: {(out / 'index.html').resolve()}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
