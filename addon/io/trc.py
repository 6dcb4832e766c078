# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion Analysis `.trc`: five lines of head, then tab-separated frame, time and coordinates."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.lanes import blocks
from ..core.data.takes import MAX_RATE_HZ, MIN_RATE_HZ
from .names import written
from .source import decode, read_bytes
from .textpoints import TextTake, count_in, rows_to_samples

KIND = "a .trc file"

# The format has no word for the axis that points up, and most of its files have y up; ours say here that it is z.
Z_UP = "Z_UP"

WIDTH_ROWS = 1000  # rows that are looked at where nothing else says how many markers there are


def read_trc(path: Path) -> TextTake:
    """Raises InputError with the line where the file is not as the format says."""
    text = decode(read_bytes(path), path, KIND)
    lines, ended = text.splitlines(), text.endswith(("\n", "\r"))
    if len(lines) < 5 or not lines[0].lstrip().lower().startswith("pathfiletype"):
        raise InputError(f"does not begin with PathFileType; expected {KIND}", path, 1)
    head = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    rate = _number(head.get("DataRate"), "DataRate", path)
    if not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
        raise InputError(f"has a DataRate of {rate:g}; expected frames a second", path, 3)
    begin = next((index for index in (4, 5) if _is_row(lines, index)), 5)
    labels = _labels(lines[3], head.get("NumMarkers", ""), lines[begin:])
    if not labels or not any(labels):
        raise InputError(f"names no markers; expected {KIND}", path, 4)
    columns = [2 + 3 * index for index in range(len(labels))]
    first, frames, parts = rows_to_samples(_rows(lines, begin, ended, 2 + 3 * len(labels), path), columns, path)
    _refuse_cut_off(head, frames, first, path)
    up = "+Z" if Z_UP in lines[0] else ""
    return TextTake(labels, frames, parts, head.get("Units", "").lower(), rate, first, up)


def _rows(lines: list[str], begin: int, ended: bool, widest: int, path: Path) -> Iterator[tuple[int, list[str]]]:
    """The number and the fields of each row from `begin` on, of a text that `ended` with a line's end."""
    width = 0
    for number, line in enumerate(lines[begin:], begin + 1):
        if not line.strip():
            continue
        fields = line.split("\t")
        if len(fields) > widest and any(field.strip() for field in fields[widest:]):
            raise InputError(f"has {len(fields)} fields; expected {widest} as the names in line 4 say", path, number)
        if number == len(lines) and (len(fields) < 3 or (not ended and len(fields) < width)):
            raise InputError(f"ends in the middle of a row; expected {widest} fields", path, number)
        width = len(fields)
        yield number, fields
    if not width:
        raise InputError("has no frames; expected at least one", path)


def _is_row(lines: list[str], index: int) -> bool:
    """Whether a line is a row of coordinates; some programs leave out the line with X1, Y1, Z1."""
    first = lines[index].split("\t")[0].strip() if index < len(lines) else ""
    return first.isascii() and first.isdigit()


def _labels(line: str, promised: str, rows: list[str]) -> list[str]:
    """The markers' names, empty for those without one, in the order of their columns.

    The format has a name above the first of a marker's three columns. Other programs put one tab or two behind a name,
    a name above each column (`LASI_x`, `LASI_y`, `LASI_z`), or a space before the first; then it is the number of the
    names that has to fit NumMarkers and the rows.
    """
    fields = [field.strip() for field in line.rstrip("\t ").split("\t")]
    if len(fields) > 1 and fields[1].lower().startswith("time "):
        fields[1:2] = fields[1].split(None, 1)
    labels = fields[2:]
    names = [label for label in labels if label]
    said = count_in(promised)
    width = max((_width(row) for row in rows[:WIDTH_ROWS]), default=0)
    count = max(said, -((2 - width) // 3))
    if count == len(names):
        return names
    stems = [name[:-1].rstrip("_. ") for name in names]
    axes = "".join(name[-1].lower() for name in names)
    if len(names) == 3 * count and axes == "xyz" * count and stems[::3] == stems[1::3] == stems[2::3] and all(stems):
        return stems[::3]
    return labels[::3]


def _width(row: str) -> int:
    """The number of fields up to the last that says something."""
    return len(row.rstrip().split("\t")) if row.strip() else 0


def _refuse_cut_off(head: dict[str, str], frames: int, first: int, path: Path):
    """InputError where the head promises more frames; one that begins later is a part that somebody took out."""
    promised, begins = head.get("NumFrames", ""), head.get("OrigDataStartFrame", "")
    if count_in(promised) > frames and begins == str(first):
        raise InputError(f"has {frames} of {promised} frames; expected all of them (is the file cut off?)", path)


def _number(text: str | None, what: str, path: Path) -> float:
    try:
        return float(text or "")
    except ValueError:
        raise InputError(f"has no number under {what}; expected {KIND}", path, 3) from None


def write_trc_file(path: Path, labels: list[str], xyz: np.ndarray, rate: float, first_frame: int):
    """Writes points (T, P, 3) m as mm; missing samples are empty fields."""
    frames, count = xyz.shape[:2]
    head = [
        f"PathFileType\t4\t(X/Y/Z)\t{written(Path(path).name)}\t{Z_UP}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate:.6g}\t{rate:.6g}\t{frames}\t{count}\tmm\t{rate:.6g}\t{first_frame}\t{frames}",
        "Frame#\tTime\t" + "\t\t\t".join(written(label.replace("\t", " ")) for label in labels) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{index}" for index in range(1, count + 1) for axis in "XYZ"),
        "",
    ]
    with Path(path).open("w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(head) + "\n")
        for part in blocks(frames, count):
            for index, points in zip(range(part.start, part.stop), xyz[part], strict=True):
                values = (1000.0 * np.asarray(points, dtype=float)).ravel().tolist()
                fields = ("" if value != value else f"{value:.5f}" for value in values)
                file.write(f"{first_frame + index}\t{index / rate:.6f}\t" + "\t".join(fields) + "\n")
