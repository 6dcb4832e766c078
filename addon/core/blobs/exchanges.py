# SPDX-License-Identifier: GPL-3.0-or-later
"""Which markers can be taken for each other all at once: limbs that mirror each other, markers around one segment.

An exchange is an order (M,): marker m gets the blobs that had the name of marker order[m].
"""

from collections.abc import Iterator
from itertools import permutations

import numpy as np

from ..data.markersets import MarkerSet

MAX_SEGMENT_MARKERS = 4  # of which every order is tried; of five there would be 119


def standing_exchanges(markerset: MarkerSet) -> np.ndarray:
    """(B, M) every exchange that the marker set itself allows in any pose: limb for limb, and around a segment."""
    orders = [*_limbs(markerset), *_clusters(markerset)]
    return np.unique(np.array(orders, dtype=int).reshape(-1, len(markerset)), axis=0)


def _limbs(markerset: MarkerSet) -> Iterator[np.ndarray]:
    """For every segment off the middle: all that it carries for its mirror image on the other side."""
    rest, identity = markerset.rest_markers, np.arange(len(markerset))
    mirror = np.linalg.norm(rest[:, None] * [1, -1, 1] - rest[None], axis=-1).argmin(axis=1)
    paired = (mirror[mirror] == identity) & (mirror != identity)
    for carried in markerset.skeleton.carries[np.asarray(markerset.attachment), 1:].T:
        mine = identity[carried & paired]
        if len(mine) and not np.isin(mirror[mine], mine).any():
            order = identity.copy()
            order[mine], order[mirror[mine]] = mirror[mine], mine
            yield order


def _clusters(markerset: MarkerSet) -> Iterator[np.ndarray]:
    """Every other order of the markers of a segment that carries a few."""
    for segment in range(len(markerset.skeleton)):
        own = np.flatnonzero(np.asarray(markerset.attachment) == segment)
        if 2 < len(own) <= MAX_SEGMENT_MARKERS:  # two are neighbours anyhow
            for places in permutations(own):
                order = np.arange(len(markerset))
                order[own] = places
                if list(places) != list(own):
                    yield order
