# SPDX-License-Identifier: GPL-3.0-or-later
"""Which markers can be taken for each other all at once: limbs that mirror each other, markers around one segment.

An exchange is an order (M,): marker m gets the blobs that had the name of marker order[m].
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from ..data.markersets import MarkerSet

MAX_SEGMENT_MARKERS = 4  # of which every order is tried; of five there would be 119


@dataclass(frozen=True)
class ExchangeOptions:
    """Which markers of a set can be taken for each other in any pose.

    max_mirror_miss      physical: heights by which a marker may miss its mirror image, 5 cm on a grown person, as the
                         markers of two sides are never placed quite alike
    """

    max_mirror_miss: float = 0.03


EXCHANGES = ExchangeOptions()


def standing_exchanges(markerset: MarkerSet, options: ExchangeOptions = EXCHANGES) -> np.ndarray:
    """(B, M) every exchange that the marker set itself allows in any pose: limb for limb, and around a segment."""
    identity = np.arange(len(markerset))
    orders = [
        *_limbs(markerset, identity, options.max_mirror_miss),
        *_clusters(markerset, identity, MAX_SEGMENT_MARKERS),
    ]
    return np.unique(np.array(orders, dtype=int).reshape(-1, len(identity)), axis=0)


def _limbs(markerset: MarkerSet, identity: np.ndarray, max_miss: float):
    """For every segment off the middle: all that it carries for its mirror image on the other side."""
    rest, attachment = markerset.rest_markers, np.asarray(markerset.attachment)
    miss = np.linalg.norm(rest[:, None] * [1, -1, 1] - rest[None], axis=-1)
    mirror = miss.argmin(axis=1)
    paired = (miss.min(axis=1) < max_miss) & (mirror[mirror] == identity) & (mirror != identity)
    for segment in range(1, len(markerset.skeleton)):
        mine = identity[markerset.skeleton.carries[attachment, segment] & paired]
        if len(mine) and not np.isin(mirror[mine], mine).any():
            order = identity.copy()
            order[mine], order[mirror[mine]] = mirror[mine], mine
            yield order


def _clusters(markerset: MarkerSet, identity: np.ndarray, most: int):
    """Every other order of the markers of a segment that carries a few."""
    for segment in range(len(markerset.skeleton)):
        own = identity[np.asarray(markerset.attachment) == segment]
        if 2 < len(own) <= most:  # two are neighbours anyhow
            for places in permutations(own):
                if list(places) != list(own):
                    order = identity.copy()
                    order[own] = places
                    yield order
