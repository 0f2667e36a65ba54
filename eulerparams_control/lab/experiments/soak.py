"""The command of the soak, ``make soak``: the experiment of this name, as long as asked for."""

import argparse
import math
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

from rich.console import Console

from eulerparams_control.analysis.quantities.real_time import PATIENCE, QUARTERS, WARM_UP
from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.experiments.evaluate import Outcome
from eulerparams_control.lab.experiments.main import run_experiments, run_tasks
from eulerparams_control.lab.experiments.model import Experiment, Task, Variant

_NAME = "soak"
_LEAST_SECONDS = 25.0  # enough samples of memory at both ends

# A reference of more turns, of 60 points each, takes a controller longer to read than the robot
# waits for a command.
_TURNS, _LEAST_PERIOD, _RAMPS = 10, 8.0, 6


def main(args: list[str] | None = None) -> int:
    """Run ``[--minutes M | --seconds S] [--controller C] [--rate HZ] [--out DIR]``.

    Returns:
        the exit code: 0 if all criteria are met, 1 if one is not, 2 if a node died or after an
        error, 130 after an interrupt.
    """
    return run_experiments(partial(_run, _parse(args)))


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog=_NAME,
        description="All nodes in real time, as processes, for long: does memory grow, does the "
        "round trip get slower, does a command go missing that nothing explains?",
        epilog="Ends with 1 if something that must hold does not.",
    )
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--minutes", type=float, default=20.0, help="default %(default)g")
    length.add_argument("--seconds", type=float, help="instead of minutes")
    names = tuple(load_experiment(_NAME).variants)
    parser.add_argument("--controller", choices=names, help="only this one")
    parser.add_argument("--rate", type=float, default=250.0, help="[Hz] of joint_states")
    parser.add_argument("--out", type=Path, default=Path("out/soak"), help="folder of the results")
    return parser.parse_args(args)


def _run(options: argparse.Namespace, console: Console) -> list[Outcome]:
    seconds = 60 * options.minutes if options.seconds is None else options.seconds
    experiment = soak(seconds, options.rate)
    chosen = [options.controller] if options.controller else list(experiment.variants)
    task = Task(experiment, options.out, chosen)
    return run_tasks([task], len(chosen), console)


def soak(seconds: float, rate: float) -> Experiment:
    """Return the experiment, of which a time [s] counts, with joint_states at a rate [Hz].

    Raises:
        ConfigurationError: if it would be too short, or the robot could not do it.
    """
    if not _LEAST_SECONDS <= seconds <= 1e6:
        raise ConfigurationError(f"a soak of {seconds:g} s; expected {_LEAST_SECONDS:g} s to 1e6 s")
    if not 200 <= rate <= 1000:  # the gains of the controllers need as much
        raise ConfigurationError(f"--rate {rate:g}; expected 200 to 1000 Hz")
    experiment = load_experiment(_NAME)
    variants = {name: _variant(v, seconds, rate) for name, v in experiment.variants.items()}
    return replace(experiment, variants=variants)


def _variant(variant: Variant, seconds: float, rate: float) -> Variant:
    """Return a variant as long as that, with a circle that outlasts it."""
    moving = seconds + min(WARM_UP, seconds / QUARTERS)
    period = max(_LEAST_PERIOD, 2 * moving / _TURNS)
    circle = {
        "circle_period": period,
        "circle_turns": float(math.ceil(2 * moving / period)),
        "circle_ramp": period / _RAMPS,
    }
    nodes = variant.nodes | {
        "pybullet_bridge": variant.nodes.get("pybullet_bridge", {}) | {"rate": rate},
        "reference": variant.nodes["reference"] | circle,
    }
    return replace(variant, nodes=nodes, duration=moving + PATIENCE)


if __name__ == "__main__":
    sys.exit(main())
