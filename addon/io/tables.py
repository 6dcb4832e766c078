# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables and rows too large for memory, in files of a scratch folder; what starts without them loads no NumPy."""

from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Self

import numpy as np

from .scratch import naming_scratch, scratch_folder

MIN_TABLE_BYTES = 32_000_000  # of a table that is kept on disk; smaller ones are arrays: memory


class Room:
    """Makes tables as `numpy.zeros` does, large ones in files of a scratch folder that goes when `stack` closes."""

    def __init__(self, stack: ExitStack, min_bytes: int = MIN_TABLE_BYTES):
        self.stack, self.min_bytes = stack, min_bytes
        self.folder: Path | None = None
        self.count = 0

    def __call__(self, shape: tuple[int, ...], dtype: Any = float) -> "np.ndarray | FileTable":
        """A table of zeros; JobError where the folder for temporary files has no room."""
        if np.dtype(dtype).itemsize * int(np.prod(shape)) < self.min_bytes:
            return np.zeros(shape, dtype)
        if self.folder is None:
            self.folder = self.stack.enter_context(scratch_folder())
        self.count += 1
        return FileTable(self.folder / f"table-{self.count}", shape, dtype)


class FileTable:
    """An array of which some frames in a row, or some frames of them, are read and written; it is in a file.

    It is indexed as arrays are. Frames by an index are taken out of all those from the first to the last of them.
    """

    def __init__(self, path: Path, shape: tuple[int, ...], dtype: Any):
        self.path, self.shape, self.dtype, self.ndim = path, tuple(shape), np.dtype(dtype), len(shape)
        self.size = int(np.prod(shape))
        self._row = self.dtype.itemsize * (self.size // shape[0])
        with naming_scratch(path.parent), path.open("xb") as file:
            file.truncate(self._row * shape[0])

    def __len__(self) -> int:
        return self.shape[0]

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        whole = self._read(0, len(self))
        return whole if dtype is None else whole.astype(dtype)

    def __getitem__(self, index) -> np.ndarray:
        start, stop, rest = self._span(index)
        return self._read(start, stop)[rest]

    def __setitem__(self, index, values):
        start, stop, rest = self._span(index)
        part = self._read(start, stop)
        part[rest] = values
        with naming_scratch(self.path.parent), self.path.open("r+b") as file:
            file.seek(start * self._row)
            file.write(part.data)

    def _span(self, index) -> tuple[int, int, tuple]:
        """Which frames to read, from start to stop, and what of them is meant."""
        frames, *rest = index if isinstance(index, tuple) else (index,)
        if isinstance(frames, slice):
            start, stop, step = frames.indices(len(self))
            return start, max(stop, start), (slice(None, None, step), *rest)
        frames = np.arange(len(self))[frames]
        start = int(frames.min(initial=len(self)))
        return start, max(int(frames.max(initial=-1)) + 1, start), (frames - start, *rest)

    def _read(self, start: int, stop: int) -> np.ndarray:
        count = (stop - start) * self._row // self.dtype.itemsize
        with naming_scratch(self.path.parent):
            found = np.fromfile(self.path, self.dtype, count, offset=start * self._row)
        return found.reshape(stop - start, *self.shape[1:])


class RowFile:
    """Rows of one kind, an array's dtype, on disk while a take is worked on; use it as a context manager."""

    def __init__(self, folder: Path, kind: np.dtype):
        self.folder, self.path, self.kind, self.count = folder, folder / "rows", kind, 0

    def __enter__(self) -> Self:
        with naming_scratch(self.folder):
            self.file = self.path.open("w+b")
        return self

    def __exit__(self, *_: object):
        with suppress(OSError):  # of a full disk, which was said
            self.file.close()

    def append(self, rows: np.ndarray):
        """Writes rows to the end and sees that they got there, which `ndarray.tofile` does not."""
        with naming_scratch(self.folder):
            self.file.write(np.ascontiguousarray(rows).data)
            self.file.flush()
        self.count += len(rows)

    def rows(self) -> np.ndarray:
        """All of them, read from disk where they are looked at."""
        return np.memmap(self.path, self.kind, "r") if self.count else np.zeros(0, self.kind)
