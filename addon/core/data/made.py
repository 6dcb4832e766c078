# SPDX-License-Identifier: GPL-3.0-or-later
"""Large tables of a long take: where they are kept, those that are made where they are asked for, and copies."""

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

# Makes a table of zeros of a shape and a kind, which is read and written by its frames, as an array is.
MakeTable = Callable[[tuple[int, ...], Any], Any]
IN_MEMORY: MakeTable = np.zeros


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


class Copies:
    """Arrays that are changed in place, and copies of them as they were from time to time.

    Whoever changes them notes where. To copy 40 MB takes a few ms, but to have so much new memory from the system takes
    up to 90 (measured on a virtual machine), and a person waits for it at each correction.
    """

    most_kept = 2  # copies: what is shown, and what was before it

    def __init__(self, *arrays: np.ndarray):
        self.arrays = arrays
        self._given: list[tuple[tuple[np.ndarray, ...], list[tuple[int, Any]]]] = []

    def note(self, which: int, index: Any):
        """Notes that array number `which` has changed at an index, any that arrays take."""
        for _, missed in self._given:
            missed.append((which, index))

    def copy(self) -> list[np.ndarray]:
        """The arrays as they are now, which do not change as long as somebody holds one of them, or a view of it."""
        for place, (arrays, missed) in enumerate(self._given):
            if _holders(arrays) == ALONE:
                for which, index in missed:
                    arrays[which][index] = self.arrays[which][index]
                missed.clear()
                self._given.append(self._given.pop(place))
                return list(arrays)
        self._given = [*self._given, (tuple(one.copy() for one in self.arrays), [])][-self.most_kept :]
        return list(self._given[-1][0])


def _holders(arrays: Sequence[np.ndarray]) -> int:
    """The most references to one of some arrays; a view holds what it is a view of."""
    return max(map(sys.getrefcount, arrays))


ALONE = _holders((np.empty(0),))  # as many as the sequence and the counting itself make
