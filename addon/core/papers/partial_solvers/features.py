# SPDX-License-Identifier: GPL-3.0-or-later
"""The four geometric functions of the partial-solvers paper (its table 1), and all features they give over a set.

All are worked out from tables of a frame, the distances and height differences of every pair of points above all, so
that a search that tries many labellings of the same points only ever looks values up.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from .model import DOMAIN, FUNCTIONS, KIND_ANGLE, KIND_DISTANCE, KIND_HEIGHT, KIND_RATIO, NO_POINT, PAPER_FUNCTIONS

UP = 2


def all_features(
    markers: int, functions: tuple[str, ...] = PAPER_FUNCTIONS, most: int | None = None, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Kind (F,) and points (F, 4) of every feature that `functions` give over `markers` points.

    Combinations that give the same value up to its sign count once. Above `most` features, as many ratios as fit are
    drawn by `seed`: their number grows with the fourth power of the markers.
    """
    pairs = np.array(list(combinations(range(markers), 2)), dtype=np.int32).reshape(-1, 2)
    triples = [(apex, b, c) for apex in range(markers) for b, c in pairs if apex not in (b, c)]
    every = {"angle": triples, "distance": pairs, "ratio": _ratios(markers), "height": pairs, "turn": triples}
    rows = {name: np.asarray(every[name], dtype=np.int32) for name in FUNCTIONS if name in functions}
    beyond = sum(map(len, rows.values())) - most if most else 0
    if beyond > 0 and "ratio" in rows:
        count = len(rows["ratio"])
        chosen = np.random.default_rng(seed).choice(count, max(count - beyond, 0), replace=False)
        rows["ratio"] = rows["ratio"][np.sort(chosen)]
    kinds = [np.full(len(part), FUNCTIONS.index(name), dtype=np.int32) for name, part in rows.items()]
    points = [_padded(part, DOMAIN[FUNCTIONS.index(name)]) for name, part in rows.items()]
    return np.concatenate(kinds), np.concatenate(points)


def _ratios(markers: int) -> np.ndarray:
    """(R, 4) every unordered pair of two segments without a point in common."""
    fours = np.array(list(combinations(range(markers), 4)), dtype=np.int32).reshape(-1, 4)
    return np.concatenate([fours, fours[:, [0, 2, 1, 3]], fours[:, [0, 3, 1, 2]]])


def _padded(rows: np.ndarray, domain: int) -> np.ndarray:
    points = np.full((len(rows), 4), NO_POINT, dtype=np.int32)
    points[:, :domain] = rows.reshape(-1, domain)
    return points


@dataclass(frozen=True, eq=False)
class Tables:
    """What every feature of T clouds of P points is made of."""

    distance: np.ndarray  # (T, P, P) m
    height: np.ndarray  # (T, P, P) m, how much higher the first is than the second
    ground: np.ndarray  # (T, P, 2) m, where the points are seen from above
    present: np.ndarray  # (T, P) False where a point is missing (its rows and columns are NaN)


def tables(points: np.ndarray) -> Tables:
    """The tables of clouds (T, P, 3) m, z up, NaN where a point is missing."""
    points = np.asarray(points, dtype=float)
    square = np.zeros((*points.shape[:2], points.shape[1]))
    for axis in range(3):
        square += (points[:, :, None, axis] - points[:, None, :, axis]) ** 2
    up = points[..., UP]
    present = np.isfinite(points).all(axis=-1)
    return Tables(np.sqrt(square), up[:, :, None] - up[:, None, :], points[..., :UP], present)


def values(kind: int, frame: np.ndarray, points: np.ndarray, within: Tables) -> np.ndarray:
    """Features of one kind: of the cloud `frame` (...) and the points (..., domain), shapes that broadcast.

    NaN where a point is missing, or where points coincide so that there is no angle.
    """
    first, second = points[..., 0], points[..., 1]
    if kind == KIND_HEIGHT:
        return within.height[frame, first, second]
    one = within.distance[frame, first, second]
    if kind == KIND_DISTANCE:
        return one
    third = points[..., 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        if kind == KIND_RATIO:
            two = within.distance[frame, third, points[..., 3]]
            return 2.0 * (one - two) / (one + two)
        two = within.distance[frame, first, third]
        if kind == KIND_ANGLE:
            across = within.distance[frame, second, third]
            return np.arccos(np.clip((one**2 + two**2 - across**2) / (2.0 * one * two), -1.0, 1.0))
        apex = within.ground[frame, first]
        ab, ac = within.ground[frame, second] - apex, within.ground[frame, third] - apex
        return (ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0]) / (one * two)
