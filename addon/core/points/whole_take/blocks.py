# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers that sit side by side, named again all at once: two that are each in the place of a third are no exchange.

A heel, an ankle and a toe that have all slipped to points beside theirs explain each other. So they are let go
together: what the rest of the body says of where they are is one normal density, in which every choice of points for
all of them is weighed at the price of a product.
"""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from ...data.takes import NO_POINT
from ...geometry.rigid import pairwise_distances
from ..likelihood.model import Known
from ..likelihood.naming import Settled, expected_of
from ..refusals import REFUSAL
from .pairs import PAIRING


@dataclass(frozen=True)
class BlockOptions:
    """What is named again together.

    size        physical: markers at a time: a heel, an ankle and a toe
    points      memory and time: that each may be, the likeliest on its own; half names crowds alike
    proposed    memory and time: choices of each block that are weighed exactly; half or twice names crowds alike
    """

    size: int = 3
    points: int = 6
    proposed: int = 4


BLOCKS = BlockOptions()


def block_exchanges(known: Known, now: Settled, place: np.ndarray) -> np.ndarray:
    """(X, M + E) of each choice, the marker whose point each marker takes; nothing where no other choice is as likely.

    now are the settled frames, place (M + E,) the point that each marker has in them, extras after the set's own.
    """
    blocks = _blocks(known.fine.mean)
    if len(place) == now.naming.shape[1]:
        return _turned_about(known, now, place, blocks)
    found = [_choices(known, now, place, block) for block in blocks]
    return np.concatenate(found) if found else np.zeros((0, len(place)), int)


def _blocks(mean: np.ndarray) -> np.ndarray:
    """(K, B) markers, of a mean shape (M, 3) m, that sit side by side."""
    apart = pairwise_distances(mean)
    near = (apart < PAIRING.max_confused_m).sum(axis=1) >= BLOCKS.size
    order = np.argsort(apart, axis=1, kind="stable")
    return np.unique(np.sort(order[near, : BLOCKS.size], axis=1), axis=0)


def _turned_about(known: Known, now: Settled, place: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """(X, M) the likeliest ways to give the points of each block (K, B) to its markers again, out of `place` (M,).

    By what they win over the names so far, which is known without letting go of any: that of normal densities.
    """
    there = now.present[:, place[blocks]].swapaxes(0, 1)
    blocks = blocks[(there.mean(axis=1) >= REFUSAL.min_half).all(axis=1)]
    if not len(blocks):
        return np.zeros((0, len(place)), int)
    count, size = blocks.shape
    turns = np.array(list(permutations(range(size)))[1:])
    precision, pull = _held_together(known, now, blocks)
    points = now.points[:, place[blocks]].swapaxes(0, 1)
    moved = (points[:, :, turns] - points[:, :, None]).reshape(count, len(now.points), len(turns), 3 * size)
    square = ((moved @ precision) * moved).sum(axis=3) + 2 * (moved @ pull[..., None])[..., 0]
    there = now.present[:, place[blocks]].all(axis=2).T
    usual = middle_of_known(np.where(there[:, None], square.swapaxes(1, 2), np.nan))
    best = np.argsort(usual, axis=1, kind="stable")[:, : BLOCKS.proposed - 1]  # as they are is proposed, too
    block, turn = np.nonzero(np.isfinite(np.take_along_axis(usual, best, axis=1)))
    rows = np.tile(np.arange(len(place)), (len(block), 1))
    taken = np.take_along_axis(blocks[block], turns[best[block, turn]], axis=1)
    np.put_along_axis(rows, blocks[block], taken, axis=1)
    return np.unique(rows, axis=0)


def _held_together(known: Known, now: Settled, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The precision (K, F, 3 B, 3 B) 1/m² of the points of blocks (K, B) by all others, and (K, F, 3 B) 1/m what pulls.

    With the points in the names so far, that is their noise less what the shape is known by; so it is for Gaussians.
    """
    half = now.spread[:, blocks].swapaxes(0, 1).reshape(len(blocks), len(now.points), -1, now.spread.shape[3])
    inverse = 1 / np.repeat(known.fine.noise[blocks], 3, axis=1)[:, None]
    shared = half @ half.swapaxes(2, 3)
    precision = inverse[..., None] * (np.eye(inverse.shape[2]) - shared * inverse[..., None, :])
    return precision, inverse * now.left[:, blocks].swapaxes(0, 1).reshape(*half.shape[:3])


def _choices(known: Known, now: Settled, place: np.ndarray, block: np.ndarray) -> np.ndarray:
    """(X, M + E) the likeliest choices of points for a block (B,) other than the one that it has."""
    markers, every = now.naming.shape[1], len(place)
    let_go = np.isin(np.arange(markers), block)
    points, expected, shared = expected_of(known.fine, now.points, np.where(let_go, NO_POINT, now.naming), block)
    free = np.concatenate([block, np.arange(markers, every)])
    free = free[now.present[:, place[free]].mean(axis=0) >= REFUSAL.min_half]
    if len(free) < len(block):
        return np.zeros((0, every), int)
    covariance = shared + np.diag(np.repeat(known.fine.noise[block], 3))
    there = now.present[:, place[free]]
    away = np.where(there[:, None, :, None], points[:, None, place[free]] - expected[:, :, None], np.nan)
    own = np.stack([_square(covariance, away, (b,), np.arange(len(free))[:, None]) for b in range(len(block))])
    likely = np.argsort(own, axis=1, kind="stable")[:, : BLOCKS.points]
    choice = np.array(list(product(*likely)))
    choice = choice[(np.diff(np.sort(choice, axis=1), axis=1) > 0).all(axis=1)]
    square = _square(covariance, away, tuple(range(len(block))), choice)
    choice = free[choice[np.argsort(square, kind="stable")[: BLOCKS.proposed]]]
    rows = [_row(block, other, every) for other in choice if (other != block).any()]
    return np.array(rows, dtype=int).reshape(-1, every)


def _square(covariance: np.ndarray, away: np.ndarray, some: tuple[int, ...], choice: np.ndarray) -> np.ndarray:
    """(X,) the usual square of the distances of choices (X, B') of points, from where `some` B' of B markers are.

    covariance (F, 3 B, 3 B) m², away (F, B, C, 3) m from each marker to each point, NaN where it is not there.
    """
    axes = (3 * np.array(some)[:, None] + np.arange(3)).ravel()
    precision = np.linalg.inv(covariance[:, axes[:, None], axes])
    chosen = away[:, some, choice].reshape(len(away), len(choice), -1)
    square = ((chosen @ precision) * chosen).sum(axis=2)
    return middle_of_known(square.T)


def middle_of_known(values: np.ndarray) -> np.ndarray:
    """(...) the median of those of values (..., F) that are not NaN, infinity where there is none.

    NumPy's own is many times as slow where it has to look for NaN.
    """
    values = np.sort(values, axis=-1)
    count = np.isfinite(values).sum(axis=-1, keepdims=True)
    low, high = (np.take_along_axis(values, np.maximum(at, 0), axis=-1) for at in ((count - 1) // 2, count // 2))
    return np.where(count > 0, (low + high) / 2, np.inf)[..., 0]


def _row(block: np.ndarray, other: np.ndarray, every: int) -> np.ndarray:
    """(M + E,) whose point each takes, when a block takes those of others, who take what it leaves."""
    row = np.arange(every)
    row[block] = other
    own, new = set(block.tolist()), set(other.tolist())
    row[sorted(new - own)] = sorted(own - new)
    return row
