"""From a bag to a recording: each topic is read once into arrays."""

import math
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.arm import Arm, Options
from eulerparams_control.analysis.compliant import ActingImpedance, CompliantMotion, SensorSeries
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.reports import RunReports, reference_starts, run_reports
from eulerparams_control.analysis.series import (
    Efforts,
    Frames,
    Series,
    ShapedMotion,
    departure,
    moved,
)
from eulerparams_control.analysis.stacks import displacements
from eulerparams_control.analysis.topics import (
    LATEST,
    NO_START,
    TIMED,
    Diagnostics,
    RecordedReferences,
    RecordedTopic,
    Rows,
    SentReferences,
    Stamps,
)
from eulerparams_control.bags.format import BagFlaw, BagWarning
from eulerparams_control.bags.reader import Bag
from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.laws.orientation import OrientationRepresentation, representation
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot import urdf as urdf_file

_ANSWERED = 500_000_000  # [ns] within which the answers to a state are in the bag
_BLOCK = 20_000  # samples of which the kinematics are computed at once before the span


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
        return moved(self._frames.take(self._place[k]), dt, self._lasting)


def _put(found: Frames, here: NDArray[np.bool_], frames: Frames) -> None:
    for column, values in zip(found.columns, frames.columns, strict=True):
        column[here] = values


def load(
    bag: Bag | str | PathLike[str], urdf: str = "", tip_frame: str = "", **options: Any
) -> Recording:
    """Return the recording of an arm of a bag.

    Args:
        bag: or its folder or file.
        urdf: a URDF, its text or its path; "" takes the robot_description in the bag.
        tip_frame: the link to look at; "" takes that of the reference.
        options: see :class:`Options`.

    Raises:
        BagError: if it is no bag, or holds no joint_states that are valid.
        RobotError: if the URDF does not fit.
    """
    bag = bag if isinstance(bag, Bag) else Bag(bag)
    urdf = urdf if "<" in urdf or not urdf else read_urdf(urdf)
    return _Reader(bag, Options(urdf=urdf, tip_frame=tip_frame, **options)).recording()


