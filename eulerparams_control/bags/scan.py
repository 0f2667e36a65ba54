"""Read MCAP files record by record, also those that end anywhere or hold damaged bytes.

Chunks are unpacked within bounds: a few kilobytes can unpack to more than there is memory, and
the size that a chunk states may be wrong.
"""

import contextlib
import dataclasses
import os
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Message, Schema
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from eulerparams_control.bags.format import FileContents, Topic, load_yaml
from eulerparams_control.errors import BagError

LARGEST = 2**28
"""Bytes of a record, or of a chunk unpacked, at most; recorders write chunks of some megabytes."""

Record = Schema | Channel | Message

_HEAD = struct.Struct("<BQ")  # opcode and length begin each record
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time, then the data
_FOOTER = struct.Struct("<BQQQI8s")  # opcode, length, summary, its offsets, checksum; magic
_IN_CHUNKS = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE}
_READ = _IN_CHUNKS | {Opcode.CHUNK, Opcode.ATTACHMENT}
_MOST_DAMAGE = 20  # phrases, at most: a file may be damaged everywhere
_LONGEST_REASON = 200  # characters


def unpacked(chunk: Chunk) -> bytes:
    """Return the records of a chunk, unpacked and checked by their checksum, if it has one.

    Raises:
        Exception: of any type, if the bytes are damaged.
        ValueError: if they are not as many as the chunk says, or than a chunk may have; if the
            compression is unknown, or the checksum is wrong.
    """
    if chunk.uncompressed_size > LARGEST:
        raise ValueError(f"{chunk.uncompressed_size} bytes unpacked; expected at most {LARGEST}")
    data = _unpack(chunk.compression, chunk.data, chunk.uncompressed_size)
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("its checksum is wrong")
    return data


def _unpack(compression: str, data: bytes, size: int) -> bytes:
    if compression == "":
        return data
    if compression == "zstd":
        if zstandard.frame_content_size(data) not in (-1, size):  # -1: it does not say
            raise ValueError(f"it does not unpack to the {size} bytes that it tells of")
        found = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    elif compression == "lz4":
        found = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    else:
        raise ValueError(f"the compression '{compression}' is unknown; expected zstd or lz4")
    if len(found) != size:
        raise ValueError(f"it does not unpack to the {size} bytes that it tells of")
    return bytes(found)


