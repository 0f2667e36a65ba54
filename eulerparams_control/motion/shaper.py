"""The shaper: from any reference to a motion that is smooth, and within the limits of the tip.

A motion is a row of legs: one is followed for its duration, then the next one begins, from the
state at the end of the last.  Trajectories within the limits are a leg of their own, to the bit;
those beyond go slower along their path.  What does not begin where the tip is, is joined on
the way.  Set-points and goals are reached in the least time that the limits allow, or as
they come; a twist is attained.  All end at rest.

Time is that of the motion: at the rate u the caller lets it ``wait``, and what is sampled is
scaled by it (:class:`TimeScale`).
"""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from eulerparams_control.motion.dilation import Dilated, Ramped, within
from eulerparams_control.motion.frames import DesiredFrame, distance
from eulerparams_control.motion.legs import Leg, is_alike, is_there, passes, resting
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.plan import Plan, attain, bounded, join, reach
from eulerparams_control.motion.references import Goal, Jog, SetPoint
from eulerparams_control.motion.spline import Poses
from eulerparams_control.motion.stream import PAUSE, StreamFilter
from eulerparams_control.motion.trajectories import Trajectory

Reference = Trajectory | SetPoint | Jog

# Largest number of references that wait for their time, and the time [ns] without a reference that
# begins, after which a stream stalls.
_WAITING, _STALLED = 1000, 1_000_000_000

# Number of intervals of its stream for which a set-point with a twist goes on, if that is more than
# it was to last, and the longest such time [s].
_GOES_ON, _LONGEST = 1.5, 0.4

# Longest wait [s] for a pose of a stream after it was to come.
_LATE = 0.05

# A wait of more than this part of the time stops it: an arm that is blocked creeps.
_STILL = 0.998

# Shortest time [s] in which a motion through poses is joined: a correction is to be gentle.
_BLEND = 0.1

# Wait [s] of a set-point between two plans of its stream.
_BETWEEN = 0.008


class _Waiting(NamedTuple):
    """A reference whose time has not come: its start, and when it came if that is known [ns]."""

    reference: Reference
    start: int | None
    since: int | None


