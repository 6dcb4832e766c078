# SPDX-License-Identifier: GPL-3.0-or-later
"""The container of a `.qtm`, an OLE compound file read part by part, and how it says that its data lie.

The file describes itself: `Metadata` names every kind of item and every field, with the kinds of its parts; `Data
Items` is a tree of items that have fields by their numbers there. So records are read by the names of their parts.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...core.data.errors import InputError
from ..source import BytesOnDisk

if TYPE_CHECKING:
    from olefile.olefile import OleDirectoryEntry


KIND = "a capture as Qualisys Track Manager saves it"
OLE_MAGIC = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
# Of a compound file: sizes of large and small sectors as powers of two, how many tables of the large, what lies in
# small ones, and how many sectors their table has.
OLE_HEAD = struct.Struct("<30xHH10xL8xL4xL")
OLE_SHIFTS = (9, 12)  # versions 3 and 4
END_OF_CHAIN = 0xFFFFFFFC  # and the three words above it are no sectors either

# What olefile lets escape from files that are damaged.
DAMAGE = (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError, OverflowError, struct.error)


class Container:
    """An open `.qtm`; a context manager."""

    def __init__(self, path: Path):
        """Raises InputError where there is no such file, or it is no compound file."""
        self.path = Path(path)
        self.file = BytesOnDisk(self.path)
        try:
            _check_head(self.file, self.path)
            self._ole = _opened(self.file, self.path)
            self.sector_size = self._ole.sectorsize  # bytes
        except BaseException:
            self.file.file.close()
            raise

    def close(self):
        """Closes the file."""
        self.file.file.close()

    def names(self, folder: str) -> list[str]:
        """What a folder holds, "" for the file itself; empty where there is none of that name."""
        entry = self._entry(folder) if folder else self._ole.root
        return [] if entry is None else [kid.name for kid in entry.kids]

    def stream(self, name: str) -> "Stream":
        """A stream by its path, such as "Measurement/Frames"; InputError where there is none or it is cut off."""
        entry = self._entry(name)
        if entry is None or entry.entry_type != 2:  # of a stream
            raise InputError(f"has no part {name!r}; expected {KIND}", self.path)
        return Stream(self, name, entry)

    def _entry(self, name: str) -> "OleDirectoryEntry | None":
        entry = self._ole.root
        for part in name.split("/"):
            # Names of compound files are told apart without regard to upper and lower case.
            entry = next((kid for kid in entry.kids if kid.name.lower() == part.lower()), None)
            if entry is None:
                return None
        return entry

    def small(self, entry: "OleDirectoryEntry") -> bytes:
        """The content of a stream that lies among the small ones."""
        try:
            return self._ole._open(entry.isectStart, entry.size).read()
        except DAMAGE:
            raise InputError(f"has a damaged part {entry.name!r}; expected {KIND}", self.path) from None

    def sectors(self, entry: "OleDirectoryEntry") -> np.ndarray:
        """(N,) where in the file each sector of a large stream begins."""
        size, table = self.sector_size, self._ole.fat
        found = np.empty(-(-entry.size // size), np.int64)
        sector = entry.isectStart
        for at in range(len(found)):
            if not 0 <= sector < min(len(table), END_OF_CHAIN):
                raise InputError(f"has a part {entry.name!r} that is cut off; expected {KIND}", self.path)
            found[at], sector = sector, table[sector]
        return (found + 1) * size


class Stream:
    """One stream of a container, `size` bytes of it."""

    def __init__(self, container: Container, name: str, entry: "OleDirectoryEntry"):
        self.container, self.name, self.size = container, name, entry.size
        if self.size > len(container.file):
            raise InputError(f"has a part {name!r} larger than the file; expected {KIND}", container.path)
        self._content = container.small(entry) if entry.is_minifat else None
        self._sectors = container.sectors(entry) if self._content is None else np.zeros(0, np.int64)
        if self._content is not None and len(self._content) != self.size:
            raise InputError(f"has a part {name!r} that is cut off; expected {KIND}", container.path)

    def part(self, start: int, stop: int) -> bytes:
        """The bytes from start to stop; InputError where the stream has fewer."""
        if not 0 <= start <= stop <= self.size:
            raise InputError(f"has a part {self.name!r} that is cut off; expected {KIND}", self.container.path)
        if self._content is not None:
            return self._content[start:stop]
        size, file = self.container.sector_size, self.container.file
        pieces = []
        for index in range(start // size, -(-stop // size)):
            at = int(self._sectors[index])
            low, high = max(start - index * size, 0), min(stop - index * size, size)
            if at + high > len(file):
                raise InputError(f"ends within its part {self.name!r}; expected a whole file", self.container.path)
            pieces.append(file[at + low : at + high])
        return b"".join(pieces)

    def whole(self, limit: int) -> bytes:
        """All of it; InputError where that is over `limit` bytes."""
        if self.size > limit:
            raise InputError(
                f"has a part {self.name!r} of {self.size} bytes; expected at most {limit}", self.container.path
            )
        return self.part(0, self.size)


def _check_head(file: BytesOnDisk, path: Path):
    """InputError where the first sector is no compound file's, or promises tables larger than the file."""
    head = file[: min(OLE_HEAD.size, len(file))]
    if head[:8] != OLE_MAGIC:
        raise InputError(f"is no OLE compound file; expected {KIND}", path)
    if len(head) < OLE_HEAD.size:
        _damaged(path)
    shift, small, tables, cutoff, small_tables = OLE_HEAD.unpack(head)
    entries = tables * (1 << shift) // 4 if shift in OLE_SHIFTS else 0
    # A table has an entry a sector, and one sector of it may be begun only.
    promised = entries > len(file) // (1 << shift) + (1 << shift) or small_tables << shift > len(file)
    if not entries or promised or (small, cutoff) != (6, 4096):
        _damaged(path)


