"""Write a bag: a folder with one MCAP file, laid out as Jazzy's own recorder does.

The index of its chunks is kept on the disk until the bag is closed: a recorder ends ten chunks a
second, and in memory the index would grow by 9 kB/s.
"""

import contextlib
import fcntl
import functools
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from typing import Any, Self

from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, ChunkIndex
from mcap.writer import CompressionType, Writer

from eulerparams_control.bags.format import (
    METADATA_FILE,
    METADATA_KEY,
    METADATA_RECORD,
    FileContents,
    Topic,
    bag_information,
    dump_yaml,
    write_metadata,
)
from eulerparams_control.errors import BagError, OccupiedError

_SEPARATOR = "=" * 80
_TYPE_NAME = re.compile(r"([a-zA-Z]\w*)/(?:msg/)?([a-zA-Z]\w*)", re.ASCII)
_FIELD_TYPE = re.compile(r"^\s*([a-zA-Z0-9_/]+)(?:\[[^\]]*\])?\s", re.MULTILINE)
_PRIMITIVE = re.compile(r"bool|byte|char|w?string|float(32|64)|u?int(8|16|32|64)")


@functools.cache
def message_definition(message_type: str) -> str:
    """Return the schema text of ``message_type``, e.g. ``sensor_msgs/msg/JointState``.

    Raises:
        BagError: if the .msg file of the type, or of one that it contains, is not found.

    Source: ``local_message_definition_source.cpp`` of rosbag2.
    """
    return _with_dependencies(message_type, set())


def _with_dependencies(message_type: str, seen: set[str]) -> str:
    text = _message_file(message_type).read_text(encoding="utf-8")
    package = message_type.partition("/")[0]
    for dependency in _dependencies(text, package):
        if dependency not in seen:
            seen.add(dependency)
            text += f"\n{_SEPARATOR}\nMSG: {dependency}\n{_with_dependencies(dependency, seen)}"
    return text


def _dependencies(text: str, package: str) -> list[str]:
    """Return the types of the fields that are messages, as ``package/Type``, sorted."""
    types = {name for name in _FIELD_TYPE.findall(text) if not _PRIMITIVE.fullmatch(name)}
    return sorted(name if "/" in name else f"{package}/{name}" for name in types)


def _message_file(message_type: str) -> Path:
    match = _TYPE_NAME.fullmatch(message_type)
    if match is None:
        raise BagError(f"'{message_type}' is no message type; expected package/msg/Type")
    package, name = match.groups()
    for prefix in _prefixes():
        path = Path(prefix) / "share" / package / "msg" / f"{name}.msg"
        if path.is_file():
            return path
    raise BagError(
        f"the definition of {message_type} is missing; looked for share/{package}/msg/{name}.msg "
        f"in {', '.join(_prefixes())}; install the package or source its workspace"
    )


def _prefixes() -> list[str]:
    ament = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [prefix for prefix in ament if prefix] + [sys.prefix]


# Private list of mcap's writer, to which it appends each index, and which it writes at the end.
_LIST = "_Writer__chunk_indices"

# What a killed process loses: the chunk in progress, no larger and no older than this.
_CHUNK_BYTES = 64 * 1024
_CHUNK_NS = 100_000_000


