# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole limbs that may be taken for those of the other side, which no single step from a naming undoes."""

from collections.abc import Sequence

import numpy as np

from .sides import MIRROR, mirror_order

FEWEST = 2  # markers of one side; a single pair is a swap


def limb_exchanges(markers: Sequence[str], mean: np.ndarray) -> np.ndarray:
    """(X, M) for each way to exchange left with right, the marker whose point each marker takes.

    Limbs are whatever lies together in the mean cloud (M, 3): a foot, foot and shank, a hand, a side. None where the
    names have no sides.
    """
    from scipy.cluster.hierarchy import linkage

    order = mirror_order(markers)
    same = np.arange(len(markers))
    side = np.flatnonzero(order > same) if order is not None else same[:0]
    if len(side) < FEWEST:
        return np.zeros((0, len(markers)), dtype=int)
    both = 0.5 * (mean[side] + mean[order[side]] * MIRROR)
    limbs: list[list[int]] = [[index] for index in range(len(side))]
    for first, second, _, _ in linkage(both, "single"):
        limbs.append(limbs[int(first)] + limbs[int(second)])
    found = np.tile(same, (len(limbs) - len(side), 1))
    for row, limb in zip(found, limbs[len(side) :], strict=True):
        own = side[limb]
        row[own], row[order[own]] = order[own], own
    return found
