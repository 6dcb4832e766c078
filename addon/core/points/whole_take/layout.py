# SPDX-License-Identifier: GPL-3.0-or-later
"""Which marker of a take is which, decided once for all of it: by where training knows markers to sit.

In a take a marker keeps its distances, so whatever it was called first, its tracklets agree with each other. Whether
the name is right is another question. It is asked of whole frames that show most of the markers: by the exact
likelihood of all names as they are against that with two of them exchanged, or a limb with the other side's.
"""

from dataclasses import dataclass

import numpy as np

from ...data.takes import NO_POINT, evenly_spread
from ...geometry.upright import upright_aligned
from ..likelihood.model import Known, Likelihood
from ..likelihood.naming import Settled, score_of, settle
from .pairs import PAIRING


@dataclass(frozen=True)
class LayoutNamingOptions:
    """How names are given to the markers of a take. All reckoned.

    frames           that are asked, of
    fullest          so many times as many that show most of the markers
    min_frames       fewer say nothing
    min_markers      of a frame that is asked
    min_gain         log likelihood of the middle frame by which other names must be better
    max_question     log odds below which what is right is a question
    rounds           of asking, and asking again
    """

    frames: int = 16
    fullest: int = 16
    min_frames: int = 3
    min_markers: int = 5
    min_gain: float = 1.0
    max_question: float = 6.0
    rounds: int = 12


LAYOUT_NAMING = LayoutNamingOptions()
NOTHING_HELD = np.zeros(0, int)


@dataclass(frozen=True)
class Question:
    """Two markers that may be each other, and the log odds of the names that they have against the other way round."""

    one: int
    other: int
    odds: float


def named_by_layout(
    likelihood: Likelihood, placed: np.ndarray, absent: bool, held: np.ndarray = NOTHING_HELD
) -> tuple[np.ndarray, tuple[Question, ...]]:
    """The name (M + E,) that each marker of a take should have, and what is hardly sure.

    placed (T, M + E, 3) m, NaN where there is none: the set's M markers as they are named so far, and E extras, of
    which each may be what a marker's name belongs to. With `absent`, names that nothing has are tried too.
    The markers `held` keep their names.
    """
    every, markers = placed.shape[1], len(likelihood)
    name = np.arange(every)
    some = _frames(placed, markers)
    if len(some) < LAYOUT_NAMING.min_frames:
        return name, ()
    points = upright_aligned(some, likelihood.shape.mean)
    present = np.isfinite(points[..., 0])
    points, known = np.where(present[..., None], points, 0), likelihood.known
    naming = np.where(present[:, :markers], np.arange(markers), NO_POINT)
    now = settle(known.fine, known.constraints, points, present, naming)
    for _ in range(LAYOUT_NAMING.rounds):
        tried = _exchanges(now, name, known.exchanges, absent)
        tried = tried[(tried[:, held] == held).all(axis=1)]
        place = np.argsort(name)
        others = place[tried[:, :markers]]
        others = np.where(present[:, others], others, NO_POINT)
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
    near = (np.median(between, axis=0) < PAIRING.max_confused_m) & both
    one, other = np.nonzero(np.triu(near, 1))
    one, other = one[one < markers], other[one < markers]
    pairs = np.tile(np.arange(every), (len(one), 1))
    rows = np.arange(len(one))
    pairs[rows, one], pairs[rows, other] = other, one
    rest = np.broadcast_to(np.arange(markers, every), (len(limbs), every - markers))
    return np.concatenate([pairs, np.concatenate([limbs, rest], axis=1)])


def _scores(known: Known, now: Settled, others: np.ndarray) -> np.ndarray:
    """(F, X) log likelihoods of other namings (F, X, M) of frames."""
    found = np.empty(others.shape[:2])
    for index in range(others.shape[1]):
        found[:, index] = score_of(known.fine, known.constraints, now.points, now.worth, others[:, index])
    return found
