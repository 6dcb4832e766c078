# SPDX-License-Identifier: GPL-3.0-or-later
"""The contract's blobs, `frame,camera,x,y[,area]`, and a `.qtm`'s, piece by piece: memory stays as it is."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import Blobs
from ..core.data.wording import words_of_range
from ..core.geometry.cameras import Cameras
from .qtm.capture import held_in, is_qtm
from .qtm.records import rows_of_qtm
from .rows import Rows, parse_rows, read_header
from .source import open_binary
from .text import cell_of

KIND = "a blob file with the header frame,camera,x,y"


# How blob files are read, and what is none; memory, and what a capture is.
BLOCK_BYTES = 1 << 22  # that are read at a time
MAX_LINE_BYTES = 1 << 20  # of a line; a longer one is no row
# beyond which a chunk is cut short at a frame's end, so that ghosts by the million do not fill the memory
CHUNK_ROWS = 200_000
MAX_FRAME_ROWS = 500_000  # blobs of a frame: nobody has cameras for more at one time
# frames without blobs, which are written as well, as C3D and TRC number frames one by one: an empty room for minutes is
# sound, also when hardly anything was seen so far
MAX_UNSEEN = 100_000
# more of them for every frame with blobs: a file that is nearly all gap has a wrong column or a time for its frame
UNSEEN_FOR_SEEN = 10


@dataclass(frozen=True, eq=False)
class BlobRows:
    """One chunk of a blob file."""

    blobs: Blobs  # its blobs, in the order of the file
    keys: list[str]  # each row's own text of frame, camera, x and y, ready to begin a row of a CSV file
    fraction: float  # how much of the file has been read, 0 to 1


def read_blobs(
    path: Path, cameras: Cameras, frames: tuple[int | None, int | None] | None = None, chunk_frames: int = 256
) -> Iterator[BlobRows]:
    """The take in chunks of at most `chunk_frames` consecutive frames; `frames` keeps those from A to B, both included.

    Frames without blobs between the first and the last are there as empty frames; of those there may be as
    many as MAX_UNSEEN and UNSEEN_FOR_SEEN say. Rows may come in any order within a frame; frames ascend.
    Columns may come in any order and others may stand among them. Of a `.qtm`, blobs of cameras that are not among
    `cameras` are left out, and its rows' keys are as a blob file would have them.
    Raises InputError with the file and line for whatever breaks that, and when there is no blob at all.
    """
    first, last = frames or (None, None)
    tally, outside = _Tally(Path(path)), False
    own: list[int] = []

    def wanted() -> Iterator[tuple[Rows, float, bool]]:
        nonlocal own, outside
        for rows, fraction, finished in (rows_of_qtm if is_qtm(path) else _blocks)(Path(path), cameras):
            if len(rows):
                outside = last is not None and int(rows.frame[-1]) > last
                own = [*own[:1], *rows.frame[[0, -1]].tolist()]
            chosen = rows.between(first, last)
            tally.check(chosen)
            yield chosen, fraction, finished or outside
            if outside:
                return

    for chunk in _chunks(wanted(), chunk_frames):
        if chunk.keys and len(chunk.keys) >= 2 * len(set(chunk.keys)):  # which of two alike is a marker, nothing tells
            words = f"has every blob of frames {words_of_range(chunk.blobs.frames[[0, -1]].tolist())} twice"
            raise InputError(f"{words}; expected each of them once", path)
        yield chunk
    if tally.last is None:
        if not own:
            raise InputError("has no blobs; expected at least one row", path)
        there = f"{own[0]} and later" if outside else f"{own[0]} to {own[-1]}"
        raise InputError(f"has no blobs in frames {words_of_range(frames)}; expected some of its own, {there}", path)


def frames_in(path: Path, cameras: Cameras) -> tuple[int, int] | None:
    """The first and the last frame of a file, by its two ends; None where these are not sound, which reading tells."""
    if is_qtm(path):
        held = held_in(path)
        return (held.first, held.last) if held.cameras else None
    with open_binary(path) as file:
        size = file.seek(0, 2)
        file.seek(0)
        head = file.read(BLOCK_BYTES)
        file.seek(max(size - BLOCK_BYTES, 0))
        tail = file.read()
    try:
        header, start = read_header(head, path)
        begin = parse_rows(head[start:].rpartition(b"\n")[0] or head[start:], header, cameras, path, 2)
        end = parse_rows(tail[start:] if size <= BLOCK_BYTES else tail.partition(b"\n")[2], header, cameras, path, 2)
    except InputError:
        return None
    return (int(begin.frame[0]), int(end.frame[-1])) if len(begin) and len(end) else None


def check_header(path: Path):
    """Raises InputError where a file that is none of 3D points does not begin as one of blobs does."""
    if is_qtm(path):
        held_in(path)
        return
    with open_binary(path) as file:
        read_header(file.read(BLOCK_BYTES), path, or_points=True)


def _blocks(path: Path, cameras: Cameras) -> Iterator[tuple[Rows, float, bool]]:
    """Parsed rows of one block after the other, the fraction of the file behind them, and whether it was the last."""
    with open_binary(path) as file:
        size = max(file.seek(0, 2), 1)
        file.seek(0)
        carry = file.read(BLOCK_BYTES)
        header, start = read_header(carry, path)
        carry, line, previous = carry[start:], 2, None
        while True:
            more = file.read(BLOCK_BYTES)
            finished = not more
            if finished:
                block, carry = carry, b""
            else:
                block, newline, carry = carry.rpartition(b"\n")
                block += newline
                carry += more
                if len(carry) > BLOCK_BYTES + MAX_LINE_BYTES:
                    raise InputError(f"has a line of over {MAX_LINE_BYTES >> 20} MB; expected {KIND}", path, line)
            rows = parse_rows(block, header, cameras, path, line)
            previous = _check_order(rows, previous, path)
            yield rows, 1.0 if finished else (file.tell() - len(carry)) / size, finished
            if finished:
                return
            line += block.count(b"\n")


def _check_order(rows: Rows, previous: int | None, path: Path) -> int | None:
    """The last frame number so far; InputError where the numbers go back."""
    if not len(rows):
        return previous
    back = np.diff(rows.frame, prepend=rows.frame[0] if previous is None else previous) < 0
    if back.any():
        at = int(np.argmax(back))
        before = rows.frame[at - 1] if at else previous
        raise InputError(
            f"goes back from frame {before} to {rows.frame[at]}; expected rows in ascending order of frames",
            path,
            int(rows.lines[at]),
        )
    return int(rows.frame[-1])


class _Tally:
    """How many frames somebody saw so far and how many nobody, and how many blobs the last has.

    So a few rows cannot stand for any number of frames, nor one frame fill the memory.
    """

    def __init__(self, path: Path):
        self.path = path
        self.last: int | None = None
        self.seen = self.unseen = self.crowd = 0

    def check(self, rows: Rows):
        """Counts the next rows in; InputError with the line where too few frames of all have blobs, or one too many."""
        if not len(rows):
            return
        self._check_crowd(rows)
        steps = np.diff(rows.frame, prepend=rows.frame[0] - 1 if self.last is None else self.last)
        seen = self.seen + np.cumsum(steps > 0)
        unseen = self.unseen + np.cumsum(np.maximum(steps - 1, 0))
        allowed = MAX_UNSEEN + UNSEEN_FOR_SEEN * seen
        if (unseen > allowed).any():
            at = int(np.argmax(unseen > allowed))
            raise InputError(
                f"leaps from frame {rows.frame[at] - steps[at]} to {rows.frame[at]}, which makes {unseen[at]} frames "
                f"without blobs and {seen[at]} with some; expected at most {MAX_UNSEEN} without, and "
                f"{UNSEEN_FOR_SEEN} more for each with some (is the column frame a time?)",
                self.path,
                int(rows.lines[at]),
            )
        self.last, self.seen, self.unseen = int(rows.frame[-1]), int(seen[-1]), int(unseen[-1])

    def _check_crowd(self, rows: Rows):
        begins = np.flatnonzero(np.diff(rows.frame, prepend=rows.frame[0] - 1))
        counts = np.diff(begins, append=len(rows))
        counts[0] += self.crowd if rows.frame[0] == self.last else 0
        if counts.max() > MAX_FRAME_ROWS:
            at = int(begins[np.argmax(counts > MAX_FRAME_ROWS)])
            raise InputError(
                f"has over {MAX_FRAME_ROWS} blobs in frame {rows.frame[at]}; expected one frame of a capture "
                "and then the next",
                self.path,
                int(rows.lines[at]),
            )
        self.crowd = int(counts[-1])


def _chunks(parts: Iterable[tuple[Rows, float, bool]], chunk_frames: int) -> Iterator[BlobRows]:
    """Rows that come part by part as chunks of so many frames, or of as many as CHUNK_ROWS rows are in."""
    left, begin = None, None
    for part, fraction, finished in parts:
        left = part if left is None or not len(left) else Rows.join([left, part])
        if not len(left):
            continue
        begin = int(left.frame[0]) if begin is None else begin
        end = int(left.frame[-1]) + finished  # the last frame may go on
        while begin < end:
            stop = min(begin + chunk_frames, end)
            if stop == end < begin + chunk_frames and not finished and len(left) < CHUNK_ROWS:
                break
            count = int(np.searchsorted(left.frame, stop))
            if count > CHUNK_ROWS:
                # Back to the end of the last frame that fits; one frame alone is never divided.
                stop = max(int(left.frame[CHUNK_ROWS]), begin + 1)
                count = int(np.searchsorted(left.frame, stop))
            rows, left = left.cut(0, count), left.cut(count, len(left))
            blobs = Blobs(np.arange(begin, stop), rows.frame - begin, rows.camera, rows.xy, rows.area)
            yield BlobRows(blobs, rows.keys, fraction)
            begin = stop


class RowWriter:
    """Rows behind a header; a context manager."""

    def __init__(self, path: Path, header: str):
        self.file = Path(path).open("w", encoding="utf-8", errors="surrogateescape", newline="\n")  # noqa: SIM115
        self.file.write(header + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object):
        self.file.close()


class BlobWriter(RowWriter):
    """Writes a blob file piece by piece; use it as a context manager on a temporary of `whole_files`."""

    def __init__(self, path: Path, cameras: Cameras, area: bool = True):
        self.names = [csv_field(name) for name in cameras.names]
        self.area = area
        super().__init__(path, "frame,camera,x,y,area" if area else "frame,camera,x,y")

    def write(self, blobs: Blobs) -> list[str]:
        """Appends the blobs, to a thousandth of a pixel; returns the rows' keys, for the truth file beside it."""
        frame, camera = blobs.frames[blobs.frame].tolist(), blobs.camera.tolist()
        keys = [
            f"{f},{self.names[c]},{x:.3f},{y:.3f}"
            for f, c, (x, y) in zip(frame, camera, blobs.xy.tolist(), strict=True)
        ]
        if self.area:
            areas = ["" if area != area else f"{area:.4g}" for area in blobs.area.tolist()]
            self.file.writelines(f"{key},{area}\n" for key, area in zip(keys, areas, strict=True))
        else:
            self.file.writelines(f"{key}\n" for key in keys)
        return keys


def write_blobs(path: Path, blobs: Blobs, cameras: Cameras) -> list[str]:
    """Writes all of a take that is in memory; returns the rows' keys."""
    with BlobWriter(path, cameras, area=bool(np.isfinite(blobs.area).any())) as writer:
        return writer.write(blobs)


def csv_field(text: str) -> str:
    """`text` as one field of a CSV file, as `names.cell_of` has it."""
    text = cell_of(text)
    return '"' + text.replace('"', '""') + '"' if any(sign in text for sign in ',"') else text
