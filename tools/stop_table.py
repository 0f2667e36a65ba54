"""The tables of docs/stops.md, from the runs of the experiments of stops.

experiment stops stops_contact stops_pushed stops_wall stops_load --out out
python tools/stop_table.py out
"""

import argparse
from pathlib import Path

from eulerparams_control import analysis
from eulerparams_control.analysis.recording import Recording

PLANTS = ("250", "500", "1000", "ideal")
ARMS = ("ur5", "panda", "iiwa")
HANDS = ("ur5_150n", "iiwa_150n", "panda_45n", "ur5_65n", "panda_65n", "iiwa_65n")
BOUNDS = {
    "stops": (10.0, 0.5, 0.25),
    "stops_contact": (10.0, 0.25),
    "stops_pushed": (20.0, 0.25),
    "stops_wall": (1.0, 0.1, 50.0),
    "stops_load": (80.0, 20.0),
}
LEANS = ((1.0, 1.8), (2.2, 3.0), (3.4, 4.2))  # [s] of the experiment stops


def numbers(name: str, run: Recording) -> tuple[float, ...]:
    """Return the numbers of a run of an experiment."""

    def of(metric: str, **options: float) -> float:
        return analysis.measure(metric, run, **options)

    if name == "stops":
        joints = max(of("peak_joint_speed", after=a, before=b) for a, b in LEANS)
        return of("stop_way"), joints, of("stop_tip_speed")
    if name == "stops_wall":
        later, left = of("stop_joint_speed", since=0.3), of("stop_force", since=1.0)
        return of("stop_speed_ratio"), later, left
    if name == "stops_load":
        return of("peak_position_error"), of("stop_way")
    return of("stop_way"), of("stop_tip_speed")


def cell(found: tuple[float, ...], bounds: tuple[float, ...]) -> str:
    """Return numbers as text, those beyond their bounds in bold."""
    texts = []
    for number, bound in zip(found, bounds, strict=True):
        text = f"{number:#.2g}".rstrip(".") if number < 10 else f"{number:.0f}"
        texts.append(f"**{text}**" if number >= bound else text)
    return ", ".join(texts)


def main() -> None:
    """Print them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, help="the folder of the experiments")
    given = parser.parse_args()
    for name, bounds in BOUNDS.items():
        if not (given.runs / name).is_dir():
            continue
        print(f"\n| `{name}` | 250 Hz | 500 Hz | 1000 Hz | ideal joints, 1000 Hz |")
        print("| --- | --- | --- | --- | --- |")
        for arm in HANDS if name in ("stops_contact", "stops_pushed") else ARMS:
            row = [arm.replace("_", ", ").replace("0n", "0 N").replace("5n", "5 N")]
            for plant in PLANTS:
                bag = given.runs / name / f"{arm}_{plant}"
                row.append(cell(numbers(name, analysis.load(bag)), bounds) if bag.is_dir() else "")
            print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
