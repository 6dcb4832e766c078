# SPDX-License-Identifier: GPL-3.0-or-later
"""Points that stand apart from each other: what two subjects in one room look like before anything is named."""

import numpy as np


def groups_apart(points: np.ndarray, gap: float, least: float) -> list[np.ndarray]:
    """(P,) which of points (P, 3) m are together, for every group of `least` points or more; the largest first.

    Two groups are `gap` m apart or more.
    """
    from scipy.cluster.hierarchy import fcluster, linkage

    there = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(there) < 2:
        return []
    number = fcluster(linkage(points[there], "single"), gap, "distance")
    found = []
    for group in np.unique(number):
        own = np.zeros(len(points), dtype=bool)
        own[there[number == group]] = True
        found.append(own)
    return sorted((own for own in found if own.sum() >= least), key=lambda own: -own.sum())
