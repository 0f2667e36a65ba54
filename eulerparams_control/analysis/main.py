"""The executable ``analyze``: numbers and a page from bags; needs no ROS."""

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.text import Text

from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.table import terminal_tables
from eulerparams_control.errors import ConfigurationError, EulerParamsError


def main(args: list[str] | None = None) -> int:
    """Run ``analyze BAG [BAG ...] [--out FILE] [--urdf FILE] [--tip-frame NAME] [--no-page]``.

    Returns:
        the exit code: 0, or 2 after an error.
    """
    options = _parse(args)
    console = Console()
    try:
        _analyze(options, console)
    except EulerParamsError as error:
        _say(console, f"error: {error}", "red")
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="analyze", description="Numbers and a page from bags with joint_states; without ROS."
    )
    parser.add_argument("bags", nargs="+", metavar="BAG", help="folder or .mcap file of a bag")
    parser.add_argument("--out", default="analysis.html", metavar="FILE", help="the page")
    parser.add_argument("--urdf", metavar="FILE", help="for bags without robot_description")
    parser.add_argument("--tip-frame", default="", metavar="NAME", help="the link to look at")
    parser.add_argument("--no-page", action="store_true", help="only the table")
    return parser.parse_args(args)


def _analyze(options: argparse.Namespace, console: Console) -> None:
    urdf = _read(options.urdf) if options.urdf else ""
    recordings = []
    for bag in options.bags:
        with console.status(Text(f"reading {bag}")):
            recordings.append(Recording.load(bag, urdf, options.tip_frame))
            if recordings[-1].warning:
                _say(console, f"warning: {recordings[-1].warning}", "yellow")
    with console.status("analysing"):
        tables = list(terminal_tables(recordings, console.width))
    for table in tables:
        console.print(table)
    for recording in recordings:
        if not recording.leading.desired.known.any():
            _say(
                console,
                f"{recording.name}: no message of the topic reference: errors are not known; "
                "start the recorder before the motion",
                "yellow",
            )
    if not options.no_page:
        with console.status("drawing"):
            write_page(options.out, recordings, "", "")
        _say(console, f"The page: {Path(options.out).resolve()}")


def _read(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"cannot read the URDF {path}: {error}") from error


def _say(console: Console, text: str, style: str = "") -> None:
    """Print one line as it is: paths and names may look like markup."""
    console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    sys.exit(main())
