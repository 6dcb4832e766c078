# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of a long take in scratch files: what is gone through frame by frame, once or twice, needs no memory."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .scratch import naming_scratch, scratch_folder


@dataclass(frozen=True)
class FileTableOptions:
    """Which tables are kept on disk; memory.

    min_bytes  that a table must have: smaller ones are arrays
    """

    min_bytes: int = 32_000_000


ON_DISK = FileTableOptions()


class Room:
    """Makes tables as `numpy.zeros` does, large ones in files of a scratch folder that goes when `stack` closes."""

    def __init__(self, stack: ExitStack, options: FileTableOptions = ON_DISK):
        self.stack, self.options = stack, options
        self.folder: Path | None = None
        self.count = 0

    def __call__(self, shape: tuple[int, ...], dtype: Any = float) -> "np.ndarray | FileTable":
        """A table of zeros; JobError where the folder for temporary files has no room."""
        if np.dtype(dtype).itemsize * int(np.prod(shape)) < self.options.min_bytes:
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
