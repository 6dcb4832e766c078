# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of a long take that are never whole: what is asked for is made of what is kept anyway."""

from collections.abc import Callable
from typing import Any

import numpy as np


class Made:
    """A table (T, …) of which only what an index asks for is made, as `make` gives it; `np.asarray` makes all of it."""

    def __init__(self, shape: tuple[int, ...], make: Callable[[Any], np.ndarray]):
        self.shape, self.ndim, self.dtype, self._make = tuple(shape), len(shape), np.dtype(float), make

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, index: Any) -> np.ndarray:
        return self._make(index)

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        whole = self[...]
        return whole if dtype is None else whole.astype(dtype)


Table = np.ndarray | Made


def by_frames(count: int, make: Callable[[slice], np.ndarray]) -> Callable[[Any], np.ndarray]:
    """What makes a table of `count` frames of which some in a row, from start to stop, can be made, all, or one."""

    def made(index: Any) -> np.ndarray:
        if index is ... or isinstance(index, slice):
            return make(slice(*(slice(None) if index is ... else index).indices(count)[:2]))
        return make(slice(index, index + 1))[0]

    return made


class Scaled(Made):
    """Numbers as narrow as their file has them, times its units: real lengths wherever they are looked at.

    `factors` are multiplied by one after the other, which is how the numbers would have been made all at once; what is
    kept is every number of the file, so nothing is lost.
    """

    def __init__(self, numbers: np.ndarray, factors: tuple[float, ...]):
        self.numbers, self.factors = numbers, factors
        super().__init__(numbers.shape, self._scaled)

    def _scaled(self, index: Any) -> np.ndarray:
        found = np.asarray(self.numbers[index], dtype=float)
        for factor in self.factors:
            found = found * factor
        return found + 0.0  # no zero has a sign

    def part(self, frames: slice) -> "Scaled":
        """The same of the frames from start to stop."""
        return Scaled(self.numbers[frames], self.factors)