def _opened(file: BytesOnDisk, path: Path):
    """The directory of a compound file; InputError where it is damaged, or olefile is not here."""
    try:
        import olefile
    except ImportError:
        raise InputError(
            "is read by the package olefile, which is not here; expected it to be installed", path
        ) from None
    try:
        ole = olefile.OleFileIO(file.file)
        # The root's size is that of all small streams, which are read together.
        return ole if ole.root is not None and ole.root.size <= len(file) else _damaged(path)
    except DAMAGE:
        _damaged(path)


def _damaged(path: Path):
    raise InputError(f"is a damaged compound file (is it cut off?); expected {KIND}", path)


SERIES_FOLDER = "Measurement NBC/Data series"

# A block: where it begins, its length there, and unpacked.
SERIES_BLOCK = np.dtype([("start", "<u8"), ("packed", "<u4"), ("unpacked", "<u4")])


# What no series has; format, and memory.
# bytes of a block, packed or unpacked: they have 32 KB. LZO makes at most 255 bytes of one, so unpacking a block that
# lies about its size takes no more than some 255 of these
MAX_BLOCK = 1 << 18
MAX_INDEX = 1 << 24  # bytes of the list of blocks: a million of them, 32 GB of records


class Series:
    """A series, by its number; `size` bytes when unpacked."""

    def __init__(self, container: Container, number: int):
        """Raises InputError where its list of blocks cannot be."""
        self.container, self.number = container, number
        self.what = f"data series {number}"
        self._stream = container.stream(f"{SERIES_FOLDER}/{number}")
        index = container.stream(f"{SERIES_FOLDER}/{number}Index").whole(MAX_INDEX)
        count = int.from_bytes(index[:4], "little")
        if len(index) < 4 or len(index) != 4 + SERIES_BLOCK.itemsize * count:
            raise self.trouble("a list of blocks that is cut off")
        self._blocks = np.frombuffer(index, SERIES_BLOCK, count, 4)
        # One after the other: so nobody makes much of a few bytes that are named many times.
        ends = np.cumsum(self._blocks["packed"], dtype=np.int64)
        starts = ends - self._blocks["packed"]
        if (self._blocks["start"] != starts).any() or (ends[-1] if count else 0) > self._stream.size:
            raise self.trouble("blocks that are cut off, or do not follow each other")
        if max(self._blocks[name].max(initial=0) for name in ("packed", "unpacked")) > MAX_BLOCK:
            raise self.trouble(f"a block of over {MAX_BLOCK >> 10} KB")
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


