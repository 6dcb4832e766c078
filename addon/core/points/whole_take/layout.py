# SPDX-License-Identifier: GPL-3.0-or-later
"""Which marker of a take is which, decided once for all of it: by where training knows markers to sit.

In a take a marker keeps its distances, so whatever it was called first, its tracklets agree with each other. Whether
the name is right is another question. It is asked of whole frames that show most of the markers: by the exact
likelihood of all names as they are against that with two of them exchanged, or a limb with the other side's.
"""

from dataclasses import dataclass

import numpy as np

from ...data.takes import NO_POINT, evenly_spread
from ...geometry.upright import best_yaw, turned
from ..likelihood.model import Likelihood
from ..likelihood.naming import Settled, score_of, settle


@dataclass(frozen=True)
class LayoutNamingOptions:
    """How names are given to the markers of a take. All reckoned.

    frames           that are asked, of
    fullest          so many times as many that show most of the markers
    min_frames       fewer say nothing
    max_distance_m   between two markers that may be taken for each other
    min_markers      of a frame that is asked
    min_gain         log likelihood of the middle frame by which other names must be better
    max_question     log odds below which what is right is a question
    rounds           of asking, and asking again
    """

    frames: int = 16
    fullest: int = 16
    min_frames: int = 3
    max_distance_m: float = 0.35
    min_markers: int = 5
    min_gain: float = 1.0
    max_question: float = 6.0
    rounds: int = 12


LAYOUT_NAMING = LayoutNamingOptions()


@dataclass(frozen=True)
class Question:
    """Two markers that may be each other, and the log odds of the names that they have against the other way round."""

    one: int
    other: int
    odds: float


def named_by_layout(
    likelihood: Likelihood, placed: np.ndarray, absent: bool
) -> tuple[np.ndarray, tuple[Question, ...]]:
    """The name (M + E,) that each marker of a take should have, and what is hardly sure.

    placed (T, M + E, 3) m, NaN where there is none: the set's M markers as they are named so far, and E extras, of
    which each may be what a marker's name belongs to. With `absent`, names that nothing has are tried too.
    """
    every, markers = placed.shape[1], len(likelihood)
    name = np.arange(every)
    some = _frames(placed, markers)
    if len(some) < LAYOUT_NAMING.min_frames:
        return name, ()
    points = _aligned(some, likelihood.shape.mean)
    present = np.isfinite(points[..., 0])
    points, known = np.where(present[..., None], points, 0), likelihood.known
    naming = np.where(present[:, :markers], np.arange(markers), NO_POINT)
    now = settle(known.fine, known.constraints, points, present, naming)
    for _ in range(LAYOUT_NAMING.rounds):
        tried = _exchanges(now, name, known.exchanges, absent)
        place = np.argsort(name)
        others = place[tried[:, :markers]]
        rows = np.arange(len(points))[:, None, None]
        others = np.where(present[rows, others[None]], others[None], NO_POINT)
        gain = np.median(_scores(known, now, others) - now.score[:, None], axis=0)
        best = int(gain.argmax()) if len(gain) else 0
        if not len(gain) or gain[best] <= LAYOUT_NAMING.min_gain:
            return name, _questions(tried, gain, present[:, place].any(axis=0))
        name = np.argsort(place[tried[best]])
        now = settle(known.fine, known.constraints, now.points, present, others[:, best])
    return name, ()


def _questions(tried: np.ndarray, gain: np.ndarray, there: np.ndarray) -> tuple[Question, ...]:
    """Which of the exchanges (X, M + E) of two are hardly worse."""
    found = []
    for row, value in zip(tried, gain.tolist(), strict=True):
        pair = np.flatnonzero(row != np.arange(len(row)))
        if len(pair) == 2 and there[pair].all() and value > -LAYOUT_NAMING.max_question:
            found.append(Question(int(pair[0]), int(pair[1]), -value))
    return tuple(found)


def _aligned(points: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Points (F, M + E, 3), NaN where missing, turned and moved so that the first M lie on the mean (M, 3)."""
    known = points[:, : len(mean)]
    there = np.isfinite(known[..., :1])
    count = np.maximum(there.sum(axis=1, keepdims=True), 1)
    middle = np.where(there, known, 0).sum(axis=1, keepdims=True) / count
    goal = (mean * there).sum(axis=1, keepdims=True) / count
    yaw = best_yaw(np.where(there, known - middle, 0), (mean - goal) * there)
    return turned(points - middle, yaw) + goal


def _frames(placed: np.ndarray, markers: int) -> np.ndarray:
    """(F, M + E, 3) m, some of the frames that show most of the markers, all over the take."""
    count = np.isfinite(placed[:, :markers, 0]).sum(axis=1)
    fullest = np.sort(np.argsort(-count, kind="stable")[: LAYOUT_NAMING.frames * LAYOUT_NAMING.fullest])
    fullest = fullest[count[fullest] >= LAYOUT_NAMING.min_markers]
    return placed[fullest[evenly_spread(len(fullest), LAYOUT_NAMING.frames)]].astype(float)


def _exchanges(now: Settled, name: np.ndarray, limbs: np.ndarray, absent: bool) -> np.ndarray:
    """(X, M + E) for each exchange that is tried, the marker whose point each marker takes.

    Of two that are near each other, of which one is a marker of the set and one is there; and of limbs (L, M). A marker
    that is not there is where the others have it.
    """
    markers, every = now.naming.shape[1], len(name)
    place = np.argsort(name)
    seen = now.present[:, place]
    at = np.where(seen[..., None], now.points[:, place], np.nan)
    at[:, :markers] = np.where(seen[:, :markers, None], at[:, :markers], now.expected)
    with np.errstate(invalid="ignore"):
        between = np.linalg.norm(at[:, :, None] - at[:, None], axis=3)
    between = np.where(np.isfinite(between), between, np.inf)
    there = seen.any(axis=0)
    both = there | there[:, None] if absent else there & there[:, None]
    near = (np.median(between, axis=0) < LAYOUT_NAMING.max_distance_m) & both
    one, other = np.nonzero(np.triu(near, 1))
    one, other = one[one < markers], other[one < markers]
    pairs = np.tile(np.arange(every), (len(one), 1))
    rows = np.arange(len(one))
    pairs[rows, one], pairs[rows, other] = other, one
    rest = np.broadcast_to(np.arange(markers, every), (len(limbs), every - markers))
    return np.concatenate([pairs, np.concatenate([limbs, rest], axis=1)])


def _scores(known, now, others: np.ndarray) -> np.ndarray:
    """(F, X) log likelihoods of other namings (F, X, M) of frames."""
    found = np.empty(others.shape[:2])
    for index in range(others.shape[1]):
        found[:, index] = score_of(known.fine, known.constraints, now.points, now.worth, others[:, index])
    return found
