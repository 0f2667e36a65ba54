"""Read MCAP files record by record, also those that end anywhere or hold damaged bytes.

Chunks are unpacked within bounds: a few kilobytes can unpack to more than there is memory, and
the size that a chunk states may be wrong.
"""

import contextlib
import dataclasses
import itertools
import os
import struct
import zlib
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Schema
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from eulerparams_control.bags.format import FileContents, Topic, load_yaml
from eulerparams_control.errors import BagError

LARGEST = 2**28
"""Bytes of a record, or of a chunk unpacked, at most; recorders write chunks of some megabytes."""

_HEAD = struct.Struct("<BQ")  # opcode and length begin each record
_MESSAGE = struct.Struct("<BQHIQQ")  # and channel, sequence, log and publish time, then the data
_FOOTER = struct.Struct("<BQQQI8s")  # opcode, length, summary, its offsets, checksum; magic
_DATA_END = 4  # bytes of the record at the end of the data section: a checksum
_OPCODES = set(Opcode)
_READ = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.ATTACHMENT}
_BATCH_MESSAGES = 5000  # of one record at most
_BATCH_BYTES = 2**16  # of records whose messages are handed over together
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


class RawMessage(NamedTuple):
    """A message as it was recorded, serialised; times in nanoseconds."""

    topic: str
    log_time: int
    publish_time: int
    data: bytes


class Messages(NamedTuple):
    """Messages of a topic, as they were recorded.

    Attributes:
        places: increase in file order, over all topics.
        log_times, publish_times: [ns].
        data: serialised.
    """

    places: list[int]
    log_times: list[int]
    publish_times: list[int]
    data: list[bytes]


Batch = dict[str, Messages]
"""Messages that follow each other in a file, by topic."""


def in_file_order(batch: Batch) -> list[RawMessage]:
    """Return the messages of a batch one by one."""
    found = {
        place: RawMessage(topic, log_time, publish_time, data)
        for topic, messages in batch.items()
        for place, log_time, publish_time, data in zip(*messages, strict=True)
    }
    return [found[place] for place in sorted(found)]


