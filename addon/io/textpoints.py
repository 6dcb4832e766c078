# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes of points that are written as text: Motion Analysis' TRC, Motive's and Vicon's CSV, and Qualisys' TSV."""

import codecs
import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.lanes import blocks
from ..core.data.made import Table
from ..core.data.takes import MAX_FRAME, MAX_RATE_HZ, MIN_RATE_HZ
from ..core.data.wording import words_of_frames
from .samples import PointFile, Samples, TextHead
from .source import decode, open_binary, read_bytes
from .text import written

# What is no take of points; physical, and memory.
MAX_COORDINATE = 1e9  # in any unit
MAX_GAP = 10_000  # frames that are left out between two rows: what it would fill the memory with is no take
MAX_FRAMES_A_ROW = 100  # and in all, beside that gap, for every row
ROWS_AT_ONCE = 1000  # whose samples are put together


def text_file(
    rows: Iterable[tuple[int, list[str]]],
    labels: Sequence[str],
    starts: Sequence[int],
    path: Path,
    rate: float,
    unit: str,
    word: str = "",
    promised: str = "",
) -> PointFile:
    """The points of rows as `rows_to_samples` takes them; of a world with y up where the file does not say."""
    first, frames, parts = rows_to_samples(rows, starts, path, promised)
    columns = np.arange(len(labels))
    return PointFile(labels, columns, len(labels), frames, rate, first, lambda: parts, unit.lower(), word, "+Y")


def rows_to_samples(
    rows: Iterable[tuple[int, list[str]]], columns: Sequence[int], path: Path, promised: str = ""
) -> tuple[int, int, tuple[Samples, ...]]:
    """Number of the first frame, how many there are and their samples, of rows: a line number and its fields each.

    The first field is the frame's number, and `columns` are where the P markers begin, ascending. Empty fields, NaN and
    0 0 0 are missing, and so is what a row is too short for; frames that the file leaves out are there without points.
    InputError with the line where a field is no number or the frames do not ascend, without it where there are none or
    fewer than its head has `promised`.
    """
    parts, values, first, before, count = [], [], 0, 0, 0
    for line, fields in rows:
        frame = _frame(fields[0], path, line)
        if count and not 0 < frame - before <= MAX_GAP:
            words = f"goes from frame {before} to {frame}"
            raise InputError(f"{words}; expected frames that ascend, by {MAX_GAP:,} at most", path, line)
        first, before, count = frame if not count else first, frame, count + 1
        here = takewhile(len(fields).__gt__, columns)
        row = [_value(fields, column + axis, path, line) for column in here for axis in range(3)]
        xyz = np.array(row, dtype=float).reshape(1, -1, 3)
        xyz[(xyz == 0).all(axis=2)] = np.nan
        values.append(Samples.of(xyz, frame - first))
        if len(values) == ROWS_AT_ONCE:
            parts.append(_joined(values))
            values = []
    if not count:
        raise InputError("has no frames; expected at least one", path)
    frames = before - first + 1
    if frames - 1 > MAX_GAP + MAX_FRAMES_A_ROW * count:
        raise InputError(f"has {count} rows for {words_of_frames(first, before)}; expected every frame", path)
    if count_in(promised) > count:
        raise InputError(f"has {count} of {promised} frames; expected all of them (is the file cut off?)", path)
    return first, frames, (*parts, *([_joined(values)] if values else []))


def _lines(text: str) -> list[str]:
    """The lines of a text, without their ends; old Windows text has other signs that Python would end one at."""
    lines = re.split(r"\r\n|\r|\n", text)
    return lines if lines[-1] else lines[:-1]


def count_in(text: str) -> int:
    """A number of frames or markers as a head says it, 0 where it is none; Python makes none of thousands of digits."""
    return int(text) if text.isascii() and text.isdigit() and len(text) < 100 else 0