class SpilledIndex:
    """Stand-in for the list of chunk indexes of mcap's writer."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 (it ends with the writer)

    def __del__(self) -> None:
        """Give the file back; it has no name."""
        self._file.close()

    def append(self, index: ChunkIndex) -> None:
        """Take one more."""
        builder = RecordBuilder()
        index.write(builder)
        self._file.write(builder.end())  # type: ignore[no-untyped-call]

    def __iter__(self) -> Iterator["SpilledIndex"]:
        """Give all of them as one."""
        yield self

    def write(self, builder: Any) -> None:
        """Write all of them."""
        self._file.seek(0)
        shutil.copyfileobj(self._file, builder)


def spill_index(writer: Writer) -> None:
    """Let a writer that has just been made keep its index on the disk."""
    assert getattr(writer, _LIST) == []
    setattr(writer, _LIST, SpilledIndex())


class _Output:
    """An unbuffered file: what was written is the kernel's, also if this process dies.

    It is locked while it is open, so that no one recovers a bag that is being recorded.
    The first write that fails ends it: the file is cut after the last whole record.

    Args:
        path: of the file, which must not exist.
        advice: what to do when the disk is full.
    """

    def __init__(self, path: Path, advice: str) -> None:
        self._path = path
        self._advice = advice
        self._file = FileIO(path, "xb")
        with contextlib.suppress(OSError):  # file systems without locks can record, too
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._size = 0
        self.error: BagError | None = None

    def write(self, data: bytes) -> int:
        if self.error is not None:
            raise self.error
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            self.error = BagError(f"cannot write {self._path}: {error.strerror}; {self._advice}")
            with contextlib.suppress(OSError):
                self._file.truncate(self._size)
            raise self.error from error
        self._size += len(data)
        return len(data)

    def tell(self) -> int:
        return self._size

    def flush(self) -> None:
        pass

    def close(self) -> None:
        self._file.close()


class McapFile:
    """One MCAP file of a bag while it is written.

    Args:
        path: of the file, which must not exist.
        advice: what to do when the disk is full.
        compression: of the chunks.

    Raises:
        OSError: if it cannot be made.
        BagError: any method, once the disk is full.
    """

    def __init__(
        self, path: Path, advice: str, compression: CompressionType = CompressionType.NONE
    ) -> None:
        self.contents = FileContents(path.name)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._output = _Output(path, advice)
        self._writer = Writer(self._output, _CHUNK_BYTES, compression)  # type: ignore[arg-type]
        spill_index(self._writer)
        self._writer.start(profile="ros2")
        self._write_information()

    def add_topic(self, topic: Topic, encoding: str, definition: bytes) -> None:
        """Make room for the messages of ``topic``; its schema is written once a type."""
        if topic.type not in self._schemas:
            schema = self._writer.register_schema(topic.type, encoding, definition)
            self._schemas[topic.type] = schema
        profiles = [dict(profile) for profile in topic.qos_profiles]
        metadata = {
            "offered_qos_profiles": dump_yaml(profiles).rstrip() if profiles else "",
            "topic_type_hash": topic.type_hash,
        }
        self._channels[topic.name] = self._writer.register_channel(
            topic.name, topic.serialization_format, self._schemas[topic.type], metadata
        )
        self.contents.topics[topic.name] = topic
        self.contents.counts[topic.name] = 0

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one serialised message."""
        contents = self.contents
        self._writer.add_message(self._channels[topic], log_time, data, publish_time)
        contents.counts[topic] += 1
        if log_time < contents.start:
            contents.start = log_time
        if log_time > contents.end:
            contents.end = log_time

    def attach(self, file: Attachment) -> None:
        """Add a file beside the messages."""
        self._writer.add_attachment(
            file.create_time, file.log_time, file.name, file.media_type, file.data
        )

    def flush(self) -> None:
        """End the chunk in progress."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> bool:
        """Make the file whole: metadata, indexes, statistics, footer; return whether it is."""
        with contextlib.closing(self._output):
            if self._output.error is None:
                self.flush()
                self._write_information()
                self._writer.finish()  # type: ignore[no-untyped-call]
        return self._output.error is None

    def _write_information(self) -> None:
        text = dump_yaml(bag_information([self.contents]))
        self._writer.add_metadata(METADATA_RECORD, {METADATA_KEY: text})


class BagWriter:
    """A bag while it is recorded; a context manager that closes it.

    Args:
        folder: of the bag; must not exist.

    Raises:
        BagError: if ``folder`` exists or cannot be made; any method, if the disk is full.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder).absolute()
        self._advice = (
            "the bag keeps all but the last chunk; make room, then run: "
            f"bag_recorder --recover {self.folder}"
        )
        try:
            self.folder.mkdir(parents=True)
            self._file = McapFile(self.folder / f"{self.folder.name}_0.mcap", self._advice)
        except FileExistsError as error:
            raise OccupiedError(
                f"{self.folder} exists; nothing is overwritten: choose another folder or remove it"
            ) from error
        except OSError as error:
            raise BagError(f"cannot make the bag {self.folder}: {error.strerror}") from error
        self._last_flush = time.monotonic_ns()
        self._closed = False

    @property
    def contents(self) -> FileContents:
        """Contents written until now."""
        return self._file.contents

    def add_topic(self, topic: Topic, definition: str | None = None) -> None:
        """Make room for the messages of ``topic``.

        Args:
            topic: its description.
            definition: the schema text; that of the installed .msg files by default.

        Raises:
            BagError: if the .msg files are not found.
        """
        text = message_definition(topic.type) if definition is None else definition
        self._file.add_topic(topic, "ros2msg", text.encode())

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one serialised message of an added topic; times in nanoseconds."""
        self._file.write(topic, data, log_time, publish_time)
        now = time.monotonic_ns()
        if now - self._last_flush > _CHUNK_NS:
            self._last_flush = now
            self._file.flush()

    def attach(self, name: str, text: str) -> None:
        """Add a text file to the bag; of several with one name the last counts."""
        now = time.time_ns()
        self._file.attach(Attachment(now, now, name, "text/plain", text.encode()))

    def flush(self) -> None:
        """Hand all that was written to the kernel; nothing of it is lost with the process."""
        self._file.flush()

    def close(self) -> None:
        """Make the bag whole; after a write that failed, only release its file."""
        if self._closed:
            return
        self._closed = True
        if self._file.close():
            try:
                write_metadata(self.folder, bag_information([self.contents]))
            except OSError as error:
                raise BagError(
                    f"cannot write {self.folder}/{METADATA_FILE}: {error.strerror}; {self._advice}"
                ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()
