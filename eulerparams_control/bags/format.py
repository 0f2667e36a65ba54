"""The words of a rosbag2 bag, version 9: metadata.yaml, as Jazzy writes it.

A bag is a folder with ``metadata.yaml`` and MCAP files.  The same metadata, without its
outer key, is in each file as records named ``rosbag2``.

Its YAML may come from anyone, and is read as plain data of bounded size, nothing else: a few
lines can expand to more data than there is memory, by aliases of aliases, also in merge keys; a
tag can make an object of any class; a collection can contain itself.
"""

import dataclasses
import json
import os
from collections.abc import Iterable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from eulerparams_control.errors import BagError

_LONGEST = 4_000_000  # characters: PyYAML takes a second for 100,000
_MOST = 400_000  # values, those of aliases counted at each of their places

_PLAIN = ("null", "bool", "int", "float", "str", "seq", "map", "merge")
_TAG = "tag:yaml.org,2002:"

METADATA_FILE = "metadata.yaml"
METADATA_RECORD = "rosbag2"
METADATA_KEY = "serialized_metadata"
PARAMETERS_ATTACHMENT = "parameters.yaml"

_OUTER_KEY = "rosbag2_bagfile_information"
_VERSION = 9
_LONGEST_REASON = 500  # characters of what the parser quotes
_LARGEST = 4_000_000  # bytes of metadata.yaml: some of each topic
_NEVER = 2**63 - 1  # the starting time of a bag without messages


class BagFlaw(StrEnum):
    """Kind of a flaw of a bag."""

    UNFINISHED = "unfinished"  # a file has no end: its recorder was killed
    DAMAGED = "damaged"  # a part of a file cannot be read
    LEFT_OUT = "left_out"  # messages that cannot be used
    INCOMPLETE = "incomplete"  # a topic ends early, or lacks values
    PARAMETERS = "parameters"  # of a node are not valid
    FRAMES = "frames"  # of the reference are others: errors are not known
    DELAY = "delay"  # the motion came later than it was sent to be
    STOPPED = "stopped"  # a node stopped the arm because of a fault
    SHAPED = "shaped"  # the motion was made to differ from what was asked


class BagWarning(NamedTuple):
    """A flaw of a bag: its kind, and its description."""

    kind: BagFlaw
    text: str


