# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of blobs out of text: blocks as arrays where the text is plain, line by line where not."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from io import BytesIO
from operator import itemgetter
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import MAX_FRAME
from ..core.geometry.cameras import Cameras
from .text import in_cell

COLUMNS = ("frame", "camera", "x", "y")

# No sensor is a million pixels wide: beyond this, or MAX_FRAME, a number stands in the wrong column.
MAX_PIXEL = 1e6
HEAD_BYTES = 4096  # where a file that is no text shows it; later a byte that is no text has a line of its own

_FIELD = re.compile(rb'("(?:[^"]|"")*"|[^,"]*)(,|$)')
AREA_KIND = "S32"  # letters of an area, beyond which none has any


@dataclass(frozen=True)
class Header:
    """Where the columns stand: an index each, `area` -1 where there is none; `count` columns in all."""

    frame: int
    camera: int
    x: int
    y: int
    area: int
    count: int


@dataclass(frozen=True, eq=False)
class Rows:
    """N rows: frame (N,), camera (N,) index, xy (N, 2) px, area (N,) px², the keys' text, and the line of each row."""

    frame: np.ndarray
    camera: np.ndarray
    xy: np.ndarray
    area: np.ndarray
    keys: list[str]
    lines: np.ndarray

    def __len__(self) -> int:
        return len(self.frame)

    def cut(self, start: int, stop: int) -> "Rows":
        """Rows `start` to `stop`, the last not included."""
        return Rows(**{field.name: getattr(self, field.name)[start:stop] for field in fields(self)})

    def between(self, first: int | None, last: int | None) -> "Rows":
        """The rows of frames `first` to `last`; the frames ascend."""
        start = 0 if first is None else int(np.searchsorted(self.frame, first))
        stop = len(self) if last is None else int(np.searchsorted(self.frame, last, side="right"))
        return self if (start, stop) == (0, len(self)) else self.cut(start, stop)

    @staticmethod
    def join(parts: Sequence["Rows"]) -> "Rows":
        """All parts one after the other."""
        if len(parts) == 1:
            return parts[0]
        names = ("frame", "camera", "xy", "area", "lines")
        arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return Rows(**arrays, keys=[key for part in parts for key in part.keys])


def read_header(head: bytes, path: Path, or_points: bool = False) -> tuple[Header, int]:
    """The columns and the offset of the first row, from the beginning of the file.

    InputError where it is none of blobs; with `or_points` it might have been one of 3D points as well.
    """
    expected = "expected a blob file with the header frame,camera,x,y and optionally area"
    if or_points:
        expected += ", or a take of 3D points: .c3d, .trc, Motive or Vicon .csv, or Qualisys .tsv"
    if not head:
        raise InputError(f"is empty; {expected}", path)
    if b"\0" in head[:HEAD_BYTES]:
        raise InputError(f"is a binary file; {expected}", path)
    mark = 3 if head.startswith(b"\xef\xbb\xbf") else 0
    line, newline, _ = head[mark:].partition(b"\n")
    if b"\r" in line.rstrip(b"\r"):
        raise InputError("ends its lines with carriage returns alone; expected line feeds", path, 1)
    names = [name.strip().strip('"').lower() for name in line.decode("utf-8", "replace").strip().split(",")]
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        what = f"has no column {' or '.join(missing)}"
        if len(missing) == len(COLUMNS):
            what = (
                "has semicolons between its fields"
                if b";" in line
                else f"holds {'neither blobs nor 3D points' if or_points else 'no blobs'}, for it has no header"
            )
        raise InputError(f"{what}; {expected}", path, 1)
    doubled = [name for name in (*COLUMNS, "area") if names.count(name) > 1]
    if doubled:
        raise InputError(f"has the column {doubled[0]} twice; {expected}", path, 1)
    area = names.index("area") if "area" in names else -1
    frame, camera, x, y = map(names.index, COLUMNS)
    header = Header(frame, camera, x, y, area, len(names))
    return header, mark + len(line) + len(newline)


def parse_rows(block: bytes, header: Header, cameras: Cameras, path: Path, line: int) -> Rows:
    """The rows of a block of whole lines, the first of which is line `line` of the file."""
    if b"\r" in block:
        block = block.replace(b"\r\n", b"\n")
    if block and not block.endswith(b"\n"):
        block += b"\n"
    rows = parse_plain(block, header, cameras, line)
    return parse_lines(block, header, cameras, path, line) if rows is None else rows


