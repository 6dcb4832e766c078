# SPDX-License-Identifier: GPL-3.0-or-later
"""OptiTrack Motive's `.csv` export of markers, labelled or not."""

import codecs
import csv
from collections.abc import Iterator
from pathlib import Path

from ..core.data.errors import InputError
from ..core.data.takes import MAX_RATE_HZ, MIN_RATE_HZ
from .source import decode, open_binary, read_bytes
from .textpoints import TextTake, count_in, rows_to_samples

KIND = "a Motive .csv export"

OPENINGS = ("format version", "take name")

# Where a file has several kinds of marker, the first of these is what the cameras saw.
KINDS = ("marker", "unlabeled marker", "rigid body marker", "bone marker")


def is_motive(path: Path) -> bool:
    """Whether a file begins with Motive's settings, as its exports of points do and files of blobs do not."""
    with open_binary(path) as file:
        head = file.readline(4096)
    first = head.removeprefix(codecs.BOM_UTF8).decode("latin-1").partition(",")[0]
    return first.strip().strip('"').lower() in OPENINGS


def read_motive(path: Path) -> TextTake:
    """Raises InputError with the line where the file is not as Motive writes it."""
    text = decode(read_bytes(path), path, KIND)
    lines = text.splitlines()
    head = _fields(lines[0] if lines else "", path, 1)
    settings = dict(zip((key.strip().lower() for key in head[::2]), head[1::2], strict=False))
    if not any(opening in settings for opening in OPENINGS):
        raise InputError(f"does not begin with Motive's settings; expected {KIND}", path, 1)
    rate = _rate(settings, path)
    titles, start = _titles(lines, path)
    kinds, names, properties = (titles.get(key, []) for key in ("type", "name", "property"))
    labels, columns = _markers(kinds, names, properties, path, start)
    first, frames, parts = rows_to_samples(_rows(lines, start, path), columns, path)
    promised, count = settings.get("total exported frames", "").strip(), sum(map(_is_row, lines[start:]))
    if count_in(promised) > count:
        raise InputError(f"has {count} of {promised} frames; expected all of them (is the file cut off?)", path)
    return TextTake(labels, frames, parts, settings.get("length units", "").strip().lower(), rate, first)


def _is_row(line: str) -> bool:
    return bool(line.strip(", \t"))


def _rows(lines: list[str], start: int, path: Path) -> Iterator[tuple[int, list[str]]]:
    """The number and the fields of each row from `start` on."""
    width, empty = len(_fields(lines[start - 1], path, start)), True
    for number, line in enumerate(lines[start:], start + 1):
        if not _is_row(line):
            continue
        fields = line.split(",") if '"' not in line else _fields(line, path, number)
        if len(fields) != width and not (len(fields) < width and number < len(lines)):
            raise InputError(f"has {len(fields)} fields; expected {width} (is the file cut off?)", path, number)
        empty = False
        yield number, fields
    if empty:
        raise InputError("has no frames; expected at least one", path)


def _rate(settings: dict[str, str], path: Path) -> float:
    for key in ("export frame rate", "capture frame rate"):
        try:
            rate = float(settings.get(key, ""))
        except ValueError:
            continue
        if MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
            return rate
    raise InputError("has no Export Frame Rate; expected frames a second", path, 1)


def _titles(lines: list[str], path: Path) -> tuple[dict[str, list[str]], int]:
    """The rows above the data by what they hold, and how many lines there are up to the data."""
    titles: dict[str, list[str]] = {}
    for number, line in enumerate(lines[1:12], 2):
        fields = _fields(line, path, number)
        first, second = [*fields, "", ""][:2]
        if first.strip().lower() == "frame":
            return titles, number
        if second.strip().lower() in ("type", "name"):
            titles[second.strip().lower()] = fields
        elif any(field.strip() in ("Position", "Rotation") for field in fields):
            titles["property"] = fields
    raise InputError(f"has no row that begins with Frame; expected {KIND}", path, min(len(lines), 12))


def _markers(
    kinds: list[str], names: list[str], properties: list[str], path: Path, line: int
) -> tuple[list[str], list[int]]:
    """Names of the markers and where their columns begin."""
    starts: dict[str, list[tuple[str, int]]] = {}
    column = 2
    while column + 2 < len(names):
        kind = kinds[column].strip().lower().removesuffix(" (measured)") if column < len(kinds) else "marker"
        here = names[column : column + 3]
        position = all(field.strip() == "Position" for field in properties[column : column + 3]) if properties else True
        if position and len(set(here)) == 1:
            starts.setdefault(kind, []).append((here[0].strip(), column))
            column += 3
        else:
            column += 1
    chosen = next((starts[kind] for kind in KINDS if kind in starts), None)
    if not chosen:
        raise InputError(f"has no columns of marker positions; expected {KIND} of markers", path, line)
    return [name for name, _ in chosen], [column for _, column in chosen]


def _fields(line: str, path: Path, number: int) -> list[str]:
    try:
        return next(csv.reader([line]), [])
    except csv.Error:
        raise InputError(f"is not a row of a CSV file; expected {KIND}", path, number) from None
