"""From a bag to recordings: all at once, or one part after the other in bounded memory.

Each topic is decoded once into columns on the disk; a part of a run has the rows of its time.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.arm import Arm, Options
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.reports import Report, Reports
from eulerparams_control.analysis.series import Departure, Frames, moved
from eulerparams_control.analysis.topics import (
    LATEST,
    NO_START,
    Diagnostics,
    RecordedTopic,
    Rows,
    SentReferences,
    Stamps,
)
from eulerparams_control.bags.format import BagFlaw, BagWarning
from eulerparams_control.bags.reader import Bag
from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.laws.compiled import sample
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot import urdf_text

_ANSWERED = 500_000_000  # [ns] within which the answers to a state are in the bag
_TOLD = 10_000  # messages between calls of progress
_LONGEST = 9e9  # [s] that stamps can tell of
_MOST = 10  # messages of a topic in a part, for each state that it was to have

BLOCK = 20_000
"""Samples of a part: some seconds of motion, some 100 MB of memory."""


Progress = Callable[[float], None]
"""Called with the share of the work that is done, 0 to 1."""


@dataclass(frozen=True)
class RecordedReferences:
    """K references in the order in which they were sent.

    Attributes:
        sent: (K,) [ns].
        start: (K,) [ns] when they begin; ``NO_START`` is at the first tick after they were sent.
        frames: returns the first frames of some, by their places; a set-point has no other.
        trajectories: those that are no set-points, by place.
    """

    sent: Stamps
    start: Stamps
    frames: Callable[[NDArray[np.intp]], Frames] = field(repr=False)
    trajectories: Mapping[int, Trajectory] = field(repr=False)


class DesiredFrames:
    """The desired frame at the stamps of a recording, from the references in it.

    A reference counts from when the controller said that it began, else from the first tick that
    was sent after it, as ``motion.Shaper`` does it in the controller.

    Args:
        references: all of the recording.
        ticks, sent: (N,) [ns] of the ticks of the controller, increasing.
        lasting: [s] for which a set-point goes on without a successor.
        held: pose at a stamp, that the controller holds until the first reference begins.
    """

    def __init__(
        self,
        references: RecordedReferences,
        ticks: Stamps,
        sent: Stamps,
        lasting: float,
        held: Callable[[int], DesiredFrame],
    ) -> None:
        self._frames, self._lasting = references.frames, lasting
        self._held_from = LATEST
        N = len(ticks)
        received = np.searchsorted(np.maximum.accumulate(sent), references.sent)  # tick: finds it
        begins = np.maximum(received, np.searchsorted(ticks, references.start))
        replaced = np.append(received[1:], N)  # by the next one, before it began
        self._place = np.flatnonzero(begins < replaced)
        self._begins = ticks[begins[self._place]]
        starts = references.start[self._place]
        self._starts = np.where(starts == NO_START, self._begins, starts)
        if len(received) and received[0] < N:
            self._held_from = int(ticks[received[0]])
            self._held = Frames.of([held(self._held_from)])
        self._trajectories: dict[int, Trajectory] = {}
        for k in np.flatnonzero(np.isin(self._place, [*references.trajectories])).tolist():
            last = self._of(k - 1, self._begins[k : k + 1]).frame(0)
            trajectory = references.trajectories[int(self._place[k])]
            late = float(self._begins[k] - self._starts[k]) / 1e9
            self._trajectories[k] = trajectory.from_frame(last, late)

    @property
    def knows_trajectories(self) -> bool:
        """Whether any motion that began was one, no set-point."""
        return bool(self._trajectories)

    def at(self, stamps: Stamps) -> Frames:
        """Return the frames at stamps (M,) [ns], increasing; none before the first is held."""
        found = Frames.nowhere(len(stamps))
        which = np.searchsorted(self._begins, stamps, side="right") - 1
        which[stamps < self._held_from] = -2
        apart = {-1, *self._trajectories} & set(np.unique(which).tolist())
        for k in apart:
            _put(found, which == k, self._of(k, stamps[which == k]))
        streamed = (which >= 0) & ~np.isin(which, list(apart))
        if streamed.any():
            _put(found, streamed, self._streamed(which[streamed], stamps[streamed]))
        return found

    def _of(self, k: int, stamps: Stamps) -> Frames:
        """Return the frames of the motion that began as number k; -1 is the pose that is held."""
        if k < 0:
            t = (stamps - self._held_from) / 1e9
            return moved(self._held.take(np.zeros(len(t), dtype=np.intp)), t, self._lasting)
        if k not in self._trajectories:
            return self._streamed(np.full(len(stamps), k), stamps)
        with np.errstate(over="ignore", invalid="ignore"):  # its rotation may be non-finite
            return Frames(*self._trajectories[k].samples((stamps - self._starts[k]) / 1e9))

    def _streamed(self, k: NDArray[np.intp], stamps: Stamps) -> Frames:
        """Return the frames of set-points, by their numbers (M,)."""
        dt = (stamps - self._starts[k]) / 1e9
        return moved(self._frames(self._place[k]), dt, self._lasting)


def _put(found: Frames, here: NDArray[np.bool_], frames: Frames) -> None:
    for column, values in zip(found.columns, frames.columns, strict=True):
        column[here] = values


def blocks(
    bag: Bag | str | PathLike[str],
    options: Options | None = None,
    size: int = 0,
    progress: Progress | None = None,
) -> Iterator[Recording]:
    """Yield the parts of a run, which share the sample at which one ends and the next begins.

    Args:
        bag: or its folder or file.
        options: what is to be read.
        size: joint_states in a part; 0 is all.
        progress: called now and then.

    Raises:
        BagError: if it is no bag, or holds no joint_states that are valid.
        RobotError: if the URDF does not fit.
    """
    bag = bag if isinstance(bag, Bag) else Bag(bag)
    return _Reader(bag, options or Options(), progress or (lambda _: None)).blocks(size)


def load(
    path: str | PathLike[str], urdf: str = "", tip_frame: str = "", **options: Any
) -> Recording:
    """Return the recording of a bag, read all at once.

    Args:
        path: folder or file of the bag.
        urdf: a URDF, its text or its path; "" takes the robot_description in the bag.
        tip_frame: the link to look at; "" takes that of the reference.
        options: see :class:`Options`.

    Raises:
        BagError: if it is no bag, or holds no joint_states.
        RobotError: if the URDF does not fit.
    """
    urdf = urdf if "<" in urdf or not urdf else read_urdf(urdf)
    (recording,) = blocks(path, Options(urdf=urdf, tip_frame=tip_frame, **options))
    return recording


class _Reader:
    """The topics of an arm, and the parts of its run."""

    def __init__(self, bag: Bag, options: Options, progress: Progress) -> None:
        self._bag, self._options, self._progress = bag, options, progress
        self._arm = arm = Arm(bag, options)
        kinds = RecordedTopic.registry
        self._topics = {name: kinds[name](bag, arm) for name in kinds if name in arm.topics}
        self._states = self._topics["joint_states"]
        self._departure = Departure()
        self._displacements: dict[str, Any] = {}
        self._read()
        self._start = self._states.stamp(0)
        begin, end = (
            min(self._start + round(1e9 * min(t, _LONGEST)), LATEST)
            for t in (options.start, options.end)
        )
        self._total = self._states.after(end) - self._states.after(begin - 1)
        self._fill_reports()
        self._desired = self._desired_frames()
        self._check()

    def _read(self) -> None:
        """Read the bag once, up to where the clock jumps, or to the end that is asked for."""
        by_topic = {self._arm.topics[name]: topic for name, topic in self._topics.items()}
        total = sum(self._bag.topics[topic].count for topic in by_topic)
        number, told, end, states = 0, 0, math.inf, self._states
        for batch in self._bag.batches(by_topic):
            for name, messages in batch.items():
                by_topic[name].add(messages)
                number += len(messages.data)
            if number >= told:
                self._progress(number / total / 2)
                told = number + _TOLD
            if len(states):
                end = states.stamp(0) + 1e9 * self._options.end + 2 * _ANSWERED
            if states.latest > end:
                break
        for topic in self._topics.values():
            topic.decode()
        until = LATEST if states.jumped is None else states.jumped
        for topic in self._topics.values():
            topic.settle(until)
        if not len(states):
            joints = ", ".join(self._arm.robot.joints)
            raise BagError(
                f"{self._bag.path}: no valid message of joint_states with the joints {joints}"
            )

    def _fill_reports(self) -> None:
        """Put the reports of the nodes on the time of the run."""
        said, options = self._topics.get(Diagnostics.name), self._options
        reports = said.reports if isinstance(said, Diagnostics) else Reports()
        stamps, sent = self._states.times()
        told = reports.told(sent, self._times(stamps), options.start, options.end)
        self._told, self._rates, self._delayed = told
        stops = {one.node: one for one in reversed(told.reports) if one.fault}
        self._stops = [
            BagWarning(BagFlaw.STOPPED, f"{one.node} stopped the arm at {one.t:.3f} s: {one.fault}")
            for one in sorted(stops.values())
        ]

    def _desired_frames(self) -> DesiredFrames:
        """Return the desired frames; references begin at the ticks of the controller."""
        commands = ("joint_reference", "joint_effort", "joint_states")
        ticking = next(name for name in commands if name in self._topics)
        said, sent = self._topics.get(Diagnostics.name), self._topics.get(SentReferences.name)
        none = np.zeros(0, np.int64)
        references = RecordedReferences(none, none, lambda _: Frames.nowhere(0), {})
        if isinstance(sent, SentReferences) and len(sent):
            start, times = sent.times()
            for news, stamp in (said.began if isinstance(said, Diagnostics) else {}).items():
                before = int(np.searchsorted(times, news, side="right"))
                if before:
                    start[before - 1] = stamp
            places = ((np.flatnonzero(times == at), m) for at, m in sent.trajectories.items())
            found = {k: motion for some, motion in places for k in some.tolist()}
            references = RecordedReferences(times, start, sent.frames, found)
        lasting = self._arm.lasting()
        return DesiredFrames(references, *self._topics[ticking].times(), lasting, self._pose)

    def _pose(self, stamp: int) -> DesiredFrame:
        """Return the pose of the tip that was measured at a stamp, or last before."""
        place = max(0, self._states.after(stamp) - 1)
        (q, _), n = self._states.rows(place, place + 1).values, self._arm.robot.n
        state = self._arm.robot.state(q[0], np.zeros(n))
        return DesiredFrame(state.p_e, state.R_e)

    @property
    def _follows_desired(self) -> bool:
        """Whether only ~/desired tells the desired frame: no reference was recorded in the time."""
        references, desired = (self._topics.get(n, ()) for n in (SentReferences.name, "desired"))
        return not len(references) and len(desired) > 0

    def _check(self) -> None:
        """Warn if a topic ends before joint_states, or a trajectory may be late."""
        if self._follows_desired:
            text = "no reference was recorded: errors are those against ~/desired"
            self._arm.warn(BagFlaw.INCOMPLETE, text)
        last = self._states.stamp(len(self._states) - 1)
        for name, topic in self._timed():
            latest = topic.stamp(len(topic) - 1) if len(topic) else None
            if latest is None and topic.latest >= 0:
                text = f"{name} has no stamp within those of joint_states"
                self._arm.warn(BagFlaw.INCOMPLETE, text)
            if topic.is_steady and latest is not None and latest < last - _ANSWERED:
                end, of = self._times(np.array([latest, last]))
                text = f"{name} ends at {end:.3f} s, joint_states at {of:.3f} s"
                self._arm.warn(BagFlaw.INCOMPLETE, text)
        # where ~/desired was recorded, it is known by how much
        is_late = self._delayed < math.inf and self._desired.knows_trajectories
        if is_late and "desired" not in self._topics:
            self._arm.warn(
                BagFlaw.DELAY,
                f"a motion that is slowed down or has to wait, first at {self._delayed:.3f}"
                " s, is compared with what was sent: from then on errors may be too large",
            )

    def _timed(self) -> Iterator[tuple[str, RecordedTopic]]:
        for name, topic in self._topics.items():
            if topic.is_timed and topic is not self._states:
                yield name, topic

    def blocks(self, size: int) -> Iterator[Recording]:
        """Yield the parts of the run."""
        first, last, options, given = 0, -1, self._options, False
        while last < len(self._states) - 1:
            last = self._end(first, size)
            begin, end = self._times(np.array([self._states.stamp(k) for k in (first, last)]))
            if begin > options.end:
                break
            for part in self._part(first, last):
                given = True
                yield part
            self._progress((1 + (last + 1) / len(self._states)) / 2)
            if end >= options.end:
                break
            first = last
        if not given:
            end = f"{options.start:g} to {options.end:g} s"
            raise BagError(f"{self._bag.path}: no joint_states from {end}")

    def _end(self, first: int, size: int) -> int:
        """Return with which state a part ends, that begins with another; they may be the same."""
        end = len(self._states) - 1
        if not size:
            return end
        last, stamp = first + size - 1, self._states.stamp(first)
        for _, topic in self._timed():
            place = topic.after(stamp) + _MOST * size
            if place < len(topic):
                last = min(last, self._states.after(topic.stamp(place)) - 1)
        return min(max(last, first + 1), end)

    def _part(self, first: int, last: int) -> Iterator[Recording]:
        """Yield the part from one state to another; nothing if it is not of the time asked for."""
        is_last = last == len(self._states) - 1
        begin, end = self._states.stamp(first), self._states.stamp(last)
        measured = self._states.rows(first, last + 1)
        taken: dict[str, Rows | None] = {}
        for name, topic in self._timed():
            at = max(0, topic.after(begin) - 1) if first else 0
            behind = len(topic) if is_last else topic.after(end)
            taken[name] = topic.rows(at, behind) if behind else None
        self._fill_velocities(measured, "joint_states")
        if commands := taken.get("joint_reference"):
            self._fill_velocities(commands, "joint_reference")
        stamps = [found.stamp for found in (*taken.values(), measured) if found is not None]
        own = np.unique(np.concatenate(stamps))
        frames = self._desired.at(own)
        if self._follows_desired and (made := taken.get("desired")):
            frames = Frames(*made.values).at(made.stamp, own)
        if shaped := taken.get("desired"):  # those before were in the last part
            shaped = shaped.take(shaped.stamp >= begin) if first else shaped
            taken["desired"] = self._within(shaped, "desired")
        inside = self._within(measured, "joint_states")
        until = math.inf if is_last else float(self._times(measured.stamp[-1:])[0])
        said = self._said(until if inside is not None else -math.inf)
        before = self._displacements
        whole = self._recording(measured, taken, own, frames, before, said)
        if inside is measured:
            yield whole
        elif inside is not None:
            taken = {name: self._within(found, name) for name, found in taken.items()}
            before = self._displacements_at(whole, self._options.start)
            yield self._recording(inside, taken, own, frames, before, said)
        if not is_last:
            self._displacements = self._displacements_at(whole, math.inf)

    def _said(self, end: float) -> tuple[list[Report], Array]:
        """Take out the reports up to an instant [s], and the rates of time."""
        n = bisect_right(self._told, end, key=lambda report: report.t)
        told, self._told = self._told[:n], self._told[n:]
        k = int(np.searchsorted(self._rates[:, 0], end, side="right"))
        rates, self._rates = self._rates[:k], self._rates[k:]
        return told, rates

    def _fill_velocities(self, found: Rows, name: str) -> None:
        """Take differences of the positions for velocities that are not there."""
        q, dq = found.values
        missing = ~np.isfinite(dq)
        if missing.any() and len(q) > 1:
            dq[missing] = np.gradient(q, found.stamp / 1e9, axis=0)[missing]
        elif missing.any():
            dq[missing] = 0.0
        if missing.any():
            text = f"{name} lacks velocities: differences of its positions are taken for them"
            self._arm.warn(BagFlaw.INCOMPLETE, text)

    def _recording(
        self,
        measured: Rows,
        taken: dict[str, Rows | None],
        own: Stamps,
        frames: Frames,
        before: dict[str, Any],
        said: tuple[list[Report], Array],
    ) -> Recording:
        fields: dict[str, Any] = {}
        others: dict[str, Any] = {}
        for name, rows in {"joint_states": measured, **taken}.items():
            if rows is not None:
                topic, t = self._topics[name], self._times(rows.stamp)
                made = topic.series(rows, t, frames.at(own, rows.stamp))
                (fields if topic.field else others)[topic.field or name] = made
        if shaped := fields.get("shaped"):
            unknown = Frames.nowhere(len(shaped.t))
            asked = unknown if self._follows_desired else shaped.asked
            fields["shaped"] = replace(shaped, asked=asked, rates=said[1])
            self._departure.take(fields["shaped"])
        return Recording(
            self._bag.path,
            self._arm.robot,
            self._arm.parameters,
            self._warnings(),
            urdf=self._arm.urdf,
            namespace=self._arm.namespace,
            before=before,
            options=self._arm.orientation,
            began=self._start,
            share=len(measured.stamp) / max(1, self._total),
            reports=said[0],
            others=others,
            **fields,
        )

    def _within(self, found: Rows | None, name: str) -> Rows | None:
        """Return what is of, or acts in, the time that is looked at; None if nothing is."""
        if found is None:
            return None
        t, start = self._times(found.stamp), self._options.start
        inside = (t >= start) & (t <= self._options.end)
        if self._topics[name].is_lasting:
            inside |= t == t.max(where=t <= start, initial=-math.inf)
        return found if inside.all() else found.take(inside) if inside.any() else None

    def _times(self, stamps: NDArray[np.int64]) -> Array:
        return (stamps - self._start) / 1e9

    def _displacements_at(self, recording: Recording, end: float) -> dict[str, Any]:
        """Return the last displacements before an instant [s]: the signs after it follow."""
        known = int(np.searchsorted(recording.leading.t[recording.known], end))
        if not known:
            return self._displacements
        return {
            name: sample(recording.displacements(name), known - 1)
            for name in OrientationRepresentation.registry
        }

    def _warnings(self) -> tuple[BagWarning, ...]:
        """Return what is wrong with the bag, as far as it was read."""
        found = []
        for name, topic in self._topics.items():
            if topic.invalid:
                found.append(f"{topic.invalid} messages of {name} are not valid and left out")
            if topic.repeated:
                found.append(f"{topic.repeated} messages of {name} have the stamp of another and "
                             "are left out")  # fmt: skip
        if self._states.jumped is not None:
            last = self._states.stamp(len(self._states) - 1)
            end = f"{self._times(np.array([last]))[0]:.3f} s"
            found.append(f"the stamps of joint_states jump back at {end}: the rest is left out")
        left_out = (BagWarning(BagFlaw.LEFT_OUT, text) for text in found)
        words = self._departure.words
        targets = (f"{self._arm.namespace}/{name}" for name in ("target_pose", "target_twist"))
        sent = [t for t in targets if t in self._bag.topics and self._bag.topics[t].count]
        if words and sent:
            words += f"; {' and '.join(sent)} led the arm, too, but do not count here"
        shaped = [BagWarning(BagFlaw.SHAPED, words)] if words else []
        return *self._stops, *self._bag.warnings, *left_out, *self._arm.flaws, *shaped


def read_urdf(path: str) -> str:
    """Return the text of a URDF; raises ConfigurationError if it cannot be read."""
    try:
        return urdf_text.read_urdf(Path(path))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"cannot read the URDF {path}: {error}") from error