class _Reader:
    """The topics of an arm."""

    def __init__(self, bag: Bag, options: Options) -> None:
        self._bag, self._options = bag, options
        self._arm = arm = Arm(bag, options)
        self._topics = {
            name: RecordedTopic(bag, arm.topics[name], arm.robot, kind.columns)
            for name, kind in TIMED.items()
            if name in arm.topics
        }
        self._sent = SentReferences(bag, arm.topics.get("reference", ""), arm.robot)
        self._diagnostics = Diagnostics(bag, arm.topics.get("diagnostics", ""), arm.others)
        self._read()
        self._jumped = self._topics["joint_states"].jump()
        for topic in (*self._topics.values(), self._sent):
            topic.settle(self._jumped)
        self._statuses = [one for one in self._diagnostics.statuses if one[0] < self._jumped]
        self._rows = {n: topic.rows for n, topic in self._topics.items() if topic.rows is not None}
        if "joint_states" not in self._rows:
            joints = ", ".join(arm.robot.joints)
            raise BagError(f"{bag.path}: no valid message of joint_states with the joints {joints}")
        self._states = self._rows["joint_states"]

    @property
    def _readers(self) -> dict[str, RecordedTopic | Diagnostics]:
        """By the names that the topics have here."""
        readers: dict[str, RecordedTopic | Diagnostics] = {
            **self._topics,
            "reference": self._sent,
            "diagnostics": self._diagnostics,
        }
        return {name: reader for name, reader in readers.items() if name in self._arm.topics}

    def _read(self) -> None:
        """Read the bag once, up to the end that is asked for."""
        states = self._topics["joint_states"]
        by_topic = {self._arm.topics[name]: reader for name, reader in self._readers.items()}
        for batch in self._bag.batches(by_topic):
            for topic, messages in batch.items():
                by_topic[topic].add(messages)
            if states.latest > states.first + 1e9 * self._options.end + 2 * _ANSWERED:
                break
        for reader in (*self._topics.values(), self._sent):
            reader.finish()

    def _times(self, stamps: Stamps) -> Array:
        """Return the times [s] from the beginning of the recording."""
        return (stamps - self._states.stamp[0]) / 1e9

    def recording(self) -> Recording:
        """Return the recording of the time that is asked for."""
        reports, start, end = self._reports(), self._options.start, self._options.end
        desired = self._desired_frames()
        self._check(reports, desired)
        for name in ("joint_states", "joint_reference"):
            self._fill_velocities(name)
        own = np.unique(np.concatenate([rows.stamp for rows in self._rows.values()]))
        frames = desired.at(own)
        if self._follows_desired:
            made = self._rows["desired"]
            frames = Frames(*made.values).at(made.stamp, own)
        states = self._within("joint_states")
        if states is None:
            raise BagError(f"{self._bag.path}: no joint_states from {start:g} to {end:g} s")
        if states is self._states:
            return self._recording(self._rows, own, frames, reports, {})
        inside = {name: self._within(name) for name in self._rows}
        rows = {name: found for name, found in inside.items() if found is not None}
        return self._recording(rows, own, frames, reports, self._displacements_before(own, frames))

    def _displacements_before(self, own: Stamps, frames: Frames) -> dict[str, Any]:
        """Return the last displacements before the time that is asked for: signs follow them."""
        leading = self._rows.get("joint_reference", self._states)
        earlier = leading.take(self._times(leading.stamp) < self._options.start)
        desired, (q, dq) = frames.at(own, earlier.stamp), earlier.values
        known = np.flatnonzero(desired.known)
        before: dict[str, Any] = {}
        for first in range(0, len(known), _BLOCK):
            some = known[first : first + _BLOCK]
            with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
                R_d, R_e = desired.R[some], self._arm.robot.states(q[some], dq[some]).R_e
                for name in OrientationRepresentation.registry:
                    orientation = representation(name, self._arm.orientation)
                    for x_de in displacements(orientation, R_d, R_e, before.get(name)):
                        before[name] = x_de
        return before

    def _reports(self) -> RunReports:
        """Return the reports of the nodes by the time of the run."""
        controller = self._arm.topics.get("desired", "").rpartition("/")[0].strip("/")
        times, span = self._times(self._states.stamp), (self._options.start, self._options.end)
        return run_reports(self._statuses, controller, self._states.sent, times, *span)

    def _desired_frames(self) -> DesiredFrames:
        """Return the desired frames; references begin at the ticks of the controller."""
        commands = ("joint_reference", "joint_effort", "joint_states")
        ticks = self._rows.get(next(name for name in commands if name in self._topics), Rows.none())
        references = self._sent.references(reference_starts(self._statuses, self._arm.namespace))
        return DesiredFrames(references, ticks.stamp, ticks.sent, self._arm.lasting(), self._pose)

    def _pose(self, stamp: int) -> DesiredFrame:
        """Return the pose of the tip that was measured at a stamp, or last before."""
        place = max(0, int(np.searchsorted(self._states.stamp, stamp, side="right")) - 1)
        state = self._arm.robot.state(self._states.values[0][place], np.zeros(self._arm.robot.n))
        return DesiredFrame(state.p_e, state.R_e)

    @property
    def _follows_desired(self) -> bool:
        """Whether only ~/desired tells the desired frame: no reference was recorded in the time."""
        return not self._sent.rows and "desired" in self._rows

    def _check(self, reports: RunReports, desired: DesiredFrames) -> None:
        """Warn if a topic ends before joint_states, or a trajectory may be late."""
        if self._follows_desired:
            text = "no reference was recorded: errors are those against ~/desired"
            self._arm.warn(BagFlaw.INCOMPLETE, text)
        last = self._states.stamp[-1]
        for name, topic in self._topics.items():
            if topic.rows is None and topic.latest >= 0:
                text = f"{name} has no stamp within those of joint_states"
                self._arm.warn(BagFlaw.INCOMPLETE, text)
            elif topic.rows is not None and TIMED[name].is_steady:
                latest = topic.rows.stamp[-1]
                if latest < last - _ANSWERED:
                    end, of = self._times(np.array([latest, last]))
                    text = f"{name} ends at {end:.3f} s, joint_states at {of:.3f} s"
                    self._arm.warn(BagFlaw.INCOMPLETE, text)
        # where ~/desired was recorded, it is known by how much
        is_late = reports.delayed < math.inf and desired.knows_trajectories
        if is_late and "desired" not in self._topics:
            self._arm.warn(
                BagFlaw.DELAY,
                f"a motion that is slowed down or has to wait, first at {reports.delayed:.3f}"
                " s, is compared with what was sent: from then on errors may be too large",
            )

    def _fill_velocities(self, name: str) -> None:
        """Take differences of the positions for velocities that are not there."""
        if name not in self._rows:
            return
        q, dq = self._rows[name].values
        missing = ~np.isfinite(dq)
        if not missing.any():
            return
        times = self._rows[name].stamp / 1e9
        dq[missing] = np.gradient(q, times, axis=0)[missing] if len(q) > 1 else 0.0
        text = f"{name} lacks velocities: differences of its positions are taken for them"
        self._arm.warn(BagFlaw.INCOMPLETE, text)

    def _within(self, name: str) -> Rows | None:
        """Return what is of, or acts in, the time that is asked for; None if nothing is."""
        found = self._rows[name]
        t, start = self._times(found.stamp), self._options.start
        inside = (t >= start) & (t <= self._options.end)
        if name == "impedance":  # one acts until the next one
            inside |= t == t.max(where=t <= start, initial=-math.inf)
        return found if inside.all() else found.take(inside) if inside.any() else None

    def _recording(
        self,
        rows: Mapping[str, Rows],
        own: Stamps,
        desired: Frames,
        reports: RunReports,
        before: Mapping[str, Any],
    ) -> Recording:
        """Return the recording of some rows, given the desired frames at the stamps of all."""
        fields: dict[str, Any] = {}
        robot = self._arm.robot
        for name, found in rows.items():
            t, values = self._times(found.stamp), found.values
            at = desired.at(own, found.stamp)
            match name:
                case "joint_states":
                    fields["measured"] = Series(robot, t, values[0], values[1], at)
                case "joint_reference":
                    fields["command"] = Series(robot, t, values[0], values[1], at)
                case "joint_effort":
                    fields["effort"] = Efforts(t, *values)
                case "wrench":
                    fields["sensed"] = SensorSeries(t, *values)
                case "target_wrench":
                    fields["targets"] = SensorSeries(t, *values)
                case "impedance":
                    fields["acting"] = ActingImpedance(t, *values)
                case "compliant_frame":
                    fields["compliant"] = CompliantMotion(t, Frames(*values), at)
                case "desired":
                    asked = Frames.nowhere(len(t)) if self._follows_desired else at
                    fields["shaped"] = ShapedMotion(t, asked, Frames(*values), reports.rates)
        return Recording(
            self._bag.path,
            robot,
            self._arm.parameters,
            self._warnings(reports, fields.get("shaped")),
            urdf=self._arm.urdf,
            namespace=self._arm.namespace,
            options=self._arm.orientation,
            before=before,
            began=int(self._states.stamp[0]),
            reports=reports.reports,
            stopped=reports.stopped,
            **fields,
        )

    def _warnings(self, reports: RunReports, shaped: ShapedMotion | None) -> tuple[BagWarning, ...]:
        """Return what is wrong with the bag, as far as it was read."""
        faults = {one.node: one for one in reversed(reports.reports) if one.fault}
        stops = [
            BagWarning(BagFlaw.STOPPED, f"{one.node} stopped the arm at {one.t:.3f} s: {one.fault}")
            for one in sorted(faults.values())
        ]
        found = []
        for name, topic in self._readers.items():
            if topic.invalid:
                found.append(f"{topic.invalid} messages of {name} are not valid and left out")
            if topic.repeated:
                found.append(f"{topic.repeated} messages of {name} have the stamp of another and "
                             "are left out")  # fmt: skip
        if self._jumped < LATEST:
            end = f"{self._times(self._states.stamp)[-1]:.3f} s"
            found.append(f"the stamps of joint_states jump back at {end}: the rest is left out")
        left_out = (BagWarning(BagFlaw.LEFT_OUT, text) for text in found)
        words = "" if shaped is None else departure(shaped)
        targets = (f"{self._arm.namespace}/{name}" for name in ("target_pose", "target_twist"))
        sent = [t for t in targets if t in self._bag.topics and self._bag.topics[t].count]
        if words and sent:
            words += f"; {' and '.join(sent)} led the arm, too, but do not count here"
        differs = [BagWarning(BagFlaw.SHAPED, words)] if words else []
        return *stops, *self._bag.warnings, *left_out, *self._arm.flaws, *differs


def read_urdf(path: str) -> str:
    """Return the text of a URDF; raises ConfigurationError if it cannot be read."""
    try:
        return urdf_file.read_urdf(Path(path))
    except OSError as error:
        raise ConfigurationError(f"cannot read the URDF {path}: {error}") from error
