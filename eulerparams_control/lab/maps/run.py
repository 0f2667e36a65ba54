"""One simulation of a map: a law moves a tip, and what became of it."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.lab.maps.tip import DrivenTip
from eulerparams_control.laws.rotations import Array, angle_between, exp
from eulerparams_control.motion.frames import DesiredFrame

_FASTEST = 1e6  # [rad/s] beyond it has diverged

FINE, FAST, UNSETTLED, DIVERGED = 0, 1, 2, 3


class TurnOutcome(NamedTuple):
    """What became of a run.

    Attributes:
        peak: [rad/s] highest angular speed of the tip.
        travel: [rad] length of its way.
        worst: [rad] largest orientation error after the first step.
        final: [rad] orientation error at the end; of a run that diverged pi.
        settled: [s] from when on the error stays below a bound; inf if it does not.
        diverged: whether it left all numbers, or the law had no answer.
    """

    peak: float
    travel: float
    worst: float
    final: float
    settled: float
    diverged: bool


class Sampling(NamedTuple):
    """How a run is sampled.

    Attributes:
        dt: [s] a step.
        duration: [s].
        noise: [rad] standard deviation of the measured orientation, about each axis.
        bound: [rad] orientation error below which it is settled.
    """

    dt: float
    duration: float
    noise: float
    bound: float


def run(
    drive: DrivenTip,
    desired: Callable[[float], DesiredFrame],
    sampling: Sampling,
    random: np.random.Generator,
) -> TurnOutcome:
    """Return what becomes of a tip that is driven to a desired frame over time."""
    dt, steps = sampling.dt, round(sampling.duration / sampling.dt)
    noise = sampling.noise * random.normal(size=(steps, 3))
    errors, speeds = np.zeros(steps), np.zeros(steps)
    for i in range(steps):
        target = desired(i * dt)
        state = drive.tip.state
        errors[i] = angle_between(state.R_e, target.R_d)
        try:
            drive.step(state._replace(R_e=exp(noise[i]) @ state.R_e), target, dt)
            omega = drive.tip.state.omega_e
            speeds[i] = math.sqrt(omega @ omega)
        except (SingularityError, OverflowError):
            speeds[i] = math.inf
        if not speeds[i] < _FASTEST:
            return _diverged(speeds[:i], errors[: i + 1], dt)
    return _outcome(speeds, errors, sampling)


def _outcome(speeds: Array, errors: Array, sampling: Sampling) -> TurnOutcome:
    outside = np.flatnonzero(errors > sampling.bound)
    last = int(outside[-1]) + 1 if len(outside) else 0
    settled = last * sampling.dt if last < len(errors) else math.inf
    travel = float(speeds.sum() * sampling.dt)
    worst = float(errors[1:].max())
    return TurnOutcome(float(speeds.max()), travel, worst, float(errors[-1]), settled, False)


def _diverged(speeds: Array, errors: Array, dt: float) -> TurnOutcome:
    travel = float(speeds.sum() * dt)
    return TurnOutcome(_FASTEST, travel, float(errors.max()), math.pi, math.inf, True)


def failure(outcome: TurnOutcome, highest: float) -> float:
    """Return how a run that had to settle failed: FINE, FAST, UNSETTLED or DIVERGED.

    One that never had an error has settled at once.

    Args:
        outcome: of the run.
        highest: [rad/s] speed that was not to be exceeded.
    """
    if outcome.diverged:
        return DIVERGED
    if math.isinf(outcome.settled):
        return UNSETTLED
    return FAST if outcome.peak > highest else FINE
