# SPDX-License-Identifier: GPL-3.0-or-later
"""Hit rates P(S, m_i): how often a solver gives a marker its right point and no other, under random occlusions.

A sample is a labelled frame with some of its points taken away. A solver answers for a marker when it finds a feasible
labelling; the answer is a hit when all that it finds agree on the right point. A solver that has lost a marker of its
own should stay silent; an answer with another point in its place is what later becomes a false assignment, so samples
with occlusions belong into the rate. Silence is not counted: the paper's property that rates grow with the subset
would make no sense otherwise, as large solvers are silent most of the time.
"""

from dataclasses import dataclass

import numpy as np

from .masks import WORD, Masks
from .model import Record
from .solver import TreeSearch


@dataclass(frozen=True)
class Occlusions:
    """How samples are drawn: `draws` of each frame, each with 0 to `most` points removed, equally likely."""

    most: int = 5  # paper, 5: up to five occlusions
    draws: int = 16  # memory


def draw_occlusions(masks: Masks, options: Occlusions, generator: np.random.Generator) -> np.ndarray:
    """(T, D, W) bits of the points removed from each cloud in each draw; missing points count as removed."""
    present = masks.clouds.present
    shape = (len(present), options.draws, present.shape[1])
    keys = np.where(present[:, None], generator.random(shape), np.inf)
    count = generator.integers(0, options.most + 1, shape[:2])
    rank = keys.argsort(axis=2).argsort(axis=2)
    return masks.packed((rank < count[..., None]) | ~present[:, None])


def assess(search: TreeSearch, masks: Masks, removed: np.ndarray) -> Record:
    """The record of a solver on clouds whose point m is marker m, under the occlusions `removed` (T, D, W)."""
    cloud, chosen = search(masks)
    wrong = (chosen != np.array(search.markers)).any(axis=1)
    known = np.zeros(len(removed), dtype=bool)
    known[cloud[~wrong]] = True
    return tally(search.markers, known, cloud[wrong], chosen[wrong], masks, removed)


def tally(markers, known: np.ndarray, cloud: np.ndarray, chosen: np.ndarray, masks: Masks, removed) -> Record:
    """Counts hits and answers marker by marker.

    known (T,) the wholly right labelling is feasible; cloud (R,) ascending and chosen (R, s): the feasible labellings
    with a mistake. A labelling counts in the draws that leave it all its points.
    """
    size, marks = len(markers), np.uint64(1) << np.arange(len(markers), dtype=np.uint64)
    own = np.bitwise_or.reduce(masks.bit[list(markers)], axis=0)
    whole = known[:, None] & ((removed & own) == 0).all(axis=2)
    hits = np.full(size, whole.sum())
    failures, answers = np.zeros(size, dtype=np.int64), hits.copy()
    if len(cloud):
        used = np.bitwise_or.reduce(masks.bit[chosen], axis=1)
        alive = ((removed[cloud] & used[:, None]) == 0).all(axis=2)
        right = ((chosen == np.array(markers)) * marks).sum(axis=1, dtype=np.uint64)
        starts = np.flatnonzero(np.append(True, cloud[1:] != cloud[:-1]))
        any_right = _any_of(alive, right, starts)
        any_wrong = _any_of(alive, marks.sum(dtype=np.uint64) & ~right, starts)
        before = whole[cloud[starts]]
        any_right[before] = marks.sum(dtype=np.uint64)
        hits += _per_bit(any_right & ~any_wrong, size) - before.sum()
        failures += _per_bit(any_wrong & ~any_right, size)
        answers += _per_bit(any_right | any_wrong, size) - before.sum()
    return Record(hits, failures, answers, removed.shape[0] * removed.shape[1])


def _any_of(alive: np.ndarray, bits: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """(C, D) the bits of all living rows (R, D) of each cloud together."""
    return np.bitwise_or.reduceat(np.where(alive, bits[:, None], np.uint64(0)), starts, axis=0)


def _per_bit(words: np.ndarray, size: int) -> np.ndarray:
    """(size,) in how many words each bit is set."""
    octets = np.ascontiguousarray(words).reshape(-1, 1).view(np.uint8)
    return np.unpackbits(octets, axis=1, bitorder="little", count=min(size, WORD)).sum(axis=0, dtype=np.int64)
