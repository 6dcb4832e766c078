# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of large arrays that change a little at a time: one that nobody holds any more is made the next one."""

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np


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
