"""The index of a bag's chunks, kept on the disk until the bag is closed.

A recorder ends ten chunks a second, and mcap's writer remembers where each is until the end: in
memory it would grow by 9 kB/s.
"""

import shutil
import tempfile
from collections.abc import Iterator
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer

# mcap's name of its list, which it appends to, and writes one by one at the end.
_LIST = "_Writer__chunk_indices"


class SpilledIndex:
    """What mcap's writer takes for its list of chunk indexes."""

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