class Scan:
    """One pass over an MCAP file; iterating gives its messages, some at a time.

    What cannot be read is left out and listed in ``damage``.  Memory is bounded by some
    copies of the largest record, packed and unpacked, and 5000 messages.

    Args:
        path: of the file.
        index: of the file, where it has one: its channels are known from the start.
        topics: of which messages are wanted; None is all.

    Attributes (complete once the iteration has ended):
        channels: those met.
        schemas: those met, by their number.
        attachments: where the last one of each name is, for :func:`read_attachment`.
        ended: whether the data section has its end; not so if the recorder was killed.
        unread: number of bytes at the end that are no whole record.
        damage: what was left out before that, one phrase each.
        compression: of the chunks: ``""``, ``"zstd"`` or ``"lz4"``.
    """

    def __init__(
        self, path: Path, index: Summary | None = None, topics: Collection[str] | None = None
    ) -> None:
        self.path = path
        self.channels: list[Channel] = []
        self.schemas: dict[int, Schema] = dict(index.schemas) if index else {}
        self.attachments: dict[str, int] = {}
        self.ended = False
        self.unread = 0
        self.damage: list[str] = []
        self.compression = ""
        self._topics = topics
        self._known: dict[int, Channel] = {}
        self._wanted: dict[int, str] = {}  # topics, by the number of the channel
        self._strangers = 0
        self._batch: Batch = {}
        self._bytes = 0  # of the records that the batch is from
        self._places = itertools.count()
        for channel in index.channels.values() if index else ():
            self._meet(channel)

    def __iter__(self) -> Iterator[Batch]:
        """Yield the messages whose channel is known, some at a time.

        Raises:
            BagError: if the file cannot be opened or is no MCAP file.
        """
        with open_mcap(self.path) as file:
            size = os.fstat(file.fileno()).st_size
            at = file.tell()
            while at + _HEAD.size <= size:
                head = file.read(_HEAD.size)
                opcode, length = _HEAD.unpack(head)
                is_cut = length > size - at - _HEAD.size
                if opcode == Opcode.DATA_END and length != _DATA_END:
                    self._leave_out(opcode, at, f"{length} bytes; expected {_DATA_END}")
                elif length > LARGEST and (is_cut or opcode in _READ):
                    self._leave_out(opcode, at, f"{length} bytes; expected at most {LARGEST}")
                if opcode == 0 or is_cut:
                    break
                if opcode == Opcode.DATA_END and length == _DATA_END:
                    self.ended = True
                    break
                if opcode in _READ and length <= LARGEST:
                    yield from self._parse(opcode, head, file.read(length), at)
                else:
                    file.seek(length, os.SEEK_CUR)
                at += _HEAD.size + length
            self.unread = 0 if self.ended else size - at
        yield from self._hand_over()
        if self._strangers:
            text = f"{self._strangers} messages of topics whose description is lost"
            self.damage.append(text)

    def _parse(self, opcode: int, head: bytes, body: bytes, at: int) -> Iterator[Batch]:
        """Take what is in a record, that is at a byte of the file."""
        try:
            if opcode == Opcode.CHUNK:
                chunk = Chunk.read(ReadDataStream(BytesIO(body)))
                self.compression = chunk.compression
                yield from self._take(unpacked(chunk))
            elif opcode == Opcode.ATTACHMENT:
                self.attachments[_attachment(body).name] = at
            else:
                yield from self._take(head + body)
        except Exception as error:  # the parsers leak any type on damaged bytes
            self._leave_out(opcode, at, str(error) or type(error).__name__)
        if self._bytes >= _BATCH_BYTES:
            yield from self._hand_over()

    def _hand_over(self) -> Iterator[Batch]:
        """Yield the messages that were taken, if any."""
        batch, self._batch, self._bytes = self._batch, {}, 0
        if batch:
            yield batch

    def _leave_out(self, opcode: int, at: int, reason: str) -> None:
        if len(self.damage) < _MOST_DAMAGE:
            name = Opcode(opcode).name.lower() if opcode in _OPCODES else f"record {opcode}"
            what = f"the {name} at byte {at}"
            self.damage.append(f"{what}: {reason[:_LONGEST_REASON]}")
        elif len(self.damage) == _MOST_DAMAGE:
            self.damage.append(f"more that is damaged from byte {at} on")

    def _take(self, data: bytes) -> Iterator[Batch]:
        """Take schemas, channels and messages from records that follow each other."""
        at, size, wanted, head, whole = 0, len(data), self._wanted, _HEAD.size, _MESSAGE.size
        unpack, batch, count, last = _MESSAGE.unpack_from, self._batch, 0, size - whole
        rest = max(0, last)  # from here on a record may be shorter than the head of a message
        padded = data[rest:] + bytes(whole)
        self._bytes += size
        while at < size:  # no calls but these: it runs once for each message of an hour
            opcode, length, number, _, log_time, publish_time = (
                unpack(data, at) if at <= last else unpack(padded, at - rest)
            )
            begin, at = at, at + head + length
            if at > size:
                raise ValueError("a record does not fit into its chunk")
            if opcode == Opcode.MESSAGE:
                if at < begin + whole:
                    raise ValueError("a message is shorter than its head")
                if number in wanted:
                    messages = batch.get(wanted[number])
                    if messages is None:
                        messages = batch[wanted[number]] = Messages([], [], [], [])
                    places, log_times, publish_times, contents = messages
                    places.append(next(self._places))
                    log_times.append(log_time)
                    publish_times.append(publish_time)
                    contents.append(data[begin + whole : at])
                    count += 1
                    if count == _BATCH_MESSAGES:
                        yield from self._hand_over()
                        batch, count = self._batch, 0
                elif number not in self._known:
                    self._strangers += 1
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                stream = ReadDataStream(BytesIO(data[begin + head : at]))
                if opcode == Opcode.CHANNEL:
                    self._meet(Channel.read(stream))
                else:
                    schema = Schema.read(stream)
                    self.schemas[schema.id] = schema

    def _meet(self, channel: Channel) -> None:
        if self._known.get(channel.id) == channel:
            return
        self.channels.append(channel)
        self._known[channel.id] = channel
        self._wanted.pop(channel.id, None)
        if self._topics is None or channel.topic in self._topics:
            self._wanted[channel.id] = channel.topic


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

    def rescan(self, topics: Collection[str] | None = None) -> Scan:
        """Return a new pass over the file, for messages of some topics; None is all."""
        return Scan(self.path, self.index, topics)


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
    statistics, contents = index.statistics, found.contents
    assert statistics is not None
    for channel in index.channels.values():
        contents.topics[channel.topic] = topic_of(channel, index.schemas.get(channel.schema_id))
        contents.counts.setdefault(channel.topic, 0)
        count = statistics.channel_message_counts.get(channel.id, 0)
        contents.counts[channel.topic] += count
    if statistics.message_count:
        contents.start = statistics.message_start_time
        contents.end = statistics.message_end_time
    found.attachments = {entry.name: entry.offset for entry in index.attachment_indexes}


def _read_through(found: Survey) -> None:
    contents = found.contents
    found.scan = scan = found.rescan()
    for batch in scan:
        for topic, messages in batch.items():
            contents.counts[topic] = contents.counts.get(topic, 0) + len(messages.data)
            contents.start = min(contents.start, *messages.log_times)
            contents.end = max(contents.end, *messages.log_times)
    for channel in scan.channels:
        contents.topics[channel.topic] = topic_of(channel, scan.schemas.get(channel.schema_id))
        contents.counts.setdefault(channel.topic, 0)
    found.attachments = scan.attachments
    if found.index is not None and found.index.statistics is not None:
        missing = found.index.statistics.message_count - contents.message_count
        if missing:
            scan.damage.append(f"{missing} messages")


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
