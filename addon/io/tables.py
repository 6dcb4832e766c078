# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables and rows too large for memory, in files of a scratch folder; what starts without them loads no NumPy."""

from contextlib import ExitStack, suppress
from itertools import repeat
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
        if np.dtype(dtype).itemsize * int(np.prod(shape)) <= self.min_bytes:
            return np.zeros(shape, dtype)
        if self.folder is None:
            self.folder = self.stack.enter_context(scratch_folder())
        self.count += 1
        return FileTable(self.folder / f"table-{self.count}", shape, dtype)


class FileTable:
    """An array in a file, which is open only while a part is read or written: a long take has thousands of them.

    It is indexed as arrays are, and gives copies.
    """

    def __init__(self, path: Path, shape: tuple[int, ...], dtype: Any):
        self.path, self.shape, self.dtype, self.ndim = path, tuple(shape), np.dtype(dtype), len(shape)
        self.size = int(np.prod(shape))
        row = bytes(self.dtype.itemsize * (self.size // shape[0]))
        with naming_scratch(path.parent), path.open("xb") as file:
            file.writelines(repeat(row, shape[0]))  # where the disk is full, it shows here: mapped, it would kill

    def __len__(self) -> int:
        return self.shape[0]

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        return np.array(self._mapped(), dtype)

    def __getitem__(self, index) -> np.ndarray:
        return np.array(self._mapped()[index])

    def __setitem__(self, index, values):
        self._mapped()[index] = values

    def _mapped(self) -> np.memmap:
        with naming_scratch(self.path.parent):
            return np.memmap(self.path, self.dtype, "r+", shape=self.shape)


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
        """All of them, read from disk where they are looked at; a full disk may have a part of one more."""
        return np.memmap(self.path, self.kind, "r", shape=self.count) if self.count else np.zeros(0, self.kind)