def in_words(warnings: Iterable[BagWarning]) -> str:
    """Return the descriptions in one line; "" if there are none."""
    return "; ".join(warning.text for warning in warnings)


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Reads scalars as JSON has them; others, such as dates, stay text."""


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag.removeprefix(_TAG) in _PLAIN]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.yaml_constructors = {
    tag: constructor
    for tag, constructor in yaml.SafeLoader.yaml_constructors.items()
    if tag is None or tag.removeprefix(_TAG) in _PLAIN
}


def _plain(text: str) -> Any:
    """Return the only document of a YAML text; raises any error if it is none, or too large."""
    if len(text) > _LONGEST:
        raise ValueError(f"{len(text)} characters; expected at most {_LONGEST}")
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        if _size(node, {}) > _MOST:
            raise ValueError(f"its aliases stand for more than {_MOST} values")
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _size(node: yaml.Node, known: dict[int, int]) -> int:
    """Return to how many values a node expands; ``known`` has those of other nodes."""
    if id(node) not in known:
        known[id(node)] = -1  # until it is known: who meets it again is within it
        known[id(node)] = 1 + sum(_size(child, known) for child in _children(node))
    if known[id(node)] < 0:
        raise ValueError("a collection contains itself")
    return known[id(node)]


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [child for pair in node.value for child in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


@dataclasses.dataclass(frozen=True)
class Topic:
    """One recorded topic.

    Args:
        name: with its namespace, ``/joint_states``.
        type: ``sensor_msgs/msg/JointState``.
        type_hash: ``RIHS01_...``, or empty if unknown.
        qos_profiles: one for each publisher, in the words of metadata version 9.
    """

    name: str
    type: str
    type_hash: str = ""
    qos_profiles: tuple[Mapping[str, Any], ...] = ()
    serialization_format: str = "cdr"


@dataclasses.dataclass
class FileContents:
    """Contents of one file of a bag; times are log times in nanoseconds."""

    name: str
    topics: dict[str, Topic] = dataclasses.field(default_factory=dict)
    counts: dict[str, int] = dataclasses.field(default_factory=dict)
    start: int = _NEVER
    end: int = 0

    @property
    def message_count(self) -> int:
        """Number of messages on all topics."""
        return sum(self.counts.values())


def bag_information(files: Iterable[FileContents]) -> dict[str, Any]:
    """Return the metadata of the bag that consists of ``files``."""
    files = list(files)
    topics = {name: topic for file in files for name, topic in file.topics.items()}
    return {
        "version": _VERSION,
        "storage_identifier": "mcap",
        **_times(files),
        "message_count": sum(file.message_count for file in files),
        "topics_with_message_count": [
            {
                "topic_metadata": _topic_metadata(topic),
                "message_count": sum(file.counts.get(name, 0) for file in files),
            }
            for name, topic in topics.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {"path": file.name, **_times([file]), "message_count": file.message_count}
            for file in files
        ],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def _times(files: list[FileContents]) -> dict[str, dict[str, int]]:
    start = min((file.start for file in files), default=_NEVER)
    end = max((file.end for file in files), default=0)
    return {
        "duration": {"nanoseconds": max(0, end - start)},
        "starting_time": {"nanoseconds_since_epoch": start},
    }


def _topic_metadata(topic: Topic) -> dict[str, Any]:
    return {
        "name": topic.name,
        "type": topic.type,
        "serialization_format": topic.serialization_format,
        "offered_qos_profiles": [dict(profile) for profile in topic.qos_profiles],
        "type_description_hash": topic.type_hash,
    }


def write_metadata(folder: Path, information: Mapping[str, Any]) -> None:
    """Write ``metadata.yaml`` whole or not at all.

    Raises:
        OSError: if the disk is full or not writable.
    """
    part = folder / f".{METADATA_FILE}.part"
    part.write_text(dump_yaml({_OUTER_KEY: dict(information)}), encoding="utf-8")
    os.replace(part, folder / METADATA_FILE)


def read_metadata(folder: Path) -> dict[str, Any]:
    """Return what ``metadata.yaml`` says, of whatever version.

    Raises:
        BagError: if it is missing, is no YAML, or is not about a bag.
    """
    path = folder / METADATA_FILE
    try:
        if path.exists() and not path.is_file():
            raise OSError("it is no file")
        with open(path, "rb") as file:
            text = file.read(_LARGEST + 1)[: _LARGEST + 1].decode()
    except (OSError, UnicodeDecodeError) as error:
        reason = "it is missing" if isinstance(error, FileNotFoundError) else str(error)
        raise BagError(
            f"{path} cannot be read: {reason}; bag_recorder --recover rebuilds it"
        ) from error
    document = load_yaml(text, str(path))
    information = document.get(_OUTER_KEY) if isinstance(document, dict) else None
    if not isinstance(information, dict):
        raise BagError(f"{path} has no '{_OUTER_KEY}'; bag_recorder --recover rebuilds it")
    return information


def dump_yaml(value: Any) -> str:
    """Return ``value``, of plain types with text as keys, as block YAML, keys in their order."""
    unshared = json.loads(json.dumps(value))  # YAML would write anchors for shared objects
    text: str = yaml.safe_dump(unshared, sort_keys=False, allow_unicode=True)
    return text


def load_yaml(text: str, source: str) -> Any:
    """Return what the YAML ``text`` says; plain data only, nothing is executed.

    Raises:
        BagError: if it is no YAML; names ``source``.
    """
    try:
        return _plain(text)
    except Exception as error:  # PyYAML leaks a dozen types on odd tags and deep nesting
        reason = " ".join(str(error).split())
        raise BagError(f"{source} is not valid YAML: {reason[:_LONGEST_REASON]}") from error