class Scan:
    """One pass over an MCAP file; iterating gives its channels and messages in file order.

    What cannot be read is left out and listed in ``damage``.  Memory is bounded by the
    largest record.

    Args:
        path: of the file.
        index: of the file, where it has one: its channels are known from the start.

    Attributes (complete once the iteration has ended):
        channels, schemas: those met, by their number.
        attachments: where the last one of each name is, for :func:`read_attachment`.
        ended: whether the data section has its end; not so if the recorder was killed.
        unread: number of bytes at the end that are no whole record.
        damage: what was left out before that, one phrase each.
        compression: of the chunks: ``""``, ``"zstd"`` or ``"lz4"``.
    """

    def __init__(self, path: Path, index: Summary | None = None) -> None:
        self.path = path
        self.channels: dict[int, Channel] = dict(index.channels) if index else {}
        self.schemas: dict[int, Schema] = dict(index.schemas) if index else {}
        self.attachments: dict[str, int] = {}
        self.ended = False
        self.unread = 0
        self.damage: list[str] = []
        self.compression = ""

    def __iter__(self) -> Iterator[Channel | Message]:
        """Yield channels, and the messages whose channel is known.

        Raises:
            BagError: if the file cannot be opened or is no MCAP file.
        """
        strangers = 0
        for record in self._records():
            if isinstance(record, Message):
                if record.channel_id in self.channels:
                    yield record
                else:
                    strangers += 1
            elif isinstance(record, Channel):
                self.channels[record.id] = record
                yield record
            else:
                self.schemas[record.id] = record
        if strangers:
            self.damage.append(f"{strangers} messages of topics whose description is lost")

    def _records(self) -> Iterator[Record]:
        with open_mcap(self.path) as file:
            size = os.fstat(file.fileno()).st_size
            at = file.tell()
            while at + _HEAD.size <= size:
                opcode, length = _HEAD.unpack(file.read(_HEAD.size))
                if opcode == 0 or length > size - at - _HEAD.size:
                    break
                if opcode == Opcode.DATA_END:
                    self.ended = True
                    return
                if opcode in _READ and length > LARGEST:
                    self._leave_out(opcode, at, f"{length} bytes; expected at most {LARGEST}")
                    file.seek(length, os.SEEK_CUR)
                elif opcode in _READ:
                    yield from self._parse(opcode, file.read(length), at)
                else:
                    file.seek(length, os.SEEK_CUR)
                at += _HEAD.size + length
            self.unread = size - at

    def _parse(self, opcode: int, body: bytes, at: int) -> Iterator[Record]:
        try:
            if opcode == Opcode.CHUNK:
                yield from self._chunk(body)
            elif opcode == Opcode.ATTACHMENT:
                self.attachments[_attachment(body).name] = at
            else:
                yield _record(opcode, body)
        except Exception as error:  # the parsers leak any type on damaged bytes
            self._leave_out(opcode, at, str(error) or type(error).__name__)

    def _leave_out(self, opcode: int, at: int, reason: str) -> None:
        if len(self.damage) < _MOST_DAMAGE:
            what = f"the {Opcode(opcode).name.lower()} at byte {at}"
            self.damage.append(f"{what}: {reason[:_LONGEST_REASON]}")
        elif len(self.damage) == _MOST_DAMAGE:
            self.damage.append(f"more that is damaged from byte {at} on")

    def _chunk(self, body: bytes) -> Iterator[Record]:
        chunk = Chunk.read(ReadDataStream(BytesIO(body)))
        self.compression = chunk.compression
        data = unpacked(chunk)
        at, size = 0, len(data)
        while at < size:
            opcode, length = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if length > size - at:
                raise ValueError("a record does not fit into its chunk")
            if opcode in _IN_CHUNKS:
                yield _record(opcode, data[at : at + length])
            at += length


def _record(opcode: int, body: bytes) -> Record:
    if opcode == Opcode.MESSAGE:
        channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(body)
        return Message(channel, log_time, body[_MESSAGE.size :], publish_time, sequence)
    stream = ReadDataStream(BytesIO(body))
    record: Schema | Channel = (Schema if opcode == Opcode.SCHEMA else Channel).read(stream)
    return record


def _attachment(body: bytes) -> Attachment:
    (checksum,) = struct.unpack("<I", body[-4:])
    if checksum not in (0, zlib.crc32(body[:-4])):
        raise ValueError("its checksum is wrong")
    attachment: Attachment = Attachment.read(ReadDataStream(BytesIO(body)))
    return attachment


@contextlib.contextmanager
def open_mcap(path: Path) -> Iterator[BinaryIO]:
    """Open an MCAP file, at the place behind its magic bytes.

    Raises:
        BagError: if it cannot be read, is empty, or is something else.
    """
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise BagError(f"{path} is no file; expected an MCAP file")
        with open(path, "rb") as file:
            begin = file.read(len(MCAP0_MAGIC))
            if begin != MCAP0_MAGIC:
                found = f"begins with {begin!r}" if begin else "is empty"
                raise BagError(f"{path} {found}; expected an MCAP file")
            yield file
    except OSError as error:
        raise BagError(f"cannot read {path}: {error.strerror}") from error


def read_summary(path: Path) -> Summary | None:
    """Return the index at the end of a finished file; None if it has none that is whole.

    Raises:
        BagError: if ``path`` is no MCAP file.
    """
    with open_mcap(path) as file:
        try:
            end = file.seek(-_FOOTER.size, os.SEEK_END)
            _, _, start, _, checksum, magic = _FOOTER.unpack(file.read())
            if magic != MCAP0_MAGIC or start == 0:
                return None
            if end - start > LARGEST:
                return None
            file.seek(start)
            data = file.read(end + _FOOTER.size - 12 - start)  # up to the checksum
            if checksum not in (0, zlib.crc32(data)):
                return None
            file.seek(0)
            return SeekingReader(file).get_summary()
        except Exception:  # the parsers leak any type on damaged bytes
            return None