def _need_end(text: str, path: Path, line: int):
    if not text.endswith(("\n", "\r")):  # its last number may be cut
        raise InputError("ends without a line end; expected a whole last row (is the file cut off?)", path, line)


def _joined(parts: Sequence[Samples]) -> Samples:
    names = ("frame", "column", "xyz", "residual")
    return Samples(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _frame(field: str, path: Path, line: int) -> int:
    try:
        value = float(field)
    except ValueError:
        value = np.nan
    if value % 1 == 0 and abs(value) <= MAX_FRAME:
        return int(value)
    raise InputError(
        f"begins with {field.strip()[:40]!r}; expected a frame number, a whole one up to {MAX_FRAME}", path, line
    )


def _value(fields: list[str], index: int, path: Path, line: int) -> float:
    field = fields[index] if index < len(fields) else ""
    if not field or field.isspace():
        return np.nan
    try:
        value = float(field)
    except ValueError:
        wish = "a number, with a point before decimals" if "," in field else "a number"
        raise InputError(f"has {field.strip()[:40]!r} as a coordinate; expected {wish}", path, line) from None
    if abs(value) > MAX_COORDINATE:
        raise InputError(f"has {field.strip()[:40]!r} as a coordinate; expected a position in a room", path, line)
    return value


TRC = "a .trc file"

# The format has no word for the axis that points up, and most of its files have y up; ours say here that it is z.
Z_UP = "Z_UP"

# Of a row, a frame and a time with spaces between; a decimal point tells that from a frame such as "1 234".
_FRAME_AND_TIME = re.compile(r"^(\s*\d+) +(?=\d*\.\d+ *\t)", re.ASCII)

WIDTH_ROWS = 1000  # rows that are looked at where nothing else says how many markers there are


def read_trc(path: Path, given: float | None = None) -> PointFile:
    """Points of a TRC, with those beyond its names: EVaRT and Cortex write what they did not identify so.

    `given` is the rate where the file says none, as of all texts.
    Raises InputError with the line where the file is not as the format says.
    """
    text = decode(read_bytes(path), path, TRC)
    lines, ended = _lines(text), text.endswith(("\n", "\r"))
    if "\t" not in text:  # a spreadsheet's
        lines = ["\t".join(_fields(line, path, number, TRC)) for number, line in enumerate(lines, 1)]
    if not lines or not lines[0].lstrip().lower().startswith("pathfiletype"):
        raise InputError(f"does not begin with PathFileType; expected {TRC}", path, 1)
    if len(lines) < 5:
        raise InputError(f"ends in its head; expected {TRC} (is the file cut off?)", path, len(lines))
    lines[3:] = _unpadded(lines[3:])
    head = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    rate = _rate_in_head(head.get("DataRate", ""), "DataRate", path, 3, given)
    begin = next((index for index in (4, 5) if _is_trc_row(lines, index)), 5)
    labels = _trc_labels(lines[3], head.get("NumMarkers", ""), lines[begin:])
    named = 2 + 3 * len(labels)
    labels += [""] * (max(map(_trc_points, lines[begin:]), default=0) - len(labels))
    if not labels:
        raise InputError(f"has no points; expected {TRC}", path, 4)
    columns = [2 + 3 * index for index in range(len(labels))]
    rows, word = _trc_rows(lines, begin, ended, named, path), "+Z" if Z_UP in lines[0] else ""
    take = text_file(rows, labels, columns, path, rate, head.get("Units", ""), word)
    lacking = _lacking(take.frames, head.get("NumFrames", ""), ended, path, len(lines))
    filled = [line for line in lines[begin:] if line.strip()]
    ends = [filled[at].split("\t") for at in (0, -1)]
    begin_s = _value(ends[0], 1, path, begin + 1) - take.first_frame / rate
    own = head if len(lines[1].split()) == len(lines[2].split()) else {}
    trial = TextHead(own, {}, begin_s if begin_s == begin_s else -take.first_frame / rate)
    times = [row[1].strip() if len(row) > 1 else "" for row in ends]
    notes = lacking, "" if rate == given else _other_rate(times, take.frames, rate)
    return replace(take, notes=tuple(filter(None, notes)), trial=trial)


def _lacking(frames: int, promised: str, ended: bool, path: Path, line: int) -> str:
    """What to say of a text that has fewer frames than its head counts: a part of it, or all that a program wrote.

    InputError with the last line where it has not `ended` with a line's end.
    """
    words = f"has {frames} of {promised} frames that its head counts" if frames < count_in(promised) else ""
    if words and not ended:  # its last number may be cut
        words += ", and ends in the middle of a row or without a line end"
        raise InputError(f"{words}; expected a whole last row", path, line)
    return words


def _other_rate(ends: Sequence[str], frames: int, rate: float) -> str:
    """What to say where the times of the first and the last row count other frames than the rate does.

    They may be a frame apart, and a step of the times as they are printed.
    """
    try:
        span = float(ends[1]) - float(ends[0])
    except ValueError:
        return ""
    step = max(10.0 ** -len(text.partition(".")[2]) for text in ends)
    if not 0 < span < np.inf or abs(span - (frames - 1) / rate) < 1 / rate + step:
        return ""
    return f"its times are of {(frames - 1) / span:.6g} frames a second, but its head says {rate:g}, which was taken"


def _unpadded(lines: list[str]) -> list[str]:
    """The lines from the names on without the tab that some programs put before the names, or before each row.

    A row that has one has a field more than its frame, its time and whole points.
    """
    lines = [lines[0], *(_FRAME_AND_TIME.sub(r"\1\t", row) for row in lines[1:])]
    names = lines[0].removeprefix("\t") if lines[0].lower().startswith("\tframe") else lines[0]
    first = next((row for row in lines[1:] if row.strip("\t -")[:1].isdigit()), "")
    padded = first.startswith("\t") and _trc_filled(first) % 3 == 0
    return [names, *(row.removeprefix("\t") if padded else row for row in lines[1:])]


def _trc_filled(row: str) -> int:
    """How many fields a row has up to the last with something in it."""
    return row.rstrip().count("\t") + 1


def _trc_points(row: str) -> int:
    """How many points a row has fields for, behind its frame and time."""
    return _trc_filled(row) // 3


def _trc_rows(lines: list[str], begin: int, ended: bool, named: int, path: Path) -> Iterator[tuple[int, list[str]]]:
    """The number and the fields of each row from `begin` on, of a text that `ended` with a line's end.

    The first `named` fields are as the head says; behind them are three for each point without a name.
    """
    width = named
    for number, line in enumerate(lines[begin:], begin + 1):
        if not line.strip():
            continue
        fields = line.split("\t")
        filled = _trc_filled(line)
        if filled > named and (filled - 2) % 3:
            raise InputError(f"has {filled} fields; expected {named}, and three for each point more", path, number)
        # What is behind the named points has no length of its own.
        if number == len(lines) and not ended and len(fields) < min(width, named):
            raise InputError(f"ends in the middle of a row; expected {named} fields", path, number)
        width = len(fields)
        yield number, fields


def _is_trc_row(lines: list[str], index: int) -> bool:
    """Whether a line is a row of coordinates; some programs leave out the line with X1, Y1, Z1."""
    first = lines[index].split("\t")[0].strip() if index < len(lines) else ""
    return first.isascii() and first.isdigit()


def _trc_labels(line: str, promised: str, rows: list[str]) -> list[str]:
    """The markers' names, empty for those without one, in the order of their columns.

    The format has a name above the first of a marker's three columns. Other programs put one tab or two behind a name,
    a name above each column (`LASI_x`, `LASI_y`, `LASI_z`), a space before the first, or only spaces between them;
    then it is the number of the names that has to fit NumMarkers or the rows.
    """
    fields = [field.strip() for field in line.rstrip("\t ").split("\t")]
    if len(fields) > 1 and fields[1].lower().startswith("time "):
        fields[1:2] = fields[1].split(None, 1)
    labels = fields[2:]
    names, words, stated = [label for label in labels if label], line.split()[2:], count_in(promised)
    if len(names) == 1 < len(words) == stated:
        return words
    if not any(label for at, label in enumerate(labels) if at % 3):
        return labels[::3]
    stems = [name[:-1].rstrip("_. ") for name in names]
    axes = "".join(name[-1].lower() for name in names)
    each = len(names) // 3
    if stated != len(names) and axes == "xyz" * each and all(stems) and stems[::3] == stems[1::3] == stems[2::3]:
        return stems[::3]
    return names if len(names) in (stated, *map(_trc_points, rows[:WIDTH_ROWS])) else labels[::3]


def _rate_in_head(text: str, what: str, path: Path, line: int, given: float | None) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = np.nan
    if MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
        return rate
    if given is not None:
        return given
    words = f"has {text[:40]!r} for its {what}" if text else f"has no {what}"
    raise InputError(f"{words}; expected frames a second, written there or given", path, line)


def write_trc_file(
    path: Path, labels: list[str], xyz: Table, rate: float, first_frame: int, head: TextHead | None = None
):
    """Writes points (T, P, 3) m as mm, z up; missing samples are empty fields.

    Of the `head` of the TRC or Motive file that they come from is there whatever is still true.
    """
    frames, count = xyz.shape[:2]
    said = dict.fromkeys(("DataRate", "CameraRate"), f"{rate:.6g}") | {"NumFrames": "", "NumMarkers": "", "Units": ""}
    said |= {"OrigDataRate": f"{rate:.6g}", "OrigDataStartFrame": str(first_frame), "OrigNumFrames": str(frames)}
    said |= dict(head.fields) if head else {}
    said |= {"NumFrames": str(frames), "NumMarkers": str(count), "Units": "mm"}
    begin = -first_frame / rate if head is None or head.begin is None else head.begin
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{written(Path(path).name)}\t{Z_UP}",
        "\t".join(said),
        "\t".join(said.values()),
        "Frame#\tTime\t" + "\t\t\t".join(written(label.replace("\t", " ")) for label in labels) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{index}" for index in range(1, count + 1) for axis in "XYZ"),
        "",
    ]
    with Path(path).open("w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(lines) + "\n")
        for part in blocks(frames, count):
            places = (1000.0 * np.asarray(xyz[part], dtype=float)).reshape(part.stop - part.start, -1)
            for frame, values in enumerate(places.tolist(), first_frame + part.start):
                fields = ("" if value != value else f"{value:.5f}" for value in values)
                file.write(f"{frame}\t{begin + frame / rate:.6f}\t" + "\t".join(fields) + "\n")


MOTIVE = "a Motive .csv export"

ABOUT_TAKE = re.compile(r"take |capture |total frames in take")  # settings; all others are about the export

OPENINGS = ("format version", "take name")

# Where a file has several kinds of marker, the first of these is what the cameras saw.
MARKER_KINDS = ("marker", "rigid body marker", "bone marker")


def is_csv_of_points(path: Path) -> bool:
    """Whether a file begins as Motive's and Vicon's exports of points do, and files of blobs do not."""
    return _opening(path) in (*OPENINGS, *VICON_SECTIONS)


def read_csv(path: Path, given: float | None = None) -> PointFile:
    """Raises InputError with the line where the file is not as Motive, or Vicon, writes it."""
    return (read_vicon if _opening(path) in VICON_SECTIONS else read_motive)(path, given)


def _opening(path: Path) -> str:
    """The first field of a CSV file, in small letters."""
    with open_binary(path) as file:
        head = file.read(4096)
    text = head.lstrip(codecs.BOM_UTF8 + codecs.BOM_UTF16).replace(b"\0", b"").decode("latin-1")
    return re.split(r"[,\r\n]", text.lstrip(', "\t\r\n'), maxsplit=1)[0].strip(' "').lower()


def read_motive(path: Path, given: float | None = None) -> PointFile:
    """Raises InputError with the line where the file is not as Motive writes it."""
    text = decode(read_bytes(path), path, MOTIVE)
    lines = _lines(text)
    head = _fields(lines[0] if lines else "", path, 1)
    settings = dict(zip((key.strip().lower() for key in head[::2]), head[1::2], strict=False))
    if not any(opening in settings for opening in OPENINGS):
        words = "does not begin with Motive's settings, nor with a section of Vicon's"
        raise InputError(f"{words}; expected {MOTIVE}, or {VICON}", path, 1)
    rate = _rate(settings, path, given)
    titles, start = _titles(lines, path)
    kinds, names, properties = (titles.get(key, []) for key in ("type", "name", "property"))
    labels, columns = _markers(kinds, names, properties, path, start)
    unit = settings.get("length units", "").strip()
    take = text_file(_rows(lines, start, path), labels, columns, path, rate, unit)
    promised, ended = settings.get("total exported frames", "").strip(), text.endswith(("\n", "\r"))
    lacking = _lacking(take.frames, promised, ended, path, len(lines))
    of_take = {key: text.strip() for key, text in settings.items() if ABOUT_TAKE.match(key) and text.strip()}
    known = {"capture frame rate": ("CameraRate", "OrigDataRate"), "total frames in take": ("OrigNumFrames",)}
    fields = {name: of_take[key].replace("\t", " ") for key, names in known.items() if key in of_take for name in names}
    return replace(take, notes=(lacking,) if lacking else (), trial=TextHead(fields, of_take))


def _is_row(line: str) -> bool:
    return bool(line.strip(", \t"))


def _rows(lines: list[str], start: int, path: Path) -> Iterator[tuple[int, list[str]]]:
    """The number and the fields of each row from `start` on."""
    width = len(_fields(lines[start - 1], path, start))
    for number, line in enumerate(lines[start:], start + 1):
        if not _is_row(line):
            continue
        fields = line.split(",") if '"' not in line else _fields(line, path, number)
        if len(fields) != width and not (len(fields) < width and number < len(lines)):
            raise InputError(f"has {len(fields)} fields; expected {width} (is the file cut off?)", path, number)
        yield number, fields


def _rate(settings: dict[str, str], path: Path, given: float | None) -> float:
    export, capture = (settings.get(f"{what} frame rate", "") for what in ("export", "capture"))
    with suppress(InputError):
        given = _rate_in_head(capture, "", path, 1, given)
    return _rate_in_head(export, "Export Frame Rate", path, 1, given)


def _titles(lines: list[str], path: Path) -> tuple[dict[str, list[str]], int]:
    """The rows above the data by what they hold, and how many lines there are up to the data."""
    titles: dict[str, list[str]] = {}
    for number, line in enumerate(lines[1:12], 2):
        fields = _fields(line, path, number)
        first, second = [*fields, "", ""][:2]
        if first.strip().lower() == "frame":
            return titles, number
        said = second.strip().lower()
        if said in ("type", "name"):
            titles[said] = fields
        elif any(field.strip() in ("Position", "Rotation") for field in fields):
            titles["property"] = fields
        elif not said and _is_row(line) and len(titles) < 2:  # Motive 1 leaves out the titles of these two
            titles["name" if titles else "type"] = fields
    raise InputError(f"has no row that begins with Frame; expected {MOTIVE}", path, min(len(lines), 12))


def _markers(
    kinds: list[str], names: list[str], properties: list[str], path: Path, line: int
) -> tuple[list[str], list[int]]:
    """Names of the markers and where their columns begin."""
    starts: dict[str, list[tuple[str, int]]] = {}
    column = 2
    while column + 2 < len(names):
        kind = kinds[column].strip().lower() if column < len(kinds) else "marker"
        kind = kind.removeprefix("unlabeled ").removesuffix(" (measured)")
        here = names[column : column + 3]
        position = all(field.strip() == "Position" for field in properties[column : column + 3]) if properties else True
        if position and len(set(here)) == 1:
            starts.setdefault(kind, []).append((here[0].strip(), column))
            column += 3
        else:
            column += 1
    chosen = next((starts[kind] for kind in MARKER_KINDS if kind in starts), None)
    if not chosen:
        raise InputError(f"has no columns of marker positions; expected {MOTIVE} of markers", path, line)
    return [name for name, _ in chosen], [column for _, column in chosen]


def _fields(line: str, path: Path, number: int, what: str = MOTIVE) -> list[str]:
    try:
        return next(csv.reader([line]), [])
    except csv.Error:
        raise InputError(f"is not a row of a CSV file; expected {what}", path, number) from None


VICON = "a Vicon .csv export of trajectories"

# What an export may hold, one under the other, parted by empty lines.
VICON_SECTIONS = ("trajectories", "devices", "joints", "segments", "model outputs", "events")


def read_vicon(path: Path, given: float | None = None) -> PointFile:
    """The trajectories of an export as text of Nexus; InputError with the line where it is not as Nexus writes it."""
    text = decode(read_bytes(path), path, VICON)
    lines = _lines(text)
    begin = next((at for at, line in enumerate(lines) if line.strip(', "\t').lower() == VICON_SECTIONS[0]), None)
    if begin is None:
        raise InputError(f"has no section {VICON_SECTIONS[0].title()}; expected {VICON}", path, 1)
    start = begin + 5
    head = [_fields(line, path, at, VICON) for at, line in enumerate(lines[begin:start], begin + 1)]
    head += [[]] * (5 - len(head))
    if head[4] and head[4][0].strip():  # a frame: Workstation and iQ have neither units nor Sub Frame
        start, head[4] = start - 1, ["mm"] * len(head[3])
    end = next((at for at, line in enumerate(lines) if at >= start and not _is_row(line)), len(lines))
    rate = _rate_in_head("".join(head[1][:1]).removesuffix("Hz"), "rate", path, begin + 2, given)
    names, titles, units = head[2:]
    # What moves has columns of its speed, too, whose names are the same.
    columns = [at for at in range(1, len(titles) - 2) if titles[at : at + 3] == ["X", "Y", "Z"] and at < len(names)]
    if not columns or any(len(units) <= at + 2 for at in columns):
        raise InputError(f"has no columns X, Y, Z with names and units above; expected {VICON}", path, start)
    labels = [names[at].strip() for at in columns]
    take = text_file(_rows(lines[:end], start, path), labels, columns, path, rate, units[columns[0]].strip() or "mm")
    if end == len(lines):
        _need_end(text, path, end)
    return replace(take, usual="+Z")


TSV = "a Qualisys .tsv export of 3D data"
_TSV_EVENT = re.compile(r"EVENT\t([^\t]*\S[^\t]*)\t(\d{1,9})\s*(\t|$)", re.ASCII)
TSV_HEAD_BYTES = 4096  # format: what is included stands above events and names


def is_other_tsv(path: Path) -> bool:
    """Whether a `.tsv` says that it is of something else, as QTM's of forces, analog channels and bodies beside it."""
    if path.suffix.lower() != ".tsv":
        return False
    try:
        with open_binary(path) as file:
            head = _lines(decode(file.read(TSV_HEAD_BYTES), path, TSV))
    except InputError:
        return False  # which whoever reads it is told
    said = [words.strip() for key, _, words in (line.partition("\t") for line in head) if key == "DATA_INCLUDED"]
    return any(words.upper() != "3D" for words in said)


def read_tsv(path: Path, given: float | None = None) -> PointFile:
    """Points of a Qualisys export; where it has no column of frames, they are numbered from 1 on.

    Raises InputError with the line where the file is not as QTM writes it.
    """
    text = decode(read_bytes(path), path, TSV)
    lines = _lines(text)
    start = 1 + next((at for at, line in enumerate(lines) if line.startswith("MARKER_NAMES")), len(lines))
    start += start < len(lines) and lines[start].startswith("TRAJECTORY_TYPES")
    pairs = [(at, *line.partition("\t")[::2]) for at, line in enumerate(lines[:start], 1)]
    head = {word.strip(): (at, said.rstrip()) for at, word, said in pairs}
    line, kind = head.get("DATA_INCLUDED", (1, ""))
    if kind.upper() != "3D":
        words = f"holds {kind[:40]} data" if kind else "has no DATA_INCLUDED in its head"
        raise InputError(f"{words}; expected {TSV}", path, line)
    line, frequency = head.get("FREQUENCY", (1, ""))
    rate = _rate_in_head(frequency, "FREQUENCY", path, line, given)
    line, names = head.get("MARKER_NAMES", (1, ""))
    labels, stated = [name.strip() for name in names.split("\t")], count_in(head.get("NO_OF_MARKERS", (1, ""))[1])
    if "MARKER_NAMES" not in head or len(labels) > stated > 0:
        words = f"has {len(labels) if names else 'no'} MARKER_NAMES"
        raise InputError(f"{words}; expected those of its {stated} markers", path, line)
    count, opening = max(stated, len(labels)), lines[start] if start < len(lines) else ""
    titled = re.search(r"z\d*\s*$", opening, re.IGNORECASE) is not None
    titles = opening.rstrip().split("\t") if titled else []
    columns = len(titles) or opening.count("\t") + 1
    if titled:  # what is ahead has titles of its own
        ahead = next((at for at, title in enumerate(titles) if re.search(r"x\d*\s*$", title, re.IGNORECASE)), columns)
    else:  # a row may end with one more tab
        ahead = 2 * (columns >= 3 * count + 2)
        columns = min(columns, 3 * count + ahead)
    if columns - ahead != 3 * count:
        words = f"has {columns - ahead} columns of coordinates"
        raise InputError(f"{words}; expected three for each of its {count} markers", path, start + 1)
    numbered = titles[0].strip().lower() == "frame" if titled else ahead > 0
    rows = _tsv_rows(lines, start + titled, (ahead, columns), numbered, path)
    labels += [""] * (count - len(labels))
    promised = head.get("NO_OF_FRAMES", (1, ""))[1]
    take = text_file(rows, labels, range(1, 1 + 3 * count, 3), path, rate, "mm", promised=promised)
    _need_end(text, path, len(lines))
    stamp = " ".join(head.get("TIME_STAMP", (1, ""))[1].split())
    said, events = {"TIME_STAMP": stamp} if stamp else {}, map(_TSV_EVENT.match, lines[:start])
    at = tuple((event[1].strip(), float(event[2])) for event in events if event)
    return replace(take, usual="+Z", trial=TextHead({}, said, group="QTM", events=at))


def _tsv_rows(
    lines: list[str], start: int, columns: tuple[int, int], numbered: bool, path: Path
) -> Iterator[tuple[int, list[str]]]:
    """The number of each row from `start` on, with its frame's number and the coordinates, from and to some columns.

    Before these may be the frame, where rows are `numbered`, the time, and perhaps a time code.
    """
    frame, width = 0, columns[1]
    for number, line in enumerate(lines[start:], start + 1):
        if not line.strip(" "):  # of a frame without points there may be tabs alone
            continue
        fields = line.split("\t")
        if len(fields) != width and (len(fields) != width + 1 or fields[-1].strip()):
            raise InputError(f"has {len(fields)} fields; expected {width} (is the file cut off?)", path, number)
        frame += 1
        yield number, [fields[0] if numbered else str(frame), *fields[slice(*columns)]]
