"""Make a whole bag beside the one that a killed recorder left, which stays as it is."""

import contextlib
import dataclasses
import fcntl
import itertools
import os
import shutil
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


@dataclasses.dataclass(frozen=True)
class Recovery:
    """Result of :func:`recover`.

    Attributes:
        folder: that was asked for; nothing in it was changed.
        bag: the folder of the whole bag: the same, or a new one beside it.
        messages: number of messages that it has.
        topics: number of its topics.
        lost: what could not be read, one phrase each.
    """

    folder: Path
    bag: Path
    messages: int
    topics: int
    lost: tuple[str, ...] = ()

    def __str__(self) -> str:
        content = f"{self.messages} messages on {self.topics} topics"
        if self.bag == self.folder:
            return f"{self.folder}: whole, {content}; no other bag was made"
        lost = f"; left out {', '.join(self.lost)}" if self.lost else ""
        return f"{self.folder}: unchanged; recovered {content} in {self.bag}{lost}"


def recover(folder: str | os.PathLike[str]) -> Recovery:
    """Make a whole bag of what can be read of the one in ``folder``, beside it.

    Nothing in ``folder`` is changed.  Of a bag that is whole none is made.

    Raises:
        BagError: if there is no bag, it is being recorded, or the disk is full.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BagError(f"{folder} is no folder; expected the folder of a bag")
    with contextlib.ExitStack() as held:
        try:
            for file in bag_files(folder):
                held.enter_context(_locked(file))
            found = [survey(file, thorough=True) for file in bag_files(folder)]
            information = bag_information(one.contents for one in found)
            bag = folder
            if not all(map(_is_whole, found)) or not _agrees(folder, information):
                bag, information = _made_of(found, folder.resolve())
        except OSError as error:
            raise BagError(f"cannot recover {folder}: {error.strerror}; {_ADVICE}") from error
    lost = tuple(phrase for one in found for phrase in _lost(one))
    topics = len(information["topics_with_message_count"])
    return Recovery(folder, bag, information["message_count"], topics, lost)


def _is_whole(found: Survey) -> bool:
    return (
        found.index is not None and found.scan is not None and found.scan.ended and not _lost(found)
    )


def _lost(found: Survey) -> list[str]:
    """Return what of a file cannot be read."""
    scan = found.scan
    assert scan is not None
    if found.index is not None and scan.ended and not scan.damage:
        return []
    return scan.damage + ([f"the last {scan.unread} bytes"] if scan.unread else [])


def _made_of(found: list[Survey], folder: Path) -> tuple[Path, dict[str, Any]]:
    """Return a new bag beside ``folder``, and its metadata: whole, or there is none."""
    with tempfile.TemporaryDirectory(prefix=".recovering-", dir=folder.parent) as space:
        bag = Path(space) / folder.name
        bag.mkdir()
        information = bag_information(_copied(one, bag / one.path.name) for one in found)
        write_metadata(bag, information)
        numbers = itertools.chain(("",), map("_{}".format, itertools.count(2)))
        places = (folder.with_name(f"{folder.name}_recovered{number}") for number in numbers)
        return bag.rename(next(place for place in places if not place.exists())), information


def _copied(found: Survey, path: Path) -> FileContents:
    if _is_whole(found):
        shutil.copyfile(found.path, path)
        return found.contents
    assert found.scan is not None
    return _copy(found, path, _COMPRESSIONS.get(found.scan.compression))


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
