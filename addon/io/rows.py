# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of blobs out of text, millions a second: blocks as arrays where the text is plain, line by line where not."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
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
_POWERS = 10.0 ** np.arange(19)


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

    def line_of(self, index: int) -> int:
        """The line of the file that a row stands in."""
        return int(self.lines[index])

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


def read_header(head: bytes, path: Path) -> tuple[Header, int]:
    """The columns and the offset of the first row, from the beginning of the file."""
    expected = (
        "expected a blob file with the header frame,camera,x,y and optionally area, or a take of 3D points: .c3d, .trc "
        "or Motive .csv"
    )
    if not head:
        raise InputError(f"is empty; {expected}", path)
    if b"\0" in head[:HEAD_BYTES]:
        raise InputError(f"is a binary file; {expected}", path)
    mark = 3 if head.startswith(b"\xef\xbb\xbf") else 0
    line, newline, _ = head[mark:].partition(b"\n")
    names = [name.strip().strip('"').lower() for name in line.decode("utf-8", "replace").strip().split(",")]
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        what = f"has no column {' or '.join(missing)}"
        if len(missing) == len(COLUMNS):
            what = (
                "has semicolons between its fields"
                if b";" in line
                else "holds neither blobs nor 3D points, for it has no header"
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
    if b'"' in block or b"\0" in block:
        return None
    text = np.frombuffer(block, np.uint8)
    ends = np.flatnonzero(text == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    found = np.flatnonzero(text == ord(","))
    if len(found) != len(ends) * (header.count - 1):
        return None
    commas = found.reshape(len(ends), header.count - 1)
    if len(ends) and not ((commas[:, 0] >= starts).all() and (commas[:, -1] < ends).all()):
        return None
    edges = np.column_stack([starts - 1, commas, ends])
    # A field may reach past the end of the block when it is looked at by columns.
    longest = max((len(name.encode("utf-8")) for name in cameras.names), default=0)
    text = np.concatenate([text, np.zeros(max(64, longest), np.uint8)])

    def field(index: int) -> tuple[np.ndarray, np.ndarray]:
        return edges[:, index] + 1, edges[:, index + 1] - edges[:, index] - 1

    frame = _decimals(text, *field(header.frame))
    x, y = _decimals(text, *field(header.x)), _decimals(text, *field(header.y))
    camera = _cameras(text, *field(header.camera), cameras)
    area = np.full(len(ends), np.nan) if header.area < 0 else _areas(text, *field(header.area))
    if frame is None or x is None or y is None or camera is None or area is None:
        return None
    if (np.abs(frame) > MAX_FRAME).any() or (frame % 1).any():
        return None
    if max(np.abs(x).max(initial=0), np.abs(y).max(initial=0)) > MAX_PIXEL or (area < 0).any():
        return None
    keys = _keys(block, edges, header)
    return Rows(frame.astype(np.int64), camera, np.column_stack([x, y]), area, keys, np.arange(line, line + len(ends)))


def _decimals(text: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> np.ndarray | None:
    """Numbers such as -12.75 (N,), right to the last bit up to 15 digits; None when one is written any other way."""
    if not len(starts):
        return np.zeros(0)
    negative = text[starts] == ord("-")
    starts, lengths = starts + negative, lengths - negative
    width = int(lengths.max())
    if width > 18 or lengths.min() < 1:
        return None
    value, after = np.zeros(len(starts), np.int64), np.zeros(len(starts), np.int64)
    point, digits = np.zeros(len(starts), bool), np.zeros(len(starts), bool)
    for column in range(width):
        sign = text[starts + column]
        active = lengths > column
        digit = sign - np.uint8(ord("0"))
        is_digit = (digit < 10) & active
        is_point = (sign == ord(".")) & active
        if (active & ~is_digit & (~is_point | point)).any():
            return None
        np.multiply(value, 10, out=value, where=is_digit)
        np.add(value, digit, out=value, where=is_digit)
        after += is_digit & point
        point |= is_point
        digits |= is_digit
    if not digits.all():
        return None
    return np.where(negative, -1.0, 1.0) * value / _POWERS[after]


def _areas(text: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> np.ndarray | None:
    """Areas (N,), NaN where the field is empty; None where one is not plain."""
    area = np.full(len(starts), np.nan)
    given = lengths > 0
    values = _decimals(text, starts[given], lengths[given])
    if values is None:
        return None
    area[given] = values
    return area


def _cameras(text: np.ndarray, starts: np.ndarray, lengths: np.ndarray, cameras: Cameras) -> np.ndarray | None:
    """Camera indices (N,); None where a name is not among the cameras."""
    if not len(starts):
        return np.zeros(0, np.int64)
    names = [name.encode("utf-8") for name in cameras.names]
    width = int(lengths.max())
    if width > max(map(len, names)) or lengths.min() < 1:
        return None
    if width > 8:
        columns = np.arange(width)
        letters = np.where(columns < lengths[:, None], text[starts[:, None] + columns], 0).astype(np.uint8)
        written, known = letters.view(f"S{width}").ravel(), np.array(names)
    else:
        # Up to eight letters are one whole number, and numbers are found ten times faster than texts.
        written = np.zeros(len(starts), np.uint64)
        for column in range(width):
            letter = np.where(lengths > column, text[starts + column], 0).astype(np.uint64)
            written |= letter << np.uint64(8 * column)
        known = np.array([int.from_bytes(name, "little") if len(name) <= 8 else 0 for name in names], np.uint64)
    order = np.argsort(known)
    places = np.minimum(np.searchsorted(known, written, sorter=order), len(known) - 1)
    found = order[places]
    return found if (known[found] == written).all() else None


def _keys(block: bytes, edges: np.ndarray, header: Header) -> list[str]:
    text = block.decode("ascii") if block.isascii() else None
    fields = (header.frame, header.camera, header.x, header.y)
    if fields == (0, 1, 2, 3) and text is not None:
        if header.count == 4:
            return text.split("\n")[:-1]
        return [text[start:end] for start, end in zip((edges[:, 0] + 1).tolist(), edges[:, 4].tolist(), strict=True)]
    bounds = [zip((edges[:, index] + 1).tolist(), edges[:, index + 1].tolist(), strict=True) for index in fields]
    parts = [[block[start:end].decode("utf-8", "surrogateescape") for start, end in pairs] for pairs in bounds]
    return [",".join(row) for row in zip(*parts, strict=True)]


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
