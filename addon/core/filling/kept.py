# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills as a take keeps them: what was filled, and whether it still goes with what is measured around it."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.takes import Motion

# How far samples beside a fill may be from those that it was made between: files keep single precision, 1e-6 m at 10 m,
# and another trajectory in the marker's place is hardly ever as near.
SAME_PLACE_M = 1e-4


@dataclass(frozen=True, eq=False)
class KeptFill:
    """A gap that was filled, from frame `first` to `last` of the source's numbers, both included."""

    marker: str  # its name
    first: int
    last: int
    method: str  # that filled it, such as "regression+pca"
    expected: float  # the mean error to expect, m; NaN where no trial could say
    # (L + 2, 3) m; between the marker's places right before and right after, NaN at an end of the take
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
    markers, residual = motion.markers.copy(order="K"), motion.residual.copy(order="K")
    reasons = ["the take has no such marker"] * len(fills)
    for index, own in fills_by_marker(motion.frames, names, fills).items():
        for number, reason in put_in_marker(markers[:, index], residual[:, index], own, fills).items():
            reasons[number] = reason
    return replace(motion, markers=markers, residual=residual), tuple(reasons)


def fills_by_marker(
    frames: np.ndarray, names: Sequence[str], fills: Sequence[KeptFill]
) -> dict[int, list[tuple[int, slice]]]:
    """By the index of each marker its fills: the number of each in `fills`, and which of the frames (T,) it is of."""
    index = {name: place for place, name in enumerate(names)}
    starts = np.searchsorted(frames, [fill.first for fill in fills]).tolist()
    stops = np.searchsorted(frames, [fill.last + 1 for fill in fills]).tolist()
    found: dict[int, list[tuple[int, slice]]] = {}
    for number, (fill, start, stop) in enumerate(zip(fills, starts, stops, strict=True)):
        if fill.marker in index:
            found.setdefault(index[fill.marker], []).append((number, slice(start, stop)))
    return found


def put_in_marker(
    xyz: np.ndarray, residual: np.ndarray, own: Iterable[tuple[int, slice]], fills: Sequence[KeptFill]
) -> dict[int, str]:
    """Puts the fills of a marker that go with it into its places (T, 3) and residuals (T,), as `put_fills` does.

    own are its fills, as `fills_by_marker` gives them; why each does not go with it is given, by its number.
    """
    own = list(own)
    reasons = {number: _why_not(xyz, rows, fills[number]) for number, rows in own}
    for number, rows in own:
        if not reasons[number]:
            xyz[rows], residual[rows] = fills[number].xyz, 0.0
    return reasons


def filled_samples(frames: np.ndarray, names: Sequence[str], fills: Sequence[KeptFill]) -> np.ndarray:
    """(T, M) True where one of the fills put a sample into a take of these frames (T,) and markers."""
    flags = np.zeros((len(names), len(frames)), bool)
    for index, own in fills_by_marker(frames, names, fills).items():
        for _, rows in own:
            flags[index, rows] = True
    return flags.T


def replaced_fills(old: Iterable[KeptFill], new: Sequence[KeptFill]) -> tuple[KeptFill, ...]:
    """The new fills beside those of the old ones that they leave, by marker and time."""
    return tuple(sorted([*fills_beside(old, new), *new], key=lambda fill: (fill.marker, fill.first)))


def fills_beside(old: Iterable[KeptFill], new: Sequence[KeptFill]) -> list[KeptFill]:
    """Those of the old fills that meet none of the new ones."""
    return [one for one in old if not any(one.meets(other.marker, other.first, other.last) for other in new)]


def _why_not(own: np.ndarray, rows: slice, fill: KeptFill) -> str:
    """Why a fill does not go with its marker's places (T, 3); "" where it does."""
    if rows.stop - rows.start != len(fill.path) - 2:
        return "the take has not all of its frames"
    if np.isfinite(own[rows, 0]).any():
        return "the marker is named in some of its frames now"
    for place, was in ((rows.start - 1, fill.path[0]), (rows.stop, fill.path[-1])):
        now = own[place].tolist() if 0 <= place < len(own) else (math.nan,) * 3
        if not all(map(_is_place, now, was.tolist())):
            return "the marker is elsewhere now right before or after it"
    return ""


def _is_place(one: float, other: float) -> bool:
    """Whether two coordinates are of one place, or of none."""
    return abs(one - other) <= SAME_PLACE_M or (math.isnan(one) and math.isnan(other))
