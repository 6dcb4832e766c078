# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills as a take keeps them: what was filled, and whether it still goes with what is measured around it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.takes import Motion


@dataclass(frozen=True)
class FillKeepingOptions:
    """When a fill still goes with a take; reckoned.

    same_place_m  how far samples beside a fill may be from those that it was made between: files keep single precision,
                  1e-6 m at 10 m, and another trajectory in the marker's place is hardly ever as near
    """

    same_place_m: float = 1e-4


FILL_KEEPING = FillKeepingOptions()


@dataclass(frozen=True, eq=False)
class KeptFill:
    """A gap that was filled, from frame `first` to `last` of the source's numbers, both included.

    marker    its name
    method    that filled it, such as "regression+pca"
    expected  the mean error to expect, m; NaN where no trial could say
    path      (L + 2, 3) m; between the marker's places right before and right after, NaN at an end of the take
    """

    marker: str
    first: int
    last: int
    method: str
    expected: float
    path: np.ndarray

    @property
    def xyz(self) -> np.ndarray:
        """(L, 3) m, what was filled in."""
        return self.path[1:-1]

    @property
    def ends(self) -> tuple[bool, bool]:
        """Whether the marker was there right before and right after."""
        before, after = np.isfinite(self.path[[0, -1]]).all(axis=1).tolist()
        return before, after

    def meets(self, marker: str, first: int, last: int) -> bool:
        """Whether it has some of these frames of that marker."""
        return self.marker == marker and self.first <= last and first <= self.last


def resting_on(ends: tuple[bool, bool]) -> str:
    """What a fill is held by, in words, where the marker was measured right before it, and after it, or not."""
    before, after = ends
    if before and after:
        return "both ends"
    return "its start" if before else "its end" if after else "neither end"


def put_fills(motion: Motion, names: Sequence[str], fills: Sequence[KeptFill]) -> tuple[Motion, tuple[str, ...]]:
    """The motion with those of the fills that go with it, residual 0, and for each why it does not; "" where it does.

    A fill goes with gaps like the one that it was made for: missing all through, and between the same places.
    """
    if not fills:
        return motion, ()
    markers, residual = motion.markers.copy(), motion.residual.copy()
    reasons = []
    for fill in fills:
        reason = _why_not(motion, names, fill)
        reasons.append(reason)
        if not reason:
            at = fill_rows(motion.frames, fill), list(names).index(fill.marker)
            markers[at], residual[at] = fill.xyz, 0.0
    return replace(motion, markers=markers, residual=residual), tuple(reasons)


def fill_rows(frames: np.ndarray, fill: KeptFill) -> slice:
    """Which of the take's frames (T,) a fill is of."""
    return slice(*np.searchsorted(frames, [fill.first, fill.last + 1]).tolist())


def filled_samples(frames: np.ndarray, names: Sequence[str], fills: Iterable[KeptFill]) -> np.ndarray:
    """(T, M) True where one of the fills put a sample into a take of these frames (T,) and markers."""
    flags = np.zeros((len(frames), len(names)), bool)
    for fill in fills:
        flags[fill_rows(frames, fill), list(names).index(fill.marker)] = True
    return flags


def replaced_fills(old: Iterable[KeptFill], new: Sequence[KeptFill]) -> tuple[KeptFill, ...]:
    """The new fills beside those of the old ones that they leave, by marker and time."""
    left = [one for one in old if not any(one.meets(other.marker, other.first, other.last) for other in new)]
    return tuple(sorted([*left, *new], key=lambda fill: (fill.marker, fill.first)))


def _why_not(motion: Motion, names: Sequence[str], fill: KeptFill) -> str:
    if fill.marker not in names:
        return "the take has no such marker"
    rows, own = fill_rows(motion.frames, fill), motion.markers[:, list(names).index(fill.marker)]
    if rows.stop - rows.start != len(fill.xyz):
        return "the take has not all of its frames"
    if np.isfinite(own[rows, 0]).any():
        return "the marker is named in some of its frames now"
    beside = np.full((2, 3), np.nan)
    if rows.start > 0:
        beside[0] = own[rows.start - 1]
    if rows.stop < len(own):
        beside[1] = own[rows.stop]
    if not np.allclose(beside, fill.path[[0, -1]], rtol=0, atol=FILL_KEEPING.same_place_m, equal_nan=True):
        return "the marker is elsewhere now right before or after it"
    return ""
