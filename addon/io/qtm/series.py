# SPDX-License-Identifier: GPL-3.0-or-later
"""One data series of a `.qtm`: records in blocks of LZO1X, each unpacked when it is asked for."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...core.data.errors import InputError
from .container import KIND, Container

SERIES_FOLDER = "Measurement NBC/Data series"

# A block: where it begins, its length there, and unpacked.
SERIES_BLOCK = np.dtype([("start", "<u8"), ("packed", "<u4"), ("unpacked", "<u4")])


@dataclass(frozen=True)
class SeriesLimits:
    """What no series has; format, and memory.

    max_block  bytes of a block, packed or unpacked: they have 32 KB. LZO makes at most 255 bytes of one, so unpacking
               a block that lies about its size takes no more than some 255 of these
    max_index  bytes of the list of blocks: a million of them, 32 GB of records
    """

    max_block: int = 1 << 18
    max_index: int = 1 << 24


SERIES = SeriesLimits()


class Series:
    """A series, by its number; `size` bytes when unpacked."""

    def __init__(self, container: Container, number: int):
        """Raises InputError where its list of blocks cannot be."""
        self.container, self.number = container, number
        self.what = f"data series {number}"
        self._stream = container.stream(f"{SERIES_FOLDER}/{number}")
        index = container.stream(f"{SERIES_FOLDER}/{number}Index").whole(SERIES.max_index)
        count = int.from_bytes(index[:4], "little")
        if len(index) < 4 or len(index) != 4 + SERIES_BLOCK.itemsize * count:
            raise self.trouble("a list of blocks that is cut off")
        self._blocks = np.frombuffer(index, SERIES_BLOCK, count, 4)
        # One after the other: so nobody makes much of a few bytes that are named many times.
        ends = np.cumsum(self._blocks["packed"], dtype=np.int64)
        starts = ends - self._blocks["packed"]
        if (self._blocks["start"] != starts).any() or (ends[-1] if count else 0) > self._stream.size:
            raise self.trouble("blocks that are cut off, or do not follow each other")
        if max(self._blocks[name].max(initial=0) for name in ("packed", "unpacked")) > SERIES.max_block:
            raise self.trouble(f"a block of over {SERIES.max_block >> 10} KB")
        self.size = int(self._blocks["unpacked"].sum(dtype=np.int64))

    def blocks(self) -> Iterator[bytes]:
        """What the blocks hold, one after the other; InputError where one is damaged."""
        unpack = unpacker(self.container)
        for start, packed, unpacked in self._blocks.tolist():
            content = unpack(self._stream.part(start, start + packed), unpacked)
            if content is None or len(content) != unpacked:
                raise self.trouble(f"a damaged block at byte {start}")
            yield content

    def trouble(self, what: str) -> InputError:
        """The error to raise where the series has what none has."""
        return InputError(f"has {what} in its {self.what}; expected {KIND}", self.container.path)


def unpacker(container: Container):
    """What unpacks a block of LZO1X, `unpack(packed, size)`, None where it is damaged."""
    try:
        from lzallright import InputNotConsumed, LZOCompressor, LZOError
    except ImportError:
        words = "is unpacked by the package lzallright, which is not here; expected it to be installed"
        raise InputError(words, container.path) from None

    def unpack(packed: bytes, size: int) -> bytes | None:
        try:
            return LZOCompressor.decompress(packed, size)
        except (InputNotConsumed, LZOError):
            return None

    return unpack
