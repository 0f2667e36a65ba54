"""Contents of an MCAP file of a bag: from its index, or by reading it through."""

import dataclasses
from pathlib import Path
from typing import Any

from mcap.records import Channel, Schema
from mcap.summary import Summary

from eulerparams_control.bags.format import FileContents, Topic, load_yaml
from eulerparams_control.bags.scan import Scan, read_summary
from eulerparams_control.errors import BagError


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
    """Return what a channel and its schema say of a topic; a broken QoS profile counts as none."""
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
