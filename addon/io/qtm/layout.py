# SPDX-License-Identifier: GPL-3.0-or-later
"""How a `.qtm` says that its data lie: kinds of items and of fields by name, and the tree of items.

The file describes itself: `Metadata` names every kind of item and every field, with the kinds of its parts; `Data
Items` is a tree of items that have fields by their numbers there. So records are read by the names of their parts.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...core.data.errors import InputError
from .container import KIND, Container

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

    def field(self, name: str) -> int:
        """The number of a field, from 1; 0 where there is none."""
        return next((number for number, one in enumerate(self.fields, 1) if one.name == name), 0)

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
    cursor = Cursor(container.stream(ITEMS).whole(MAX_ITEM_BYTES), ITEMS, container.path)
    tree = _Tree(cursor, schema)
    root = tree.rest_of("", 0)
    if cursor.at != len(cursor.content):
        raise cursor.trouble("goes on behind its end")
    return root


class _Tree:
    """Reads items within items."""

    def __init__(self, cursor: Cursor, schema: Schema):
        self.cursor, self.schema, self.count = cursor, schema, 0

    def item(self, depth: int) -> Item:
        kind, _ = self.cursor.word(), self.cursor.word()
        self.count += 1
        if self.count > MAX_ITEMS or depth > MAX_DEPTH:
            raise self.cursor.trouble("has too many items")
        kinds = self.schema.kinds
        return self.rest_of(kinds[kind - 1][0] if 0 < kind <= len(kinds) else "", depth)

    def rest_of(self, kind: str, depth: int) -> Item:
        """The item behind its kind and number: fields, ranges, items within, and in which order these are shown."""
        cursor, fields = self.cursor, {}
        for _ in range(cursor.word()):
            number, size = cursor.word(), cursor.word()
            known = 0 < number <= len(self.schema.fields)
            fields[self.schema.fields[number - 1].name if known else str(number)] = cursor.bytes(size)
        ranges = cursor.words(2 * cursor.word()).reshape(-1, 2)
        within = [self.item(depth + 1) for _ in range(cursor.word())]
        for _ in range(cursor.word()):
            cursor.word()
            cursor.words(cursor.word())
        return Item(kind, fields, ranges, within)
