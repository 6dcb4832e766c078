# SPDX-License-Identifier: GPL-3.0-or-later
"""The contract's blobs, `frame,camera,x,y[,area]`, piece by piece: memory does not grow with the take."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import Blobs
from ..core.geometry.cameras import Cameras
from .rows import Rows, parse_rows, read_header
from .source import open_binary

KIND = "a blob file with the header frame,camera,x,y"

BLOCK_BYTES = 1 << 22
LONGEST_LINE = 1 << 20

# A chunk is cut short at a frame's end beyond this many rows, so that ghosts by the million do not fill the memory.
CHUNK_ROWS = 200_000

# No camera pauses for this many frames and goes on counting; a larger jump is a wrong column or a time stamp.
LARGEST_GAP = 100_000


@dataclass(frozen=True, eq=False)
class BlobRows:
    """One chunk of a blob file.

    blobs     its blobs, in the order of the file
    keys      each row's own text of frame, camera, x and y, ready to begin a row of a CSV file
    fraction  how much of the file has been read, 0 to 1
    """

    blobs: Blobs
    keys: list[str]
    fraction: float


def read_blobs(
    path: Path, cameras: Cameras, frames: tuple[int | None, int | None] | None = None, chunk_frames: int = 256
) -> Iterator[BlobRows]:
    """The take in chunks of at most `chunk_frames` consecutive frames; `frames` keeps those from A to B, both included.

    Frames without blobs between the first and the last are there as empty frames. Rows may come in any order within
    a frame; frames ascend. Columns may come in any order and others may stand among them.
    Raises InputError with the file and line for whatever breaks that, and when there is no blob at all.
    """
    first, last = frames or (None, None)
    pending = _Pending(chunk_frames)
    for rows, fraction, finished in _blocks(Path(path), cameras):
        outside = last is not None and len(rows) and rows.frame[-1] > last
        pending.add(rows.between(first, last), fraction)
        finished = finished or bool(outside)
        yield from pending.ready(finished)
        if finished:
            break
    if not pending.begun:
        wanted = "" if frames is None else f" in frames {'' if first is None else first}:{'' if last is None else last}"
        raise InputError(f"has no blobs{wanted}; expected at least one row", path)


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
                if len(carry) > BLOCK_BYTES + LONGEST_LINE:
                    raise InputError(f"has a line of over {LONGEST_LINE >> 20} MB; expected {KIND}", path, line)
            rows = parse_rows(block, header, cameras, path, line)
            previous = _check_order(rows, previous, path)
            yield rows, 1.0 if finished else (file.tell() - len(carry)) / size, finished
            if finished:
                return
            line += block.count(b"\n")


def _check_order(rows: Rows, previous: int | None, path: Path) -> int | None:
    """The last frame number so far; InputError where the numbers go back or leap."""
    if not len(rows):
        return previous
    frame = rows.frame if previous is None else np.concatenate([[previous], rows.frame])
    steps = np.diff(frame)
    wrong = (steps < 0) | (steps > LARGEST_GAP)
    if wrong.any():
        at = int(np.argmax(wrong))
        line = rows.line_of(at + (1 if previous is None else 0))
        what, wanted = "goes back", "rows in ascending order of frames"
        if steps[at] > 0:
            what, wanted = "leaps", f"a gap of at most {LARGEST_GAP} frames (is the column frame a time?)"
        raise InputError(f"{what} from frame {frame[at]} to {frame[at + 1]}; expected {wanted}", path, line)
    return int(frame[-1])


class _Pending:
    """Rows that were read and not yet given out."""

    def __init__(self, chunk_frames: int):
        self.chunk_frames = chunk_frames
        self.rows: list[Rows] = []
        self.count = 0
        self.next_frame = 0
        self.last_frame = 0
        self.fraction = 0.0
        self.begun = False

    def add(self, rows: Rows, fraction: float):
        self.fraction = fraction
        if not len(rows):
            return
        if not self.begun:
            self.begun, self.next_frame = True, int(rows.frame[0])
        self.rows.append(rows)
        self.count += len(rows)
        self.last_frame = int(rows.frame[-1])

    def ready(self, finished: bool) -> Iterator[BlobRows]:
        """Chunks that are complete; all that is left when the file is `finished`."""
        if not self.begun:
            return
        end = self.last_frame + 1 if finished else self.last_frame
        if end - self.next_frame < self.chunk_frames and self.count < CHUNK_ROWS and not finished:
            return
        rows = Rows.join(self.rows)
        while self.next_frame < end:
            stop = min(self.next_frame + self.chunk_frames, end)
            if stop == end and not finished and end - self.next_frame < self.chunk_frames and len(rows) < CHUNK_ROWS:
                break
            count = int(np.searchsorted(rows.frame, stop))
            if count > CHUNK_ROWS:
                # Back to the end of the last frame that fits; one frame alone is never divided.
                stop = max(int(rows.frame[CHUNK_ROWS]), self.next_frame + 1)
                count = int(np.searchsorted(rows.frame, stop))
            yield self._chunk(rows.cut(0, count), stop)
            rows, self.next_frame = rows.cut(count, len(rows)), stop
        self.rows, self.count = [rows], len(rows)

    def _chunk(self, rows: Rows, stop: int) -> BlobRows:
        frames = np.arange(self.next_frame, stop)
        blobs = Blobs(frames, rows.frame - self.next_frame, rows.camera, rows.xy, rows.area)
        return BlobRows(blobs, rows.keys, self.fraction)


class BlobWriter:
    """Writes a blob file piece by piece; use it as a context manager on a temporary of `whole_files`."""

    def __init__(self, path: Path, cameras: Cameras, area: bool = True):
        self.names = [csv_field(name) for name in cameras.names]
        self.area = area
        self.file = Path(path).open("w", encoding="utf-8", newline="\n")  # noqa: SIM115
        self.file.write("frame,camera,x,y,area\n" if area else "frame,camera,x,y\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object):
        self.file.close()

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
    """`text` as one field of a CSV file."""
    return '"' + text.replace('"', '""') + '"' if any(sign in text for sign in ',"\r\n') else text