NBC = "Measurement NBC"
METADATA, ITEMS = f"{NBC}/Metadata", f"{NBC}/Data Items"

# Kinds of fields: numbers, a row of them with its count before it, and parts one after the other.
NUMBERS = {3: "<i4", 5: "u1", 6: "<u2", 7: "<u4", 8: "<u8", 9: "<f4", 10: "<f8", 15: "<u4"}
ROW_KIND, PARTS_KIND = 23, 24
FLAGS_KIND = 15  # a number whose bits have names


# What no capture has; format, and memory.
MAX_METADATA = 1 << 20  # bytes of the names of fields, which are 16,000
MAX_FIELDS = 10_000  # fields and kinds of items, which are 216
MAX_ITEM_BYTES = 1 << 26  # of the tree of items: 200 or 300 for a trajectory
MAX_ITEMS = 200_000  # in it: a long raw take has tens of thousands of trajectories
MAX_DEPTH = 16  # of items within items, which is 2


class Cursor:
    """Goes through the bytes of a part; whatever reaches beyond its end is an InputError."""

    def __init__(self, content: bytes, name: str, path: Path):
        self.content, self.name, self.path, self.at = content, name, path, 0

    def bytes(self, count: int) -> bytes:
        """The next bytes."""
        start, self.at = self.at, self.at + count
        if self.at > len(self.content):
            raise self.trouble("is cut off, or laid out otherwise")
        return self.content[start : self.at]

    def word(self) -> int:
        """The next unsigned number of 32 bits."""
        return int.from_bytes(self.bytes(4), "little")

    def words(self, count: int) -> np.ndarray:
        """(N,) the next so many of them."""
        return np.frombuffer(self.bytes(4 * count), "<u4").astype(np.int64)

    def text(self, width: int = 1) -> str:
        """The next text, its length in bytes before it, in UTF-8 or, with `width` 2, in UTF-16; no zeros at its end."""
        content = self.bytes(self.word())
        return content.decode("utf-8" if width == 1 else "utf-16-le", "replace").rstrip("\0")

    def trouble(self, what: str) -> InputError:
        """The error to raise where the part is not as it should be."""
        return InputError(f"has a part {self.name!r} that {what} (byte {self.at}); expected {KIND}", self.path)


@dataclass(frozen=True)
class SchemaField:
    """One field of the file's own description: its name, kind, first part and the next part beside it, 0 for none."""

    name: str
    kind: int
    first: int
    following: int


@dataclass(frozen=True, eq=False)
class Schema:
    """The file's own description: kinds of items as (name, number of the field that its series have), and fields."""

    path: Path
    kinds: tuple[tuple[str, int], ...]
    fields: tuple[SchemaField, ...]

    def record(self, kind: str) -> tuple[np.dtype, np.dtype | None]:
        """What the series of a kind of item hold: the head of each record and, of records with rows, a row's cell.

        InputError where the records are none that are understood.
        """
        head, cell = self._record(kind)
        return self._dtype(head, kind), None if cell is None else self._dtype(cell, kind)

    def bits(self, kind: str, name: str, row: bool = False) -> dict[str, int]:
        """The names of the bits of a part of a kind's records, or of their rows, each with its value."""
        head, cell = self._record(kind)
        parts = (cell or []) if row else head
        part = next((part for part in parts if part.name == name and part.kind == FLAGS_KIND), None)
        names = [] if part is None else [one.name for one in self._beside(part.first)]
        return {name: 1 << place for place, name in enumerate(names[:32])}

    def _record(self, kind: str) -> tuple[list[SchemaField], list[SchemaField] | None]:
        """The parts of a kind's records and, where a row ends them, those of its cells."""
        number = next((series for name, series in self.kinds if name == kind), 0)
        parts = list(self._parts(number))
        if parts and parts[-1].kind == ROW_KIND:
            return parts[:-1], list(self._parts(parts[-1].first))
        return parts, None

    def _parts(self, number: int) -> Iterator[SchemaField]:
        """The parts of a field."""
        whole = self.fields[number - 1] if 0 < number <= len(self.fields) else None
        return iter(()) if whole is None or whole.kind != PARTS_KIND else self._beside(whole.first)

    def _beside(self, number: int) -> Iterator[SchemaField]:
        for _ in range(len(self.fields)):
            if not 0 < number <= len(self.fields):
                return
            yield self.fields[number - 1]
            number = self.fields[number - 1].following

    def _dtype(self, parts: list[SchemaField], kind: str) -> np.dtype:
        names = [part.name for part in parts]
        unknown = [part.name for part in parts if part.kind not in NUMBERS]
        if not parts or unknown or len(set(names)) != len(names):
            words = f"describes the data of {kind} in a way that is not known"
            raise InputError(f"{words} ({', '.join(unknown[:3]) or 'no parts'}); expected {KIND}", self.path)
        return np.dtype([(part.name, NUMBERS[part.kind]) for part in parts])


