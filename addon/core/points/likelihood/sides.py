# SPDX-License-Identifier: GPL-3.0-or-later
"""Left and right: which markers are each other's mirror image, and which limbs may be taken for the other side's.

So every subject teaches twice; and whole limbs are exchanged, which no single step from a naming undoes.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.rigid import pairwise_distances
from ...geometry.upright import upright_aligned
from .shape import learn_shape


@dataclass(frozen=True)
class SideOptions:
    """When a set has sides.

    max_mirrored_radii  that the mirrored mean may differ from the mean, where names mean sides; physical: 20 cm, half
                        of what left and right are apart
    """

    max_mirrored_radii: float = 0.25


SIDES = SideOptions()
MIN_LIMB_MARKERS = 2  # of one side; a single pair is a swap
MIRROR = np.array([1.0, -1.0, 1.0])
_OTHER = {"l": "r", "r": "l", "L": "R", "R": "L", "left": "right", "right": "left", "Left": "Right", "Right": "Left"}
_SIDE = re.compile(r"^(left|right|Left|Right)|^([LRlr])(?=[A-Z_.\- ])|(?<=[_.\- ])([LRlr])$")


def mirror_order(markers: Sequence[str]) -> np.ndarray | None:
    """(M,) each marker's mirror image, itself where it has none; None where the names have no sides."""
    order = np.arange(len(markers))
    for index, name in enumerate(markers):
        other = _SIDE.sub(lambda match: _OTHER[match.group()], name, count=1)
        if other in markers:
            order[index] = markers.index(other)
    paired = (order != np.arange(len(markers))).mean()
    return order if 2 * paired >= 1 and (order[order] == np.arange(len(markers))).all() else None


def mirrored(subjects: Sequence[np.ndarray], markers: Sequence[str]) -> list[np.ndarray]:
    """The mirror images of labelled clouds, one array (T, M, 3) a subject, with the sides' names exchanged.

    Empty where the names have no sides, or where the clouds do not look as if they meant sides.
    """
    order = mirror_order(tuple(markers))
    if order is None:
        return []
    mean = learn_shape(subjects).mean
    image = upright_aligned((mean[order] * MIRROR)[None], mean)[0]
    differs = np.sqrt(((image - mean) ** 2).sum(axis=1).mean())
    if differs > SIDES.max_mirrored_radii * np.sqrt((mean**2).sum(axis=1).mean()):
        return []
    return [points[:, order] * MIRROR for points in subjects]


def limb_exchanges(markers: Sequence[str], mean: np.ndarray) -> np.ndarray:
    """(X, M) for each way to exchange left with right, the marker whose point each marker takes.

    Limbs are whatever lies together in the mean cloud (M, 3): a foot, foot and shank, a hand, a side. None where the
    names have no sides.
    """
    order = mirror_order(markers)
    same = np.arange(len(markers))
    side = same[:0] if order is None else np.flatnonzero(order > same)
    if order is None or len(side) < MIN_LIMB_MARKERS:
        return np.zeros((0, len(markers)), dtype=int)
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
