"""The executable ``analyze``: numbers, tables, figures and a page from bags; needs no ROS."""

import argparse
import math
import sys
from pathlib import Path

from rich.console import Console
from rich.text import Text

from eulerparams_control.analysis.arm import namespaces
from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.export import FORMATS, file_name, write_table
from eulerparams_control.analysis.labels import labels
from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.page import write_page
from eulerparams_control.analysis.table import terminal_tables
from eulerparams_control.bags.format import BagFlaw
from eulerparams_control.bags.reader import Bag
from eulerparams_control.command_line import make_console, say
from eulerparams_control.errors import ConfigurationError, EulerParamsError


def main(args: list[str] | None = None) -> int:
    """Run ``analyze BAG [BAG ...]`` with its options.

    Returns:
        the exit code: 0, or 2 if a bag could not be analysed.
    """
    options = _parse(args)
    console = make_console()
    try:
        return _analyze(options, console)
    except EulerParamsError as error:
        say(console, f"error: {error}", "red")
        return 2
    except KeyboardInterrupt:
        return 130


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="analyze", description="Numbers and a page from bags with joint_states; without ROS."
    )
    add = parser.add_argument
    add("bags", nargs="+", metavar="BAG", help="folder or .mcap file of a bag")
    add("--out", default="analysis.html", metavar="FILE", help="the page; tables go beside it")
    add("--no-page", action="store_true", help="no page")
    add("--from", dest="start", type=_seconds, default=0.0, metavar="S", help="begin there [s]")
    add("--to", dest="end", type=_seconds, default=math.inf, metavar="S", help="end there [s]")
    add("--export", choices=FORMATS, help="all quantities over time as a table for each run")
    add("--figures", metavar="DIR", help="a figure for each quantity, for papers")
    add("--figure-format", action="append", metavar="F", choices=("svg", "png", "pdf"),
        help="svg, png or pdf, may be repeated; svg and png if not given")  # fmt: skip
    add("--urdf", metavar="FILE", help="for bags without robot_description")
    add("--tip-frame", default="", metavar="NAME", help="the link to look at")
    add("--base-frame", default="", metavar="NAME", help="the link that poses refer to")
    add("--euler-sequence", default="", metavar="S", help="of the Euler angles, such as ZYZ")
    add("--namespace", metavar="NS", help="of the arm, if not all arms of the bag, such as /left")
    add("--topic", action="append", default=[], type=_renamed, metavar="NAME:=/TOPIC",
        help="what a topic is called in the bags, such as joint_states:=/arm/state")  # fmt: skip
    return parser.parse_args(args)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a time [s] >= 0 from the beginning")
    return value


def _renamed(text: str) -> tuple[str, str]:
    name, sign, topic = text.partition(":=")
    if not (name and sign and topic):
        raise argparse.ArgumentTypeError(f"'{text}'; expected NAME:=/TOPIC")
    return name, topic


def _analyze(options: argparse.Namespace, console: Console) -> int:
    if options.start >= options.end:
        raise ConfigurationError(
            f"--from {options.start:g} --to {options.end:g}: expected a time before the end"
        )
    digests, failed = _digests(options, console)
    if not digests:
        return 2
    for table in terminal_tables(digests, console.width):
        console.print(table)
    for digest in digests:
        _warn(digest, console)
    _say_which_end_early(digests, console)
    if options.figures:
        from eulerparams_control.analysis.static import write_figures  # matplotlib takes a second

        formats = options.figure_format or ["svg", "png"]
        written = write_figures(options.figures, digests, formats)
        say(console, f"{len(written)} figures: {Path(options.figures).resolve()}")
    if not options.no_page:
        with console.status("drawing"):
            write_page(options.out, digests, "", "", first=_first(digests))
        say(console, f"The page: {Path(options.out).resolve()}")
    return 2 if failed else 0


def _digests(options: argparse.Namespace, console: Console) -> tuple[list[Digest], bool]:
    """Return the digests of all runs, and whether a bag could not be read; says why."""
    digests, failed, names = [], False, set[str]()
    for path in options.bags:
        bag = None
        try:
            bag = Bag(path)
            for arm in _namespaces(bag, options):
                file = _table_of(path, arm, options, names)
                with console.status(Text(f"reading {path}{arm}")):
                    digests.append(_digest(bag, arm, file, options))
                if file is not None:
                    say(console, f"The table: {file.resolve()}")
        except EulerParamsError as error:
            failed = True
            say(console, f"error: {error}", "red")
            if bag is not None and bag.warning:
                say(console, f"warning: {bag.warning}", "yellow")
    return digests, failed


def _namespaces(bag: Bag, options: argparse.Namespace) -> list[str]:
    if options.namespace is not None:
        return ["/" + options.namespace.strip("/") if options.namespace.strip("/") else ""]
    return namespaces(bag, dict(options.topic))


def _digest(bag: Bag, namespace: str, file: Path | None, options: argparse.Namespace) -> Digest:
    """Return the digest of an arm of a bag, and write its table if there is to be one."""
    run = load(
        bag,
        urdf=options.urdf or "",
        tip_frame=options.tip_frame,
        base_frame=options.base_frame,
        namespace=namespace,
        names=dict(options.topic),
        start=options.start,
        end=options.end,
        euler_sequence=options.euler_sequence,
    )
    if file is not None:
        write_table(file, run)
    return Digest.of(run)


def _table_of(
    path: str, namespace: str, options: argparse.Namespace, taken: set[str]
) -> Path | None:
    """Return the file of the table of a run, another one for each run; None if there is none."""
    if not options.export:
        return None
    parts = Path(path).resolve().parts
    for depth in range(1, len(parts) + 1):
        name = file_name(str(Path(*parts[-depth:])) + namespace)
        if name not in taken:
            break
    else:
        name = f"{name}_{len(taken)}"
    taken.add(name)
    return Path(options.out).parent / f"{name}.{options.export}"


def _say_which_end_early(digests: list[Digest], console: Console) -> None:
    """Say which runs are shorter than others: their last values are of another time."""
    longest = max(digest.end for digest in digests)
    for name, digest in zip(labels(digests), digests, strict=True):
        if digest.end < 0.98 * longest:
            text = f"{name} ends at {digest.end:.3f} s, the longest run at {longest:.3f} s"
            say(console, f"{text}: its values at the end are of that time", "yellow")


def _first(digests: list[Digest]) -> str:
    """Return the quantity that matters most, among those that all runs have.

    Of a contact the force, of a commanded arm the error of the arm itself.
    """
    for name in ("force", "measured_orientation_error"):
        if all(name in digest.curves for digest in digests):
            return name
    return "orientation_error"


def _warn(digest: Digest, console: Console) -> None:
    if digest.warning:
        say(console, f"warning: {digest.name}: {digest.warning}", "yellow")
    flaws = {warning.kind for warning in digest.warnings}
    if BagFlaw.UNFINISHED in flaws:
        say(console, f"it was read up to {digest.end:.3f} s; bag_recorder --recover {digest.path} "
             "makes a whole bag beside it, as far as it goes", "yellow")  # fmt: skip
    if "position_error" not in digest.curves and BagFlaw.FRAMES not in flaws:
        say(console, f"{digest.name}: no reference was recorded: errors are not known", "yellow")


if __name__ == "__main__":
    sys.exit(main())
