"""Smoothness of what the commands ask for: speed, acceleration and jerk of joints and tip.

Judged are the positions as a robot sees them, over the differences of their stamps: see
:mod:`sim_bridge.acceleration`.  Those of the tip are differences of its pose at them: of what the
commands ask for, whatever the law wanted.  After a silence, in which the arm stops, and after a
gap that is longer than a robot bridges, the differences restart.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from eulerparams_control.control.mode import Cause
from eulerparams_control.lab.campaign.oracles import Found, oracle, worst_of
from eulerparams_control.lab.campaign.oracles.commands import follows
from eulerparams_control.lab.campaign.oracles.standstill import without
from eulerparams_control.lab.campaign.record import Command, SequenceRecord, Span, Values
from eulerparams_control.laws.rotations import Array, log
from sim_bridge.acceleration import BRIDGED, CommandAcceleration

# Beyond a limit by these parts of it: speeds; accelerations; jerks, since a law that corrects what
# it missed overshoots.
_SPEED, _ACCELERATION, _JERK = 1.01, 1.05, 1.5

# An acceleration may step by this part of its limit, and a speed by this part of its own, half a
# millimetre per second: no robot feels them, but their jerk is anything.
_STEP, _SPEED_STEP = 0.1, 0.002

# The same of an arm that is driven by efforts, whose law corrects what goes wrong; and how long [s]
# it is given to do so after a start, and any law after a push or a fault that shakes the arm.
_TRUE_SPEED, _TRUE_ACCELERATION, _SETTLING = 1.1, 1.3, 0.5


class TipSample(NamedTuple):
    """Where the joints are, or are to be: q (n,) [rad] at t [s] of the sequence, and of the arm."""

    t: float
    stamp: float
    q: Values


@oracle(
    "smooth joints",
    f"the positions and speeds of commands ask for at most {_ACCELERATION:g} times "
    "max_joint_acceleration, from one to the next, and from where the arm is to the first",
)
def joints_smooth(record: SequenceRecord) -> Found:
    """Yield the first command that asks for more, and how many do."""
    if record.asked is None:
        return
    n = len(record.joints)
    limit = np.broadcast_to(_ACCELERATION * np.array(record.asked.joint_acceleration), n)
    turning = np.isinf(record.limits.upper)
    watch = CommandAcceleration(record.joints, limit, turning, [False] * n, 1e-3)
    times, found = [truth.t for truth in record.truth], []
    for run in runs(record):
        watch.rest()
        for command in run:
            q, dq = np.array(command.q), np.array(command.dq)
            standing = np.array(record.truth[bisect_right(times, command.t) - 1].q)
            stamp = round(1e9 * command.stamp)
            if text := watch.judge(q, dq, stamp, command.t, standing):
                found.append((command.t, text))
    yield from ((t, f"{text}; {len(found)} commands in all") for t, text in found[:1])


@oracle(
    "smooth tip",
    f"the poses of the tip at the positions of commands change with at most {_SPEED:g} times "
    f"the speed, {_ACCELERATION:g} times the acceleration and {_JERK:g} times the jerk that "
    f"max_linear_... and max_angular_... allow, beside steps of {100 * _STEP:g} % of the "
    f"acceleration and {100 * _SPEED_STEP:g} % of the speed; not while a fault shakes the arm "
    "or its measured state, or the arm is given up since it does not follow",
)
def tip_smooth(record: SequenceRecord) -> Found:
    """Return the worst speed, acceleration and jerk, of those that are too much.

    Not while states or commands are lost or mixed: what is commanded then is stepped as they are.
    Nor when it gives up an arm that does not follow: the commands go back to where that is, joint
    by joint, and the arm itself goes nowhere.
    """
    given_up_for = Cause.NOT_FOLLOWING, Cause.CONTACT_TOO_LARGE
    lost = [said.t for said in record.said if said.cause in given_up_for]
    given_up = [(t, t + _SETTLING) for t in lost]
    paths = (
        [TipSample(c.t, c.stamp, c.q) for c in run if low <= c.t <= high]
        for run in runs(record)
        for start, end in _undisturbed(record, run[0].t, run[-1].t)
        for low, high in without(start, end, given_up)
    )
    return _worst(record, paths, (_SPEED, _ACCELERATION, _JERK))


@oracle(
    "smooth arm",
    f"driven by efforts, and not pushed or shaken, the tip of the arm has at most "
    f"{_TRUE_SPEED:g} times the speed and {_TRUE_ACCELERATION:g} times the acceleration that "
    f"max_linear_... and max_angular_... allow, from {_SETTLING:g} s on",
)
def arm_smooth(record: SequenceRecord) -> Found:
    """Return the worst speed and acceleration, of those that are too much."""
    paths = (
        [TipSample(k.t, k.t, k.q) for k in record.truth if low <= k.t <= high]
        for driven in _stretches(record, (c for c in record.commands if c.effort))
        for low, high in _undisturbed(record, driven[0].t + _SETTLING, driven[-1].t)
    )
    return _worst(record, paths, (_TRUE_SPEED, _TRUE_ACCELERATION, np.inf))


def _undisturbed(record: SequenceRecord, start: float, end: float) -> list[Span]:
    """Return the parts of a span [s] in which all that the robot says and hears is as it is."""
    return without(start, end, [(a, b + _SETTLING) for a, b in record.shaken])


def _stretches(record: SequenceRecord, commands: Iterable[Command]) -> Iterator[list[Command]]:
    """Yield those of some commands that follow on each other, at least one."""
    stretch: list[Command] = []
    for command in commands:
        if stretch and not follows(stretch[-1], command):
            yield stretch
            stretch = []
        stretch.append(command)
    if stretch:
        yield stretch


def runs(record: SequenceRecord) -> Iterator[list[Command]]:
    """Yield the positions that follow on each other: the last of those at a time, or of a stamp.

    The first at rest stays, also where others come with it; others say which are not finite.
    """
    n = len(record.joints)
    whole = (c for c in record.commands if len(c.q) == n and np.isfinite((*c.q, *c.dq)).all())
    for stretch in _stretches(record, whole):
        run: list[Command] = []
        for command in stretch:
            is_same = run and command.stamp == run[-1].stamp
            if is_same or (len(run) > 1 and command.t == run[-1].t):
                run.pop()
            run.append(command)
        yield run


def _worst(
    record: SequenceRecord,
    paths: Iterable[list[TipSample]],
    factors: tuple[float, float, float],
) -> Found:
    """Return the worst speed, acceleration and jerk of the tip, of those that are too much."""
    asked = record.asked
    if asked is None:
        return []
    speed, acceleration, jerk = factors
    step, kick = _STEP / record.period, _SPEED_STEP / record.period**2
    linear_step = max(step * asked.linear_acceleration, kick * asked.linear_speed)
    angular_step = max(step * asked.angular_acceleration, kick * asked.angular_speed)
    limits = {
        "linear speed": speed * asked.linear_speed,
        "angular speed": speed * asked.angular_speed,
        "linear acceleration": acceleration * asked.linear_acceleration,
        "angular acceleration": acceleration * asked.angular_acceleration,
        "linear jerk": jerk * asked.linear_jerk + linear_step,
        "angular jerk": jerk * asked.angular_jerk + angular_step,
    }
    return worst_of(
        (what, norm / limit, t, f"the {what} of the tip is {norm:.4g}; allowed is {limit:.4g}")
        for path in paths
        for t, norms in _changes(record, path)
        for norm, (what, limit) in zip(norms, limits.items(), strict=False)
        if norm > limit
    )


def _changes(record: SequenceRecord, path: list[TipSample]) -> Iterator[tuple[float, list[float]]]:
    """Yield when [s], and the norms of v, omega, and as far as is known of their derivatives."""
    still = np.zeros(len(record.joints))
    poses = [record.model.state(np.array(sample.q), still) for sample in path]
    rates: list[tuple[float, Array]] = []  # over how long, v and omega (2, 3); then theirs
    for (before, a), (after, b) in pairwise(zip(path, poses, strict=True)):
        dt = after.stamp - before.stamp
        if not 0.0 < dt <= record.period + BRIDGED:
            rates = []
            continue
        twist = np.stack(((b.p_e - a.p_e) / dt, log(b.R_e @ a.R_e.T) / dt))
        rates = [*rates[-2:], (dt, twist)]
        orders = [_difference(rates[-order:]) for order in range(1, len(rates) + 1)]
        yield after.t, np.linalg.norm(np.concatenate(orders), axis=1).tolist()


def _difference(rates: list[tuple[float, Array]]) -> Array:
    """Return the difference quotient of rates that follow on each other; one is itself."""
    while len(rates) > 1:
        rates = [
            (0.5 * (ta + tb), (b - a) / (0.5 * (ta + tb))) for (ta, a), (tb, b) in pairwise(rates)
        ]
    return rates[0][1]
