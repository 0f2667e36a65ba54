"""From the messages of an arm to rows of numbers, topic by topic."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis import decode
from eulerparams_control.analysis.arm import Arm
from eulerparams_control.analysis.decode import Rows
from eulerparams_control.analysis.desired import NO_START
from eulerparams_control.analysis.reports import Reports
from eulerparams_control.analysis.topic_buffer import LATEST, Parse
from eulerparams_control.bags.columns import Group, columns
from eulerparams_control.bags.reader import Bag, RawMessage
from eulerparams_control.errors import BagError, InvalidMessageError
from eulerparams_control.messages.keys import BEGAN
from eulerparams_control.motion.trajectories import Trajectory

_MOVING = ("joint_states", "joint_reference")  # of which a velocity may be missing


class Parsers:
    """Parsers of the messages of each topic of an arm.

    Args:
        bag: the bag.
        arm: of which the topics are.
        reports: takes what its nodes say of themselves.

    Attributes:
        trajectories: references that are no set-points, by time of sending [ns].
        began: stamps [ns] at which a controller said that a reference began, by the time of
            sending of the news.
    """

    def __init__(self, bag: Bag, arm: Arm, reports: Reports) -> None:
        self._bag, self._topics, self._robot = bag, arm.topics, arm.robot
        self._namespace, self._others, self._reports = arm.namespace, arm.others, reports
        self.trajectories: dict[int, Trajectory] = {}
        self.began: dict[int, int] = {}
        self._begins: set[str] = set()

    def all(self) -> dict[str, Parse]:
        """Return what parses each of the topics."""
        joints = self._robot.joints
        base, tip = self._robot.base_frame, self._robot.tip_frame
        moving, pulling = ("position", "velocity"), ("effort",)
        of_group: dict[str, Callable[[Group], list[NDArray[Any]]]] = {
            "joint_states": lambda group: list(decode.joint_rows(group, joints, moving)),
            "joint_reference": lambda group: list(decode.joint_rows(group, joints, moving)),
            "joint_effort": lambda group: list(decode.joint_rows(group, joints, pulling)),
            "wrench": decode.wrench_rows,
            "desired": lambda group: list(decode.frame_rows(group, base, tip)),
            "compliant_frame": lambda group: list(decode.frame_rows(group, base, tip)),
        }
        parsers = {
            name: self._parser(name, of) for name, of in of_group.items() if name in self._topics
        }
        for name in ("reference", "diagnostics"):
            if name in self._topics:
                parsers[name] = getattr(self, f"_{name}")
        return parsers

    def _groups(self, name: str, messages: list[RawMessage]) -> Iterator[Group]:
        schema = self._bag.schema(self._topics[name])
        return columns(schema, [message.data for message in messages])

    def _parser(self, name: str, of: Callable[[Group], list[NDArray[Any]]]) -> Parse:
        def parse(messages: list[RawMessage]) -> tuple[list[Rows], int]:
            sent = np.array([message.publish_time or message.log_time for message in messages])
            found, valid = [], 0
            for group in self._groups(name, messages):
                try:
                    values = of(group)
                except InvalidMessageError:
                    continue
                good = decode.finite(values[:1] if name in _MOVING else values)
                all_rows = Rows(decode.stamps(group), sent[group.index], tuple(values))
                found.append(all_rows if good.all() else all_rows.take(good))
                valid += int(good.sum())
            return found, len(messages) - valid

        return parse

    def _reference(self, messages: list[RawMessage]) -> tuple[list[Rows], int]:
        """Return start and first frame of references; their trajectories are kept aside."""
        base, tip = self._robot.base_frame, self._robot.tip_frame
        found, valid = [], 0
        sent = np.array([message.publish_time or message.log_time for message in messages])
        for group in self._groups("reference", messages):
            if decode.is_set_point(group) and not _later(group).any():
                try:
                    values = decode.frame_rows(group, base, tip)
                except InvalidMessageError:
                    continue
                good = decode.finite(values)
                starts = np.where(decode.stamps(group) > 0, decode.stamps(group), NO_START)
                found.append(Rows(starts, sent[group.index], tuple(values)).take(good))
                valid += int(good.sum())
                continue
            for index in group.index.tolist():
                one = self._one_reference(messages[index], int(sent[index]))
                found += one
                valid += len(one)
        return found, len(messages) - valid

    def _one_reference(self, message: RawMessage, sent: int) -> list[Rows]:
        try:
            decoded = self._bag.decode(message)
            start, frame, trajectory = decode.motion(
                decoded, self._robot.base_frame, self._robot.tip_frame
            )
        except (InvalidMessageError, BagError):
            return []  # the controller refused it too
        if trajectory is not None:
            self.trajectories[sent] = trajectory
        return [Rows(np.array([start]), np.array([sent]), frame.columns)]

    def _diagnostics(self, messages: list[RawMessage]) -> tuple[list[Rows], int]:
        """Keep what the nodes say, and when a controller said that a reference began."""
        invalid = 0
        for message in messages:
            try:
                decoded = self._bag.decode(message)
            except BagError:
                invalid += 1
                continue
            sent = message.publish_time or message.log_time
            for status in decoded.status:
                of = f"/{status.name.lstrip('/')}".rpartition("/")[0]
                if of == self._namespace:
                    self._note(status, sent)
                if not any(self._is_of(other, of) for other in self._others):
                    self._reports.add(status, sent)
        return [], invalid

    @staticmethod
    def _is_of(arm: str, namespace: str) -> bool:
        """Whether what is in a namespace is of an arm; one without has only what is in none."""
        return namespace == arm or (arm != "" and namespace.startswith(f"{arm}/"))

    def _note(self, status: Any, sent: int) -> None:
        for value in status.values:
            if value.key == BEGAN and value.value not in self._begins and _is_stamp(value.value):
                self._begins.add(value.value)
                self.began[sent] = int(value.value)


def _is_stamp(text: str) -> bool:
    """Return whether a text is a time [ns] as stamps have it."""
    return text.isascii() and text.isdecimal() and len(text) <= 19 and int(text) < LATEST


def _later(group: Group) -> NDArray[np.bool_]:
    """Return which set-points are to be reached later (N,)."""
    seconds = group.numbers["points[0].time_from_start.sec"]
    return (seconds > 0) | (group.numbers["points[0].time_from_start.nanosec"] > 0)