@dataclass(frozen=True, eq=False)
class Item:
    """One item: its kind, its fields by name, the ranges of frames (N, 2) that its series covers, and items within."""

    kind: str
    fields: dict[str, bytes]
    ranges: np.ndarray
    within: list["Item"] = field(default_factory=list)

    def number(self, name: str) -> int | None:
        """A field that is a whole number; None where it is not there."""
        content = self.fields.get(name, b"")
        return int.from_bytes(content, "little") if len(content) in (1, 2, 4, 8) else None

    def real(self, name: str) -> float | None:
        """A field that is a real number; None where it is not there."""
        content = self.fields.get(name, b"")
        return float(np.frombuffer(content, "<f8")[0]) if len(content) == 8 else None

    def text(self, name: str) -> str:
        """A field that is a text: the number of its letters, then these in UTF-16; empty where it is not there."""
        content = self.fields.get(name, b"")
        return content[4:].decode("utf-16-le", "replace").partition("\0")[0]


def read_schema(container: Container) -> Schema:
    """What the file says of its own layout; InputError where that is not understood."""
    content = container.stream(METADATA).whole(MAX_METADATA)
    cursor = Cursor(content, METADATA, container.path)
    count, _ = cursor.word(), cursor.word()
    kinds = []
    for _ in range(_limited(count, cursor)):
        name, _ = cursor.text(), cursor.text(2)
        kinds.append((name, cursor.word()))
    count, _ = cursor.word(), cursor.word()
    fields = []
    for _ in range(_limited(count, cursor)):
        name, _, _, _ = cursor.text(), cursor.word(), cursor.bytes(1), cursor.text(2)
        kind, _, _, first, following = cursor.words(5).tolist()
        fields.append(SchemaField(name, kind, first, following))
    if cursor.at != len(content):
        raise cursor.trouble("goes on behind its end")
    return Schema(container.path, tuple(kinds), tuple(fields))


def _limited(count: int, cursor: Cursor) -> int:
    if count > MAX_FIELDS:
        raise cursor.trouble(f"has {count} entries")
    return count


def read_items(container: Container, schema: Schema) -> Item:
    """The root of the tree of items; InputError where it is not understood."""
    cursor, kinds, known = Cursor(container.stream(ITEMS).whole(MAX_ITEM_BYTES), ITEMS, container.path), schema.kinds, 0

    def item(depth: int) -> Item:
        nonlocal known
        kind, _ = cursor.word(), cursor.word()
        known += 1
        if known > MAX_ITEMS or depth > MAX_DEPTH:
            raise cursor.trouble("has too many items")
        return rest_of(kinds[kind - 1][0] if 0 < kind <= len(kinds) else "", depth)

    def rest_of(kind: str, depth: int) -> Item:
        """The item behind its kind and number: fields, ranges, items within, and in which order these are shown."""
        fields = {}
        for _ in range(cursor.word()):
            number, size = cursor.word(), cursor.word()
            name = schema.fields[number - 1].name if 0 < number <= len(schema.fields) else str(number)
            fields[name] = cursor.bytes(size)
        ranges = cursor.words(2 * cursor.word()).reshape(-1, 2)
        within = [item(depth + 1) for _ in range(cursor.word())]
        for _ in range(cursor.word()):
            cursor.word()
            cursor.words(cursor.word())
        return Item(kind, fields, ranges, within)

    root = rest_of("", 0)
    if cursor.at != len(cursor.content):
        raise cursor.trouble("goes on behind its end")
    return root
