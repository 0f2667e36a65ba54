"""The yardstick of the experiments: verdicts and numbers of `make paper` and `make compare`.

    python test/yardstick_paper.py out/paper out/compare           # compare; 1 where one differs
    python test/yardstick_paper.py --write out/paper out/compare   # and replace those in the file

It reads the summary.json of each experiment below these folders, and nothing else.  Not held are
``seconds`` and ``stamp``: how long an experiment took, and the version of the code; and sentences,
which repeat numbers.
"""

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

FILE = Path(__file__).with_suffix(".json")
# Numbers may differ by this part of them, and by what is rounding: residuals that should be 0.
RELATIVE, ROUNDING = 1e-6, 1e-9

Content = dict[str, Any]


def content_of(summary: Content) -> Content:
    """Return what is held of the summary of an experiment."""
    names = "text", "variant", "measured", "unit", "met"
    return {
        "met": summary["met"],
        "criteria": [{name: each[name] for name in names} for each in summary["criteria"]],
        "numbers": summary["numbers"],
        "diverged": summary["diverged"],
    }


def read_folder(folder: Path) -> Content:
    """Return what is held of each experiment whose results are below a folder."""
    summaries = (json.loads(path.read_text()) for path in sorted(folder.glob("*/summary.json")))
    return {summary["experiment"]: content_of(summary) for summary in summaries}


def read(path: Path = FILE) -> Content:
    """Return what is held, by folder and experiment."""
    return json.loads(path.read_text()) if path.is_file() else {}


def is_same(now: Any, before: Any) -> bool:
    """Return whether two values are the same, or two numbers nearly."""
    if isinstance(now, bool | str | None) or isinstance(before, bool | str | None):
        return now == before
    return math.isclose(now, before, rel_tol=RELATIVE, abs_tol=ROUNDING)


def differences(now: Content, before: Content) -> list[str]:
    """Return in what an experiment differs from what is held of it, a line each."""
    lines = []

    def judge(name: str, here: Any, there: Any) -> None:
        if not is_same(here, there):
            numbers = all(isinstance(x, float | int) for x in (here, there))
            by = f" ({abs(here - there) / max(abs(there), 1e-300):.2g} of it)" if numbers else ""
            lines.append(f"{name}: {here}, where it was {there}{by}")

    judge("met", now["met"], before["met"])
    for kind in ("numbers", "diverged"):
        for name in sorted(now[kind].keys() | before[kind].keys()):
            judge(f"{kind} {name}", *(of[kind].get(name, "nothing") for of in (now, before)))
    judge("number of criteria", len(now["criteria"]), len(before["criteria"]))
    for here, there in zip(now["criteria"], before["criteria"], strict=False):
        name = f"{here['text']}, {here['variant']} [{here['unit']}]"
        for key in ("variant", "unit", "measured", "met"):
            judge(f"{name}: {key}", here[key], there[key])
    return lines


def compare(now: Content, before: Content) -> dict[str, list[str]]:
    """Return the experiments of a folder that differ, each with its lines."""
    found = {}
    for name in sorted(now.keys() | before.keys()):
        if name not in now:
            found[name] = ["it did not run"]
        elif name not in before:
            found[name] = ["it is new"]
        elif lines := differences(now[name], before[name]):
            found[name] = lines
    return found


def main(args: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Verdicts and numbers of the experiments.")
    parser.add_argument("folders", nargs="+", type=Path, help="out/paper, out/compare")
    parser.add_argument("--write", action="store_true", help="replace what is held of them")
    asked = parser.parse_args(args)
    held, count = read(), 0
    for folder in asked.folders:
        now = read_folder(folder)
        found = compare(now, held.get(folder.name, {}))
        print(f"{folder}: {len(found)} of {len(now)} experiments differ")
        for name, lines in found.items():
            print(f"  {name}")
            print("".join(f"    {line}\n" for line in lines), end="")
        count += len(found)
        held[folder.name] = now
    if asked.write:
        FILE.write_text(json.dumps(held, indent=1, sort_keys=True, ensure_ascii=False) + "\n")
        print(f"{FILE}: {FILE.stat().st_size / 1e3:.0f} kB")
        return 0
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
