# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers kept as narrow as their file has them, and given as real lengths wherever they are looked at."""

import numpy as np


class Scaled:
    """An array of float64 of which only what is asked for is made: numbers as they stand in a file, times its units.

    `factors` are multiplied by one after the other, which is how the numbers would have been made all at once; what is
    kept is every number of the file, so nothing is lost.
    """

    dtype = np.dtype(float)

    def __init__(self, numbers: np.ndarray, factors: tuple[float, ...]):
        self.numbers, self.factors = numbers, factors
        self.shape, self.ndim = numbers.shape, numbers.ndim

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, index) -> np.ndarray:
        found = np.asarray(self.numbers[index], dtype=float)
        for factor in self.factors:
            found = found * factor
        return found + 0.0  # no zero has a sign

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        whole = self[...]
        return whole if dtype is None else whole.astype(dtype)

    def part(self, frames: slice) -> "Scaled":
        """The same of the frames from start to stop."""
        return Scaled(self.numbers[frames], self.factors)
