"""The bytes of a chunk of an MCAP file, unpacked within bounds.

A few kilobytes can unpack to more than there is memory, and what a chunk says of its size is
worth what its writer is: so no more is unpacked than it says, and than a chunk may have.
"""

import zlib

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.records import Chunk

LARGEST = 2**28
"""Bytes of a record, or of a chunk unpacked, at most; recorders write chunks of some megabytes."""


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