class Shaper:
    """The motion that a controller follows.

    Args:
        held: frame at which it rests at first.
        limits: of the tip; None: references are followed as they are.
        max_jump: [m], [rad] by which a reference may begin away from where the tip is.

    Attributes:
        limits: of the tip.
        leg: of the motion, which is sampled.
        began: time [ns] at which the trajectory that is followed began; None if there is none.
        is_holding: whether no reference was given since it began to hold.
        bearable: rate of time that fits the limits, which were lowered since the motion began.
        slowed: rate of time of the trajectory that is followed, where it is slowest; else 1.
        last: the frame sampled last.
        leap: how far away [m, rad] a reference began that was refused for it; None if none was.
        waiting: references whose time has not come.
        ends: when [ns] the stream that moves has ended, if nothing comes; None if none moves.
        lost: how many references never began, for another one began first.
        ahead: [s] of the newest set-point at its receipt, of the states.
        restarts: whether a reference began from rest at the last sample, for time had waited.
    """

    def __init__(
        self,
        held: DesiredFrame,
        limits: MotionLimits | None = None,
        max_jump: tuple[float, float] = (math.inf, math.inf),
    ) -> None:
        self.limits, self.max_jump = limits, max_jump
        self.lost, self.ahead, self.restarts = 0, 0.0, False
        self._stream = StreamFilter()
        self.hold(held)

    def hold(self, frame: DesiredFrame) -> None:
        """Hold the pose of ``frame`` from now on."""
        self.last = self._before = frame.at_rest()
        self.leg = resting(frame)
        self._start = self._late = 0
        self._waited = 0  # how much of the time to the next sample does not count [ns]
        self._at: int | None = None  # when it was sampled last [ns]
        self.ends: int | None = None
        self._kind: type[Reference] = Trajectory  # of what began last
        self._taken = 0  # when the set-point came that the stream took last [ns]
        self._planned = 0  # when the last plan of the stream was made [ns]
        self.waiting: deque[_Waiting] = deque(maxlen=_WAITING)
        self._stream.forget()
        self.began: int | None = None
        self.leap: tuple[float, float] | None = None
        self.is_holding, self.slowed, self.bearable = True, 1.0, 1.0

    def stop(self, t: int) -> None:
        """Come to rest from the last frame, at t [ns]; what was to follow is forgotten."""
        here = self.last
        self.hold(here)
        if self.limits is not None:
            self.last = self._before = here
            self.leg, self._start = self._brake(here), t

    def has_stopped(self, t: int) -> bool:
        """Whether set-points that moved have stopped coming, t [ns]."""
        return self.ends is not None and t > self.ends

    @property
    def is_at_rest(self) -> bool:
        """Whether the last frame has no twist."""
        return not self.last.moves

    @property
    def expected(self) -> DesiredFrame:
        """Where the next set-point of the stream is expected, which the tip may lag; else ``last``.

        What is sent may not leap: from what was sent before, else from where the tip is.
        """
        frame, since = self._stream.frame, ((self._at or 0) - self._taken) / 1e9
        return self.last if frame is None or since > PAUSE else frame.moved(since)

    def is_stalled(self, t: int) -> bool:
        """Whether set-points come, t [ns], whose time does not."""
        if not self.waiting or not isinstance(self.waiting[-1].reference, SetPoint):
            return False
        since = self.waiting[0].since
        return since is not None and t - since > _STALLED

    def change(self, limits: MotionLimits | None, max_jump: tuple[float, float]) -> None:
        """Take over other limits; what moves goes on as it was planned, but slower."""
        self.max_jump = max_jump
        if limits is not None and self.limits is not None and self.leg.held is None:
            self.bearable *= min(1.0, limits.slowdown(self.limits))
        self.limits = limits

    def wait(self, dt: int) -> None:
        """Let the present motion be later by dt [ns] than it was to be."""
        self._late += dt
        self._waited += dt

    def forget_waiting(self) -> None:
        """Forget the references whose time has not come."""
        self.waiting.clear()

    def follow(self, reference: Reference, start: int | None) -> None:
        """Follow a reference from the time ``start`` [ns], or from the next sample if None.

        Until then the present motion goes on; of those that begin the newest counts.
        """
        self.is_holding = False
        self.lost += len(self.waiting) == _WAITING
        if self._at is not None and start is not None and isinstance(reference, SetPoint):
            self.ahead = (start - self._at) / 1e9
        self.waiting.append(_Waiting(reference, start, self._at))

    def sample(self, t: int) -> DesiredFrame:
        """Return the desired frame at the time t [ns]."""
        leg, since = self.leg, t - self._start - self._late
        if leg.end is not None and t > leg.expires:
            self.leg = leg = leg.end(leg.sample(since / 1e9))
            self._start, self._late, since = t, 0, 0
        while leg.then is not None and since > leg.duration * 1e9:
            whole = round(leg.duration * 1e9)
            self.leg = leg = leg.then(leg.sample(leg.duration))
            self._start, since = self._start + whole, since - whole
        if self._waited and leg.then is resting and self._stands(t):  # it stops: not later
            self.leg = leg = resting(leg.sample(since / 1e9))
        self._before = self.last
        self.last = leg.sample(since / 1e9) if leg.held is None else leg.held
        self.restarts = False
        if self.waiting:
            self._begin_due(t)
        self._at, self._waited = t, 0
        return self.last

    def after(self, dt: float) -> DesiredFrame:
        """Return the frame dt [s] after the last sample, on the leg that it is on."""
        since = (self._at or 0) - self._start - self._late
        return self.leg.sample(since / 1e9 + dt)

    def _stands(self, t: int) -> bool:
        """Whether the time of the motion has not gone on since the last sample, t [ns] now."""
        return self._at is not None and 0 < _STILL * (t - self._at) <= self._waited

    # --- references that begin -----------------------------------------------------------

    def _begin_due(self, t: int) -> None:
        """Begin the newest reference whose time has come; forget those before it."""
        if self.waiting[0].since is None:
            self.waiting[0] = self.waiting[0]._replace(since=t)
        due = [n for n, one in enumerate(self.waiting) if one.start is None or one.start <= t]
        for place in range(due[-1] + 1 if due else 0):
            reference, start, _ = self.waiting.popleft()
            begin = t if start is None else start
            if place == due[-1]:
                self._begin(reference, begin, t)
            else:
                self.lost += begin > t

    def _begin(self, reference: Reference, begin: int, t: int) -> None:
        if self._stands(t):  # what begins while time waits does so from rest
            self.last, self.restarts = self.last.at_rest(), True
        tau, there = (t - begin) / 1e9, None
        if isinstance(reference, Trajectory):
            if not isinstance(reference, Poses):
                reference = reference.from_frame(self.last)
            there = reference.beginning(self.last, tau)
        elif not isinstance(reference, (Goal, Jog)):
            there = reference.sample(tau)
        if there is not None and self._leaps(there):
            return
        self.began, self.ends, self.slowed, self.bearable = None, None, 1.0, 1.0
        if type(reference) is not self._kind:
            self._kind = type(reference)
            self._stream.forget()
        if isinstance(reference, Trajectory):
            self.began = begin
            leg, tau = self._trajectory(reference, tau)
        elif isinstance(reference, SetPoint):
            found = self._set_point(reference, begin, tau, t)
            if found is None:  # the plan of a moment ago goes on
                return
            leg, tau = found
        else:
            leg, tau = self._jog(reference, t), 0.0
        self.leg, self._start, self._late = leg, t - round(tau * 1e9), 0
        if tau <= 0 or leg.duration >= tau:
            self.last = leg.sample(tau)

    def _leaps(self, there: DesiredFrame) -> bool:
        way = distance(self.expected, there)
        if way[0] <= self.max_jump[0] and way[1] <= self.max_jump[1]:
            return False
        self.leap = way
        return True

    def _trajectory(self, trajectory: Trajectory, tau: float) -> tuple[Leg, float]:
        """Return the leg along a trajectory, and how far [s] it has come."""
        limits, least = self.limits, 0.0
        if limits is None:
            trajectory = trajectory.from_frame(self.last, tau)
            return Leg(trajectory.sample), tau
        motion: Trajectory | Dilated | Ramped | None
        if isinstance(trajectory, Poses):
            motion, tau = trajectory.passed(self.last, tau, limits)
            least = max(_BLEND, -tau)
        else:
            motion = within(trajectory, limits)
            if isinstance(motion, Dilated):
                tau = motion.time_at(tau)
        if motion is None or tau >= motion.duration:
            return self._to_rest(self.last, trajectory.frames[-1].at_rest()), 0.0
        self.slowed = motion.slowest
        leg = self._along(motion, 0.0)
        if tau >= 0 and is_alike(self.last, motion.sample(tau)):
            return leg, tau
        plan = join(self.last, motion.sample, tau, limits, least)
        return self._then(plan, self._along(motion, tau + plan.duration), self._brake), 0.0

    def _along(self, motion: Trajectory | Dilated | Ramped, offset: float) -> Leg:
        """Return the leg along a motion from the time ``offset`` [s] on."""
        sample = motion.sample if offset == 0 else lambda t: motion.sample(offset + t)
        end = motion.sample(motion.duration)
        if not end.moves:
            return Leg(sample)
        left = max(motion.duration - offset, 0.0)
        return Leg(sample, left, lambda here: self._to_rest(here, end.at_rest()))

    def _set_point(
        self, point: SetPoint, begin: int, tau: float, t: int
    ) -> tuple[Leg, float] | None:
        """Return the leg to a set-point and on, and how far [s] it has come; None: as it was."""
        limits, stream, before = self.limits, self._stream, self._at
        if limits is None:
            self.ends = begin + round(point.lasting * 1e9) if point.moves else None
            return Leg(point.sample), tau
        stream.take(point.frames[0], begin / 1e9, limits)
        self._taken = t
        assert stream.frame is not None
        line, late = bounded(stream.frame, limits), 0.0
        if stream.has_twists:
            tau = min(tau, point.lasting)  # one that comes late leads on by its twist, so far
            lasting = max(point.lasting, min(_GOES_ON * stream.next_within, _LONGEST))
            self.ends = t + round(lasting * 1e9)
            dt = 0.0 if before is None or self._waited else (t - before) / 1e9
            if passes(self._before, point.sample(tau), dt, limits):
                return self._goes_on(point.frames[0], tau, lasting, t), tau
        elif not stream.interval:
            return self._to_rest(self.last, line), 0.0
        else:  # late by the time until the next one comes: so it goes hardly beyond the last
            tau, late = 0.0, stream.next_within
            lasting = late + min(late / 2 + _BETWEEN, _LATE)
        if 0 < t - self._planned < _BETWEEN * 1e9 and stream.interval > 0:
            return None
        self._planned = t
        plan = join(self.last, lambda s: line.moved(s - late), tau, limits, stream.interval)
        end = self._brake if stream.has_twists else self._to_the_last
        expires = t + round(lasting * 1e9)
        if plan.duration >= lasting:
            return Leg(plan.sample, lasting, end, expires=expires, end=end), 0.0
        met, left = tau + plan.duration - late, lasting - plan.duration
        on = Leg(lambda s: line.moved(met + s), left, end, expires=expires, end=end)
        leg = self._then(plan, on, self._brake)
        leg.expires, leg.end = expires, end
        return leg, 0.0

    def _goes_on(self, frame: DesiredFrame, tau: float, lasting: float, t: int) -> Leg:
        """Return the leg that leads on from a set-point: soon without its acceleration."""
        assert self.limits is not None
        soon = tau + min(max(1.5 * self._stream.interval, 1e-3), lasting)
        line = bounded(frame.moved(soon), self.limits)
        expires = t + round(lasting * 1e9)
        left, end = max(tau + lasting - soon, 0.0), self._brake
        on = Leg(line.moved, left, end, expires=expires, end=end)
        return Leg(frame.moved, soon, lambda _: on, expires=expires, end=end)

    def _jog(self, jog: Jog, t: int) -> Leg:
        """Return the leg that attains a twist, and ends."""
        if self.limits is None:
            line = self.last._replace(dp_d=jog.twist[:3], omega_d=jog.twist[3:]).moved
            return Leg(line, jog.lasting, lambda here: resting(here))
        plan = attain(self.last, jog.twist, self.limits)
        expires = t + round(jog.lasting * 1e9)
        end = self._brake
        return Leg(plan.sample, jog.lasting, end, expires=expires, end=end)

    # --- ends ----------------------------------------------------------------------------

    def _then(self, plan: Plan, leg: Leg, otherwise: Callable[[DesiredFrame], Leg]) -> Leg:
        """Return the leg of a plan that a leg follows, if the plan ends where that begins."""

        def then(here: DesiredFrame) -> Leg:
            return leg if is_there(here, leg.sample(0.0)) else otherwise(here)

        return Leg(plan.sample, plan.duration, then)

    def _to_rest(self, here: DesiredFrame, goal: DesiredFrame) -> Leg:
        """Return the leg that ends at rest at a goal; where no plan leads there, after a stop."""
        assert self.limits is not None
        plan = reach(here, goal, self.limits)
        return self._then(
            plan, resting(goal), lambda end: self._again(end, goal) if here.moves else resting(end)
        )

    def _again(self, here: DesiredFrame, goal: DesiredFrame) -> Leg:
        """Return the leg that stops, and goes to a goal from there."""
        leg = self._brake(here)
        leg.then = lambda end: self._to_rest(end.at_rest(), goal)
        return leg

    def _to_the_last(self, here: DesiredFrame) -> Leg:
        """Return the leg that ends at rest at the set-point that came last."""
        assert self._stream.last is not None
        return self._to_rest(here, self._stream.last.at_rest())

    def _brake(self, here: DesiredFrame) -> Leg:
        """Return the leg that comes to rest as soon as it can."""
        assert self.limits is not None
        plan = attain(here, np.zeros(6), self.limits)
        return Leg(plan.sample, plan.duration, resting)
