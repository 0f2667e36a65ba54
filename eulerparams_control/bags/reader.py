"""Read a bag without ROS: a folder, an MCAP file, or what a killed recorder left."""

import dataclasses
import os
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from eulerparams_control.bags.columns import check, check_schema, have_same_fields
from eulerparams_control.bags.format import (
    PARAMETERS_ATTACHMENT,
    BagFlaw,
    BagWarning,
    bag_information,
    in_words,
    load_yaml,
    read_metadata,
)
from eulerparams_control.bags.scan import (
    Batch,
    RawMessage,
    Scan,
    in_file_order,
    read_attachment,
    survey,
)
from eulerparams_control.errors import BagError, did_you_mean

_DESCRIPTION = "robot_description"


@dataclasses.dataclass(frozen=True)
class TopicInfo:
    """Type of a topic and number of its messages."""

    type: str
    count: int


class DecodedMessage(NamedTuple):
    """A message with its fields as attributes; times in nanoseconds."""

    topic: str
    log_time: int
    publish_time: int
    message: Any


class Bag:
    """A bag that is read; opening it reads no messages, unless its index is missing.

    Args:
        path: of the folder, or of one MCAP file.

    Raises:
        BagError: if there is no bag, or it is of another kind.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._files = [survey(file) for file in bag_files(self.path)]
        self._flaws: dict[BagWarning, None] = {}  # an ordered set
        self._decoders: dict[str, Callable[[bytes], Any]] = {}
        for file in self._files:
            if file.scan is not None:
                self._note(file.scan)

    @property
    def truncated(self) -> bool:
        """Whether the recorder was killed, or the disk was full, or the end is damaged."""
        return any(file.scan is not None and not file.scan.ended for file in self._files)

    @property
    def warnings(self) -> tuple[BagWarning, ...]:
        """The flaws that were found so far."""
        return tuple(self._flaws)

    @property
    def warning(self) -> str:
        """The same in one line; "" if there are none."""
        return in_words(self._flaws)

    @property
    def topics(self) -> dict[str, TopicInfo]:
        """Type and number of messages of each topic."""
        topics: dict[str, TopicInfo] = {}
        for contents in (file.contents for file in self._files):
            for name, topic in contents.topics.items():
                count = topics[name].count if name in topics else 0
                topics[name] = TopicInfo(topic.type, count + contents.counts[name])
        return topics

    @property
    def duration(self) -> float:
        """Time [s] from the first to the last message; 0 if there are none."""
        found = [file.contents for file in self._files if file.contents.message_count]
        if not found:
            return 0.0
        start, end = min(c.start for c in found), max(c.end for c in found)
        return (end - start) / 1e9

    @property
    def metadata(self) -> dict[str, Any]:
        """Content of metadata.yaml; reconstructed if it is missing or broken."""
        try:
            return read_metadata(self.path)
        except BagError:
            return bag_information(file.contents for file in self._files)

    def read_raw(self, topics: Iterable[str] | None = None) -> Iterator[RawMessage]:
        """Return the serialised messages in the order of recording, one at a time.

        Args:
            topics: names of those wanted; all by default.

        Raises:
            BagError: if a topic is not in the bag.
        """
        return chain.from_iterable(map(in_file_order, self.batches(topics)))

    def batches(self, topics: Iterable[str] | None = None) -> Iterator[Batch]:
        """Return the serialised messages by topic, some at a time: faster than one by one.

        Args:
            topics: names of those wanted; all by default.

        Raises:
            BagError: if a topic is not in the bag.
        """
        return self._scan(self._chosen(topics))

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[DecodedMessage]:
        """Return the decoded messages in the order of recording, one at a time.

        Args:
            topics: names of those wanted; all by default.

        Raises:
            BagError: if a topic is not in the bag; while iterating, if a message cannot
                be decoded.
        """
        return (DecodedMessage(*raw[:3], self.decode(raw)) for raw in self.read_raw(topics))

    def schema(self, topic: str) -> Schema:
        """Return the definition of the type of a topic.

        Raises:
            BagError: if the bag has none, or several that differ.
        """
        found = {}
        for file in self._files:
            scan = file.scan or file.rescan()
            for channel in scan.channels:
                if channel.topic == topic and channel.schema_id in scan.schemas:
                    schema = scan.schemas[channel.schema_id]
                    found[schema.name, schema.encoding, schema.data] = schema
        if not found:
            raise BagError(f"{self.path} does not say what the messages of {topic} are")
        first, *others = found.values()
        if not all(_are_alike(first, other) for other in others):
            names = ", ".join(sorted({name for name, _, _ in found}))
            raise BagError(
                f"{self.path}: {topic} has {len(found)} definitions that differ, of {names}; "
                "read its files one by one"
            )
        return first

    def decode(self, message: RawMessage) -> Any:
        """Return the fields of a message as attributes.

        Raises:
            BagError: if it cannot be decoded.
        """
        try:
            if message.topic not in self._decoders:
                self._decoders[message.topic] = self._decoder(message.topic)
            return self._decoders[message.topic](message.data)
        except BagError:
            raise
        except Exception as error:  # the decoder leaks any type
            raise BagError(
                f"{self.path}: a message of {message.topic} at {message.log_time} ns cannot be "
                f"decoded ({type(error).__name__}: {error}); read the other topics, or read_raw"
            ) from error

    def _decoder(self, topic: str) -> Callable[[bytes], Any]:
        """Return what decodes the messages of a topic.

        The decoder of the library reads on behind the end of a message, for as long as its numbers
        say, so the message is checked before.
        """
        schema = self.schema(topic)
        formats = {file.contents.topics[topic].serialization_format
                   for file in self._files if topic in file.contents.topics}  # fmt: skip
        if (formats, schema.encoding) != ({"cdr"}, "ros2msg"):
            raise BagError(
                f"{self.path}: {topic} is encoded as {', '.join(sorted(formats))} with a schema of "
                f"{schema.encoding}; only cdr with ros2msg can be decoded"
            )
        check_schema(schema)
        decoder = DecoderFactory().decoder_for("cdr", schema)
        assert decoder is not None

        def decode(data: bytes) -> Any:
            check(schema, data)
            return decoder(data)

        return decode

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the recorded nodes, as ``ros2 param dump`` shows them.

        Empty if the recorder stored none.

        Raises:
            BagError: if they are damaged.
        """
        parameters: dict[str, Any] = {}
        for file in self._files:
            if PARAMETERS_ATTACHMENT in file.attachments:
                offset = file.attachments[PARAMETERS_ATTACHMENT]
                text = read_attachment(file.path, offset).data.decode(errors="replace")
                nodes = load_yaml(text, f"{PARAMETERS_ATTACHMENT} in {file.path}")
                parameters |= nodes if isinstance(nodes, dict) else {}
        return parameters

    def robot_description(self, topic: str | None = None) -> str:
        """Return the first message of the topic ``robot_description``: the URDF.

        Args:
            topic: its name; needed only if there are several.

        Raises:
            BagError: if there is none, or there are several and none was named.
        """
        names = [name for name, info in self.topics.items() if _is_description(name, info)]
        if topic is None and len(names) != 1:
            found = f"several: {', '.join(names)}" if names else "none"
            raise BagError(
                f"{self.path}: expected one topic robot_description, found {found}; "
                "name the topic, or give the URDF as a file"
            )
        for message in self.messages([topic or names[0]]):
            if isinstance(urdf := getattr(message.message, "data", None), str):
                return urdf
        raise BagError(f"{self.path}: {topic or names[0]} has no URDF; give the URDF as a file")

    def _chosen(self, topics: Iterable[str] | None) -> set[str]:
        known = self.topics
        chosen = set(known if topics is None else topics)
        for name in sorted(chosen - known.keys()):
            raise BagError(
                f"{self.path} has no topic {name}{did_you_mean(name, known)}; "
                f"it has: {', '.join(sorted(known)) or 'none'}"
            )
        return chosen

    def _scan(self, topics: set[str]) -> Iterator[Batch]:
        for file in self._files:
            scan = file.rescan(topics)
            missing = sum(n for topic, n in file.contents.counts.items() if topic in topics)
            for batch in scan:
                missing -= sum(len(messages.data) for messages in batch.values())
                yield batch
            if missing:
                scan.damage.append(f"{missing} messages")
            self._note(scan)

    def _note(self, scan: Scan) -> None:
        """Remember what a pass over a file could not read."""
        for damage in scan.damage:
            self._flaws[BagWarning(BagFlaw.DAMAGED, f"{scan.path}: left out {damage}")] = None
        if not scan.ended:
            tail = f"; its last {scan.unread} bytes are incomplete" if scan.unread else ""
            text = f"{scan.path}: was not finished{tail}"
            self._flaws[BagWarning(BagFlaw.UNFINISHED, text)] = None


def _are_alike(one: Schema, other: Schema) -> bool:
    """Return whether two definitions are of the same type, with the same fields."""
    if (one.name, one.encoding) != (other.name, other.encoding):
        return False
    try:
        return one.data == other.data or have_same_fields(one, other.data)
    except BagError:  # one of them is damaged
        return False


def _is_description(name: str, info: TopicInfo) -> bool:
    return name.rpartition("/")[2] == _DESCRIPTION and info.type == "std_msgs/msg/String"


def bag_files(path: Path) -> list[Path]:
    """Return the MCAP files of the bag at ``path``, in the order of recording.

    Raises:
        BagError: if there are none.
    """
    if not path.is_dir():
        return [path]
    files = sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))
    for file in files:
        if not file.is_file():  # a pipe would be waited for
            raise BagError(f"{file} is no file; expected an MCAP file")
    if files:
        return files
    if list(path.glob("*.db3")):
        raise BagError(f"{path} is an sqlite3 bag; convert it to mcap with: ros2 bag convert")
    if list(path.glob("*.mcap.*")):
        raise BagError(f"{path} holds no plain .mcap file; decompress it with: zstd -d")
    raise BagError(f"{path} holds no .mcap file; expected the folder of a bag")