def parse_plain(block: bytes, header: Header, cameras: Cameras, line: int) -> Rows | None:
    """All rows at once as arrays; None where the text is not plain, correct rows: those are for `parse_lines`."""
    if b'"' in block or b"\0" in block or not block.strip():
        return None
    names = np.array([name.encode("utf-8") for name in cameras.names])
    kinds = dict.fromkeys(range(header.count), "S1") | dict.fromkeys((header.frame, header.x, header.y), "f8")
    kinds |= {header.camera: f"S{names.dtype.itemsize + 1}"}  # a longer name is none of them, also when it is cut
    kinds |= {header.area: AREA_KIND} if header.area >= 0 else {}
    named = [(str(column), kind) for column, kind in kinds.items()]
    try:
        table = np.loadtxt(BytesIO(block), named, delimiter=",", comments=None, encoding="latin-1", ndmin=1)
        area = table[str(header.area)] if header.area >= 0 else np.full(len(table), b"")
        area = np.where(area == b"", b"nan", area).astype(float)
    except ValueError:
        return None
    frame, xy = table[str(header.frame)], np.column_stack([table[str(header.x)], table[str(header.y)]])
    order, written = np.argsort(names), table[str(header.camera)]
    camera = order[np.minimum(np.searchsorted(names, written, sorter=order), len(names) - 1)]
    sound = (np.abs(frame) <= MAX_FRAME) & (frame % 1 == 0) & (np.abs(xy) <= MAX_PIXEL).all(axis=1)
    sound &= (names[camera] == written) & ~((area < 0) | np.isinf(area))
    if not sound.all() or len(table) != block.count(b"\n"):
        return None
    fields = itemgetter(header.frame, header.camera, header.x, header.y)
    keys = [",".join(fields(row.split(","))) for row in block.decode("utf-8", "surrogateescape").split("\n")[:-1]]
    return Rows(frame.astype(np.int64), camera, xy, area, keys, np.arange(line, line + len(table)))


def parse_lines(block: bytes, header: Header, cameras: Cameras, path: Path, line: int) -> Rows:
    """The same rows one by one: quoted names, spaces, exponents; InputError with the line of the first wrong one."""
    indices = {name: index for index, name in enumerate(cameras.names)}
    values, keys, lines = [], [], []
    for number, content in enumerate(block.split(b"\n")[:-1], line):
        if not content.strip():
            continue
        fields = _split(content, header.count, path, number)
        values.append(_row(fields, header, indices, path, number))
        keys.append(",".join(fields[index] for index in (header.frame, header.camera, header.x, header.y)))
        lines.append(number)
    if not values:
        return Rows(
            np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), [], np.zeros(0, np.int64)
        )
    frame, camera, x, y, area = zip(*values, strict=True)
    xy = np.column_stack([x, y]).astype(float)
    return Rows(np.array(frame), np.array(camera), xy, np.array(area, float), keys, np.array(lines))


def _split(content: bytes, count: int, path: Path, line: int) -> list[str]:
    """The fields of one line, quotes and all."""
    if b"\0" in content:
        raise InputError(
            "has bytes that are no text; expected a blob file with the header frame,camera,x,y", path, line
        )
    fields, position, separator = [], 0, b","
    while separator:
        match = _FIELD.match(content, position)
        if match is None:
            raise InputError("has a quote that is not closed; expected a row of a CSV file", path, line)
        fields.append(match.group(1).decode("utf-8", "surrogateescape"))
        position, separator = match.end(), match.group(2)
    if len(fields) != count:
        raise InputError(
            f"has {len(fields)} fields; expected {count} as in the header (is the file cut off?)", path, line
        )
    return fields


def _row(fields: list[str], header: Header, indices: dict[str, int], path: Path, line: int) -> tuple:
    frame = _number(fields[header.frame], "frame", path, line)
    if frame % 1 or abs(frame) > MAX_FRAME:
        limit = f" up to {MAX_FRAME}" if abs(frame) > MAX_FRAME else ""
        raise InputError(f"frame is {fields[header.frame].strip()[:40]}; expected a whole number{limit}", path, line)
    x, y = (_number(fields[index], name, path, line) for name, index in (("x", header.x), ("y", header.y)))
    if max(abs(x), abs(y)) > MAX_PIXEL:
        raise InputError(f"blob at {x:g}, {y:g} is on no image; expected pixels", path, line)
    area = np.nan
    if header.area >= 0 and fields[header.area].strip(' \t"').lower() not in ("", "nan"):
        area = _number(fields[header.area], "area", path, line)
        if area < 0:
            raise InputError(f"area is {area:g}; expected square pixels, or nothing", path, line)
    return int(frame), _camera(fields[header.camera], indices, path, line), x, y, area


def _number(field: str, name: str, path: Path, line: int) -> float:
    text = field.strip(' \t"')
    try:
        value = float(text) if "_" not in text and text.isascii() else np.nan
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{name} is {text[:40]!r}; expected a finite number", path, line)
    return value


def _camera(field: str, indices: dict[str, int], path: Path, line: int) -> int:
    name = field
    if field.strip().startswith('"'):
        name = field.strip()[1:-1].replace('""', '"')
    index = indices.get(name, indices.get(name.strip(), indices.get(in_cell(name.strip()))))
    if index is None:
        known = ", ".join(list(indices)[:6]) + (", …" if len(indices) > 6 else "")
        raise InputError(f"camera {name.strip()[:60]!r} is not in the calibration; expected one of {known}", path, line)
    return index
