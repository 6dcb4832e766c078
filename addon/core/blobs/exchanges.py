# SPDX-License-Identifier: GPL-3.0-or-later
"""Which markers can be taken for each other all at once: limbs that mirror each other, markers around one segment.

An exchange is an order (M,): marker m gets the blobs that had the name of marker order[m].
"""

from itertools import permutations

import numpy as np

from ..data.markersets import MarkerSet

MIRRORED = 0.03  # heights by which a marker may miss its mirror image
CLUSTERS = (3, 4)  # markers on one segment of which every order is tried


def standing_exchanges(markerset: MarkerSet) -> np.ndarray:
    """(B, M) every exchange that the marker set itself allows in any pose: limb for limb, and around a segment."""
    identity = np.arange(len(markerset))
    orders = [*_limbs(markerset, identity), *_clusters(markerset, identity)]
    return np.unique(np.array(orders, dtype=int).reshape(-1, len(identity)), axis=0)


def _limbs(markerset: MarkerSet, identity: np.ndarray):
    """For every segment off the middle: all that it carries for its mirror image on the other side."""
    rest, attachment = markerset.rest_markers, np.asarray(markerset.attachment)
    apart = np.linalg.norm(rest[:, None] * [1, -1, 1] - rest[None], axis=-1)
    mirror = apart.argmin(axis=1)
    paired = (apart.min(axis=1) < MIRRORED) & (mirror[mirror] == identity) & (mirror != identity)
    for segment in range(1, len(markerset.skeleton)):
        mine = identity[markerset.skeleton.carries[attachment, segment] & paired]
        if len(mine) and not np.isin(mirror[mine], mine).any():
            order = identity.copy()
            order[mine], order[mirror[mine]] = mirror[mine], mine
            yield order


def _clusters(markerset: MarkerSet, identity: np.ndarray):
    """Every other order of the markers of a segment that carries a few."""
    for segment in range(len(markerset.skeleton)):
        own = identity[np.asarray(markerset.attachment) == segment]
        if len(own) in CLUSTERS:
            for places in permutations(own):
                if list(places) != list(own):
                    order = identity.copy()
                    order[own] = places
                    yield order