def read_attachment(path: Path, offset: int) -> Attachment:
    """Return the attachment at byte ``offset``.

    Raises:
        BagError: if there is none that is whole.
    """
    with open_mcap(path) as file:
        file.seek(offset)
        try:
            _, length = _HEAD.unpack(file.read(_HEAD.size))
            if length > LARGEST:
                raise ValueError(f"{length} bytes; expected at most {LARGEST}")
            return _attachment(file.read(length))
        except Exception as error:  # the parsers leak any type on damaged bytes
            raise BagError(
                f"{path}: the attachment at byte {offset} is damaged: {error}"
            ) from error


@dataclasses.dataclass
class Survey:
    """Contents of one file.

    Attributes:
        index: None if the file was not finished, or its index is damaged.
        scan: the pass that read the file through; None if its index was enough.
        attachments: where the last one of each name is.
    """

    path: Path
    contents: FileContents
    index: Summary | None
    scan: Scan | None = None
    attachments: dict[str, int] = dataclasses.field(default_factory=dict)

    def rescan(self) -> Scan:
        """Return a new pass over the file."""
        return Scan(self.path, self.index)


def survey(path: Path, thorough: bool = False) -> Survey:
    """Return what the file at ``path`` holds.

    Args:
        path: of an MCAP file.
        thorough: read it through, although its index is whole.

    Raises:
        BagError: if it is no MCAP file.
    """
    found = Survey(path, FileContents(path.name), read_summary(path))
    if found.index is None or found.index.statistics is None or thorough:
        _read_through(found)
    else:
        _read_index(found, found.index)
    return found


def _read_index(found: Survey, index: Summary) -> None:
    statistics = index.statistics
    assert statistics is not None
    for channel in index.channels.values():
        topic = _add_topic(found.contents, channel, index.schemas)
        count = statistics.channel_message_counts.get(channel.id, 0)
        found.contents.counts[topic] += count
    if statistics.message_count:
        found.contents.start = statistics.message_start_time
        found.contents.end = statistics.message_end_time
    found.attachments = {entry.name: entry.offset for entry in index.attachment_indexes}


def _read_through(found: Survey) -> None:
    contents = found.contents
    found.scan = scan = found.rescan()
    for channel in scan.channels.values():
        _add_topic(contents, channel, scan.schemas)
    for record in scan:
        if isinstance(record, Channel):
            _add_topic(contents, record, scan.schemas)
        else:
            contents.counts[scan.channels[record.channel_id].topic] += 1
            contents.start = min(contents.start, record.log_time)
            contents.end = max(contents.end, record.log_time)
    found.attachments = scan.attachments
    if found.index is not None and found.index.statistics is not None:
        missing = found.index.statistics.message_count - contents.message_count
        if missing:
            scan.damage.append(f"{missing} messages")


def _add_topic(contents: FileContents, channel: Channel, schemas: dict[int, Schema]) -> str:
    schema = schemas.get(channel.schema_id)
    contents.topics[channel.topic] = topic_of(channel, schema)
    contents.counts.setdefault(channel.topic, 0)
    return channel.topic


def topic_of(channel: Channel, schema: Schema | None) -> Topic:
    """Return the topic of a channel with its schema; a broken QoS profile counts as none."""
    try:
        profiles = load_yaml(channel.metadata.get("offered_qos_profiles", ""), channel.topic)
    except BagError:
        profiles = None
    return Topic(
        name=channel.topic,
        type=schema.name if schema else "",
        type_hash=channel.metadata.get("topic_type_hash", ""),
        qos_profiles=_profiles(profiles),
        serialization_format=channel.message_encoding,
    )


def _profiles(told: Any) -> tuple[dict[str, Any], ...]:
    """Return the QoS profiles of a list of mappings; entries of another form are left out."""
    if not isinstance(told, list) or not all(isinstance(profile, dict) for profile in told):
        return ()
    return tuple({str(key): value for key, value in profile.items()} for profile in told)
