# SPDX-License-Identifier: GPL-3.0-or-later
"""Left and right in names: L and R before those of markers and joint centres, .L and .R behind those of segments.

And which limbs may be taken for the other side's: whole limbs are exchanged, which no single step from a naming undoes.
"""

import re
from collections.abc import Collection, Sequence

import numpy as np

from ..geometry.rigid import pairwise_distances

BODY_SIDES = ("L", "R")
# A marker on one side only: nothing on the other side mirrors it.
UNPAIRED = ("RBAK",)
MIN_LIMB_MARKERS = 2  # of one side; a single pair is a swap
MIRROR = np.array([1.0, -1.0, 1.0])
_OTHER = {"l": "r", "r": "l", "L": "R", "R": "L", "left": "right", "right": "left", "Left": "Right", "Right": "Left"}
_SIDE = re.compile(r"^(left|right|Left|Right)|^([LRlr])(?=[A-Z_.\- ])|(?<=[_.\- ])([LRlr])$")


def other_side(name: str) -> str:
    """The mirrored name of a marker, a joint centre or a segment; names without a side are their own."""
    if name.endswith((".L", ".R")):
        return name[:-1] + ("R" if name[-1] == "L" else "L")
    if name in UNPAIRED or name[:1] not in BODY_SIDES:
        return name
    return ("R" if name[0] == "L" else "L") + name[1:]


def is_right(name: str) -> bool:
    """Whether a marker, joint centre or segment is the body's right one of two."""
    return name.endswith(".R") or (name[:1] == "R" and name not in UNPAIRED)


def side_in(name: str, names: Collection[str]) -> str:
    """Which side a marker or a segment is on, "L" or "R", by another of the names that mirrors it; "" in the middle."""
    other = other_side(name)
    if other == name or other not in names:
        return ""
    return "R" if is_right(name) else "L"


def mirror_order(markers: Sequence[str]) -> np.ndarray | None:
    """(M,) each marker's mirror image, itself where it has none; None where the names have no sides.

    Large and small letters are alike: some call the knees r_knee and L_knee.
    """
    order, called = np.arange(len(markers)), [name.lower() for name in markers]
    for index, name in enumerate(markers):
        other = _SIDE.sub(lambda match: _OTHER[match.group()], name, count=1).lower()
        if other in called:
            order[index] = called.index(other)
    paired = (order != np.arange(len(markers))).mean()
    return order if 2 * paired >= 1 and (order[order] == np.arange(len(markers))).all() else None


def mirrored_places(mean: np.ndarray) -> np.ndarray:
    """(M,) each marker's mirror image by where it is in the mean cloud (M, 3), itself where it has none."""
    nearest = np.linalg.norm(mean[:, None] * MIRROR - mean, axis=-1).argmin(axis=1)
    same = np.arange(len(mean))
    return np.where(nearest[nearest] == same, nearest, same)


def limb_exchanges(order: np.ndarray | None, mean: np.ndarray) -> np.ndarray:
    """(X, M) for each way to exchange left with right, the marker whose point each marker takes.

    Limbs are whatever lies together in the mean cloud (M, 3): a foot, foot and shank, a hand, a side. `order` (M,) is
    each marker's mirror image; None has no limbs.
    """
    same = np.arange(len(mean))
    side = same[:0] if order is None else np.flatnonzero((order != same) & (mean[:, 1] > mean[order, 1]))
    if order is None or len(side) < MIN_LIMB_MARKERS:
        return np.zeros((0, len(mean)), dtype=int)
    both = 0.5 * (mean[side] + mean[order[side]] * MIRROR)
    limbs = _grown_together(both)
    found = np.tile(same, (len(limbs), 1))
    for row, limb in zip(found, limbs, strict=True):
        own = side[limb]
        row[own], row[order[own]] = order[own], own
    return found


def _grown_together(points: np.ndarray) -> list[list[int]]:
    """Which of points (N, 3) are together whenever two groups of them become one, the nearest first.

    Single linkage; SciPy's is a third of the time in which the program starts.
    """
    one, other = np.triu_indices(len(points), 1)
    groups, found = [[index] for index in range(len(points))], []
    for pair in np.argsort(pairwise_distances(points)[one, other], kind="stable").tolist():
        first, second = groups[one[pair]], groups[other[pair]]
        if first is not second:
            found.append(first + second)
            for index in found[-1]:
                groups[index] = found[-1]
    return found
