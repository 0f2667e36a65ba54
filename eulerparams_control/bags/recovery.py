"""Make whole what a killed recorder left: the MCAP file and metadata.yaml."""

import contextlib
import dataclasses
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType

from eulerparams_control.bags.format import (
    FileContents,
    bag_information,
    read_metadata,
    write_metadata,
)
from eulerparams_control.bags.reader import bag_files
from eulerparams_control.bags.scan import (
    Scan,
    Survey,
    in_file_order,
    read_attachment,
    survey,
    topic_of,
)
from eulerparams_control.bags.writer import McapFile
from eulerparams_control.errors import BagError

_COMPRESSIONS = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4}
_ADVICE = "nothing was changed; make room, then try again"
# Keys of metadata.yaml that must agree with the files; the others may be older.
_AGREEING = ("storage_identifier", "message_count", "relative_file_paths")
# An end shorter than this is the chunk that was being written; more may be worth a look.
_LAST_CHUNK_BYTES = 2**20


@dataclasses.dataclass
class Recovery:
    """Result of :func:`recover`.

    Attributes:
        messages: number of messages that the bag has now.
        topics: number of its topics.
        lost: what could not be read, one phrase each.
        kept: damaged files that were set aside, because more than an end was unreadable.
        changed: False if the bag was whole already.
    """

    folder: Path
    messages: int
    topics: int
    lost: list[str] = dataclasses.field(default_factory=list)
    kept: list[Path] = dataclasses.field(default_factory=list)
    changed: bool = False

    def __str__(self) -> str:
        content = f"{self.messages} messages on {self.topics} topics"
        if not self.changed:
            return f"{self.folder}: whole, {content}; nothing changed"
        lost = f"; left out {', '.join(self.lost)}" if self.lost else ""
        kept = f"; the damaged original is {', '.join(map(str, self.kept))}" if self.kept else ""
        return f"{self.folder}: recovered {content}{lost}{kept}"


def recover(folder: str | os.PathLike[str]) -> Recovery:
    """Make the bag in ``folder`` whole; a whole one is left as it is.

    Every message that can be read is copied to a new file, which then takes the place of
    the old one; killed meanwhile, the old one is still there.

    Raises:
        BagError: if there is no bag, it is being recorded, or the disk is full.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BagError(f"{folder} is no folder; expected the folder of a bag")
    result = Recovery(folder, 0, 0)
    try:
        information = bag_information(_recover_file(file, result) for file in bag_files(folder))
        if result.changed or not _agrees(folder, information):
            write_metadata(folder, information)
            result.changed = True
    except OSError as error:
        raise BagError(f"cannot recover {folder}: {error.strerror}; {_ADVICE}") from error
    result.messages = information["message_count"]
    result.topics = len(information["topics_with_message_count"])
    return result


def _recover_file(path: Path, result: Recovery) -> FileContents:
    with _locked(path):
        found = survey(path, thorough=True)
        scan = found.scan
        assert scan is not None
        if found.index is not None and scan.ended and not scan.damage:
            return found.contents
        result.changed = True
        result.lost += scan.damage
        if scan.unread:
            result.lost.append(f"the last {scan.unread} bytes")
        with tempfile.TemporaryDirectory(prefix=".recovering-", dir=path.parent) as folder:
            contents = _copy(found, Path(folder) / path.name, _COMPRESSIONS.get(scan.compression))
            if scan.damage or scan.unread > _LAST_CHUNK_BYTES:
                result.kept.append(path.rename(f"{path}.damaged"))
            os.replace(Path(folder) / path.name, path)
        return contents


def _copy(found: Survey, path: Path, compression: CompressionType | None) -> FileContents:
    file = McapFile(path, _ADVICE, compression or CompressionType.NONE)
    scan = found.rescan()
    with contextlib.closing(file):
        for batch in scan:
            _add_topics(file, scan)
            for topic, log_time, publish_time, data in in_file_order(batch):
                file.write(topic, data, log_time, publish_time)
        _add_topics(file, scan)
        for offset in found.attachments.values():
            file.attach(read_attachment(found.path, offset))
    return file.contents


def _add_topics(file: McapFile, scan: Scan) -> None:
    """Add the topics that a scan has met and a file does not have."""
    for channel in scan.channels:
        if channel.topic not in file.contents.topics:
            schema = scan.schemas.get(channel.schema_id)
            encoding, data = (schema.encoding, schema.data) if schema else ("", b"")
            file.add_topic(topic_of(channel, schema), encoding, data)


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock that the recorder holds while it writes.

    Raises:
        BagError: if the file is being written.
    """
    with open(path, "rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BagError(
                f"{path} is being recorded or recovered; stop that first, then try again"
            ) from error
        except OSError:
            pass  # a file system without locks
        yield


def _agrees(folder: Path, information: dict[str, Any]) -> bool:
    """Return whether metadata.yaml is there and names the same files and message count."""
    try:
        present = read_metadata(folder)
    except BagError:
        return False
    return all(present.get(key) == information[key] for key in _AGREEING)
