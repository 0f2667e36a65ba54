"""From a bag to recordings: all at once, or one part after the other in bounded memory."""

import math
from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.arm import Arm, Options
from eulerparams_control.analysis.compliant import CompliantMotion, SensorSeries
from eulerparams_control.analysis.desired import DesiredFrames
from eulerparams_control.analysis.frames import Frames
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.reports import Report, Reports
from eulerparams_control.analysis.series import Departure, Efforts, Series, ShapedMotion
from eulerparams_control.analysis.topics import (
    LATEST,
    Diagnostics,
    Queue,
    Rows,
    SentReferences,
    no_references,
)
from eulerparams_control.bags.format import BagFlaw, BagWarning
from eulerparams_control.bags.reader import Bag
from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.laws.compiled import sample
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import DesiredFrame

_ANSWERED = 500_000_000  # [ns] by which the answers to a state are in the bag
_MOST = 10  # messages of all topics in a part, for each state that it was to have

BLOCK = 20_000
"""Samples of a part: some seconds of motion, some 100 MB of memory."""


Progress = Callable[[float], None]
"""Is told the part of the bag that was read, 0 to 1."""


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
    """One pass over the topics of an arm."""

    def __init__(self, bag: Bag, options: Options, progress: Progress) -> None:
        self._bag, self._options, self._progress = bag, options, progress
        self._arm = arm = Arm(bag, options)
        controller = arm.topics.get("desired", "").rpartition("/")[0]
        self._reports = Reports(options.start, options.end, controller)
        self._rates, self._departure = np.zeros((0, 4)), Departure()
        there = arm.topics
        self._sent = SentReferences(bag, arm) if SentReferences.name in there else None
        self._said = Diagnostics(bag, arm, self._reports) if Diagnostics.name in there else None
        self._queues = {
            name: kind(bag, arm)
            for name, kind in Queue.registry.items() if kind.is_timed and name in there
        } | {queue.name: queue for queue in (self._sent, self._said) if queue}  # fmt: skip
        self._desired = DesiredFrames(arm.lasting(), self._measured_pose)
        self._end_of_part = -math.inf
        self._jumped = False
        self._latest: dict[str, int] = {}  # stamp of each topic
        self._last_desired: tuple[NDArray[np.int64], Frames] | None = None
        self._displacements: dict[str, Any] = {}
        self._start: int | None = None
        self._told: list[Report] = []  # what nodes said in this part

    def blocks(self, size: int) -> Iterator[Recording]:
        """Yield the parts of the run."""
        by_topic = {self._arm.topics[name]: queue for name, queue in self._queues.items()}
        states, ends = self._arm.topics["joint_states"], _Ends(size)
        total = sum(self._bag.topics[topic].count for topic in by_topic)
        given = False
        for number, message in enumerate(self._bag.read_raw(by_topic)):
            if message.topic in by_topic:  # else its name is damaged
                by_topic[message.topic].add(message)
            if ends.see(message.log_time, message.topic == states):
                self._progress(number / total)
                for part in self._part(ends.count(), last=False):
                    given = True
                    yield part
                if self._is_over():
                    break
        for part in self._part(None, last=True):
            given = True
            yield part
        if not given:
            raise BagError(self._why_nothing())

    def _why_nothing(self) -> str:
        options = self._options
        if self._start is None:
            joints = ", ".join(self._arm.robot.joints)
            return f"{self._bag.path}: no valid message of joint_states with the joints {joints}"
        return f"{self._bag.path}: no joint_states from {options.start:g} to {options.end:g} s"

    def _is_over(self) -> bool:
        return self._end_of_part >= self._options.end or self._jumped

    def _end_where_the_clock_jumps(self) -> None:
        """Leave out what was sent after the stamps of joint_states jumped back."""
        states = self._queues["joint_states"]
        states.settle()
        if (jumped := states.jumped) is None or self._jumped:
            return
        self._jumped = True
        for queue in self._queues.values():
            queue.drop_after(jumped)
        self._reports.drop_after(jumped)

    def _part(self, count: int | None, last: bool) -> Iterator[Recording]:
        """Yield the part with the next ``count`` states, None: with all; nothing if it is empty."""
        states = self._queues["joint_states"]
        stamp = LATEST if count is None else states.nth(count)
        self._end_where_the_clock_jumps()
        stamp, last = (LATEST, True) if self._jumped else (stamp, last)
        measured = states.until(stamp)
        if measured is None:
            return
        if self._start is None:
            self._start = int(measured.stamp[0])
        taken = {name: queue.until(stamp) for name, queue in self._given()}
        found = {name: rows.stamp[-1] for name, rows in taken.items() if rows is not None}
        self._latest |= {name: int(latest) for name, latest in found.items()}
        self._measured = measured
        self._fill_velocities(measured, "joint_states")
        if commands := taken.get("joint_reference"):
            self._fill_velocities(commands, "joint_reference")
        own, frames = self._desired_at(taken, measured)
        t = self._times(measured.stamp)
        self._end_of_part = float(t[-1])
        if t[0] > self._options.end:
            return
        if last:
            self._check_the_ends(measured)
        self._told = self._reports.take(measured.sent, t, last)
        self._rates = self._reports.take_rates(measured.sent, t, last)
        self._warn_of_delay()
        whole = self._recording(measured, taken, own, frames)
        inside = self._within(measured)
        if inside is measured:
            yield whole
        elif inside is not None:
            taken = {name: self._within(found) for name, found in taken.items()}
            before = self._displacements_at(whole, self._options.start)
            yield self._recording(inside, taken, own, frames, before)
        if not last:
            self._displacements = self._displacements_at(whole, math.inf)

    def _warn_of_delay(self) -> None:
        """Say from when on a trajectory is later than it was sent to be; set-points are not.

        Where ~/desired was recorded, it is known by how much.
        """
        if "desired" in self._arm.topics:
            return
        if self._reports.delayed < math.inf and self._desired.knows_trajectories:
            self._arm.warn(
                BagFlaw.DELAY,
                f"a motion that is slowed down or has to wait, first at {self._reports.delayed:.3f}"
                " s, is compared with what was sent: from then on errors may be too large",
            )

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

    def _check_the_ends(self, measured: Rows) -> None:
        """Warn if a topic ends before joint_states, or does not have its time."""
        for name, queue in self._given():
            latest = self._latest.get(name)
            if latest is None and queue.has_any:
                text = f"{name} has no stamp within those of joint_states"
                self._arm.warn(BagFlaw.INCOMPLETE, text)
            if name == "desired":  # none while a fault lasts
                continue
            if latest is not None and latest < measured.stamp[-1] - _ANSWERED:
                end, of = self._times(np.array([latest, measured.stamp[-1]]))
                text = f"{name} ends at {end:.3f} s, joint_states at {of:.3f} s"
                self._arm.warn(BagFlaw.INCOMPLETE, text)

    def _given(self) -> Iterator[tuple[str, Queue]]:
        for name, queue in self._queues.items():
            if queue.is_timed and name != "joint_states":
                yield name, queue

    def _desired_at(
        self, taken: dict[str, Rows | None], measured: Rows
    ) -> tuple[NDArray[np.int64], Frames]:
        """Return stamps at which the desired frame is known, and the frames.

        RecordedReferences begin at the commands, the ticks of the controller, if there are some.
        """
        overlap = self._last_desired
        commands = ("joint_reference", "joint_effort")
        ticking = next((name for name in commands if name in self._queues), "")
        ticks = taken.get(ticking) if ticking else measured
        ticks = measured.take(np.zeros(0, dtype=int)) if ticks is None else ticks
        rest = [found.stamp for found in (*taken.values(), measured) if found is not None]
        at = np.unique(np.concatenate(rest))
        if overlap is not None:
            ticks = ticks.take(ticks.stamp > overlap[0][-1])
            at = at[at > overlap[0][-1]]
        began: dict[int, int] = {}
        if self._said:
            self._said.settle()
            began = self._said.began
        references = self._sent.all(began) if self._sent else no_references()
        frames, done = self._desired.follow(references, ticks.stamp, ticks.sent, at)
        if self._sent:
            self._sent.forget(done)
        own = at
        if overlap is not None:
            own = np.concatenate([overlap[0], own])
            frames = Frames(
                *map(np.concatenate, zip(overlap[1].columns, frames.columns, strict=True))
            )
        self._last_desired = own[-1:], frames.take(np.arange(len(own))[-1:])
        return own, frames

    def _measured_pose(self, stamp: int) -> DesiredFrame:
        """Return the pose of the tip that was measured at a stamp, or last before."""
        index = max(0, int(np.searchsorted(self._measured.stamp, stamp, side="right")) - 1)
        q, dq = (values[index] for values in self._measured.values)
        state = self._arm.robot.state(q, dq)
        return DesiredFrame(state.p_e, state.R_e)

    def _recording(
        self,
        measured: Rows,
        taken: dict[str, Rows | None],
        own: NDArray[np.int64],
        frames: Frames,
        before: dict[str, Any] | None = None,
    ) -> Recording:
        def series(found: Rows | None) -> Series | None:
            if found is None:
                return None
            q, dq = found.values
            there = frames.at(own, found.stamp)
            return Series(self._arm.robot, self._times(found.stamp), q, dq, there)

        motion = series(measured)
        assert motion is not None
        efforts = sensed = compliant = None
        if found := taken.get("joint_effort"):
            efforts = Efforts(self._times(found.stamp), found.values[0])
        if found := taken.get("wrench"):
            sensed = SensorSeries(self._times(found.stamp), *found.values)
        if found := taken.get("compliant_frame"):
            there = frames.at(own, found.stamp)
            compliant = CompliantMotion(self._times(found.stamp), Frames(*found.values), there)
        shaped = self._shaped(self._within(taken.get("desired")), own, frames)
        return Recording(
            self._bag.path,
            self._arm.robot,
            motion,
            series(taken.get("joint_reference")),
            efforts,
            self._arm.parameters,
            self._warnings(),
            sensed=sensed,
            compliant=compliant,
            urdf=self._arm.urdf,
            namespace=self._arm.namespace,
            before=self._displacements if before is None else before,
            options=self._arm.orientation,
            began=self._start or 0,
            reports=self._told,
            shaped=shaped,
        )

    def _shaped(
        self, found: Rows | None, own: NDArray[np.int64], frames: Frames
    ) -> ShapedMotion | None:
        if found is None:
            return None
        found = found.take(found.stamp >= own[0])  # those before were in the last part
        made, asked = Frames(*found.values), frames.at(own, found.stamp)
        shaped = ShapedMotion(self._times(found.stamp), asked, made, self._rates)
        self._departure.take(shaped)
        return shaped

    def _within(self, found: Rows | None) -> Rows | None:
        """Return what is within the time that is looked at; None if nothing is."""
        if found is None:
            return None
        t = self._times(found.stamp)
        inside = (t >= self._options.start) & (t <= self._options.end)
        return found if inside.all() else found.take(inside) if inside.any() else None

    def _times(self, stamps: NDArray[np.int64]) -> Array:
        return (stamps - (self._start or 0)) / 1e9

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
        for name, queue in self._queues.items():
            if queue.invalid:
                found.append(f"{queue.invalid} messages of {name} are not valid and left out")
            if queue.repeated:
                found.append(f"{queue.repeated} messages of {name} have the stamp of another and "
                             "are left out")  # fmt: skip
        if self._jumped:
            end = f"{self._end_of_part:.3f} s"
            found.append(f"the stamps of joint_states jump back at {end}: the rest is left out")
        left_out = (BagWarning(BagFlaw.LEFT_OUT, text) for text in found)
        words = self._departure.words
        shaped = [BagWarning(BagFlaw.SHAPED, words)] if words else []
        return *self._bag.warnings, *left_out, *self._arm.flaws, *shaped


class _Ends:
    """When a part is complete: its states are there, and the answers to them.

    Args:
        size: states of a part; 0 is all.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._states = self._others = self._states_at = 0
        self._at: int | None = None

    def see(self, log_time: int, is_state: bool) -> bool:
        """Count a message; return whether the part is complete."""
        self._states += is_state
        self._others += not is_state
        full = self._states >= self._size or self._others >= _MOST * self._size
        if self._size and self._at is None and full and self._states > 1:
            self._at, self._states_at = log_time, self._states
        return self._at is not None and log_time > self._at + _ANSWERED

    def count(self) -> int:
        """Return the states of the part that is complete, and begin the next."""
        self._states -= self._states_at
        self._others, self._at = 0, None
        return self._states_at


def read_urdf(path: str) -> str:
    """Return the text of a URDF; raises ConfigurationError if it cannot be read."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"cannot read the URDF {path}: {error}") from error
