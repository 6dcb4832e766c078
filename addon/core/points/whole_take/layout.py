# SPDX-License-Identifier: GPL-3.0-or-later
"""Which marker of a take is which, decided once for all of it: by where training knows markers to sit.

In a take a marker keeps its distances, so whatever it was called first, its tracklets agree with each other. Whether
the name is right is another question. It is asked of whole frames that show most of the markers: by the exact
likelihood of all names as they are against that with two of them exchanged, or a limb with the other side's.
"""

from dataclasses import dataclass

import numpy as np

from ...data.takes import NO_POINT, evenly_spread
from ...geometry.rigid import in_axes, laid_on
from ...geometry.upright import upright_aligned
from ..likelihood.model import Known, Likelihood
from ..likelihood.naming import IMPOSSIBLE, Settled, name_odds, score_of, settle
from ..likelihood.swaps import alternatives
from .blocks import block_exchanges, shifts
from .pairs import PAIRING
from .tracklets import seen_in


@dataclass(frozen=True)
class LayoutNamingOptions:
    """How names are given to the markers of a take. All reckoned.

    frames           that are asked, of
    fullest          so many times as many that show most of the markers
    min_frames       fewer say nothing
    min_markers      of a frame that is asked
    min_gain         log likelihood of the middle frame by which other names must be better, and
    min_shift_gain   where several are moved on, each to the next one's name: a body of which little is known gains
                     something by that, too
    max_question     log odds below which what is right is a question
    max_frame        log likelihood that one frame can win or lose: beyond it training knows nothing
    about            log odds that a quick look at an exchange may be wrong by
    missing          log odds against a marker that is missing while something else is there in its stead: out of a
                     crowd one take in twenty has the one, one in twenty the other
    min_there        part of the take in which a marker is there, that is not missing, and
    min_steady       in which something else is, to be it: ghosts that follow each other are there for half of a short
                     take
    rounds           of asking, and asking again
    block            exchanges at once
    """

    frames: int = 16
    fullest: int = 16
    min_frames: int = 3
    min_markers: int = 5
    min_gain: float = 0.3
    min_shift_gain: float = 6.0
    max_question: float = 6.0
    max_frame: float = 12.0
    about: float = 4.0
    missing: float = 6.0
    min_there: float = 0.5
    min_steady: float = 0.8
    rounds: int = 12
    block: int = 16


LAYOUT_NAMING = LayoutNamingOptions()
NOTHING_HELD = np.zeros(0, int)


@dataclass(frozen=True)
class Question:
    """Two markers that may be each other, and the log odds of the names that they have against the other way round.

    `shifted` where more than the two would change names, each to the next one's: then frames err as the take does.
    `missing` where what has the one's name is seldom there, and the other is not.
    """

    one: int
    other: int
    odds: float
    shifted: bool = False
    missing: bool = False


def named_by_layout(
    likelihood: Likelihood, placed: np.ndarray, absent: bool, held: np.ndarray = NOTHING_HELD, crowd: bool = False
) -> tuple[np.ndarray, tuple[Question, ...]]:
    """The name (M + E,) that each marker of a take should have, and what is hardly sure.

    placed (T, M + E, 3) m, NaN where there is none: the set's M markers as they are named so far, and E extras, of
    which each may be what a marker's name belongs to. With `absent`, names that nothing has are tried too.
    The markers `held` keep their names. Out of a `crowd`, all markers of the set are there rather than something else.
    """
    every, markers = placed.shape[1], len(likelihood)
    name, known = np.arange(every), likelihood.known
    now = _settled(likelihood, _frames(placed, markers))
    if now is None:
        return name, ()
    present = now.present
    there = seen_in(placed).mean(axis=0)
    least = np.where(name < markers, LAYOUT_NAMING.min_there, LAYOUT_NAMING.min_steady)
    seldom = (there < least) & (not crowd)
    for _ in range(LAYOUT_NAMING.rounds):
        place = np.argsort(name)
        tried = _without_held(_exchanges(known, now, name, absent), held)
        others, gain, usual = _gains(known, now, place, tried, seldom)
        questions = _questions(tried, usual, present[:, place].any(axis=0), seldom[place])
        questions += _several(tried, usual, markers)
        if gain.max(initial=0) <= LAYOUT_NAMING.min_gain:
            tried = _others_than(tried, _without_held(block_exchanges(known, now, place), held))
            others, gain, usual = _gains(known, now, place, tried, seldom)
            questions += _several(tried, usual, markers)
        if gain.max(initial=0) <= LAYOUT_NAMING.min_gain:
            tried = _without_held(shifts(known, now, place), held)
            others, gain, usual = _gains(known, now, place, tried, seldom)
            if gain.max(initial=0) <= LAYOUT_NAMING.min_shift_gain:
                return name, questions + _several(tried, usual, markers, shifted=True)
        best = int(gain.argmax())
        name = np.argsort(place[tried[best]])
        now = settle(known.fine, known.constraints, now.points, present, others[:, best])
    return name, ()


def _others_than(tried: np.ndarray, more: np.ndarray) -> np.ndarray:
    """The exchanges (X, M + E) that are not among those (Y, M + E) that were tried."""
    known = {row.tobytes() for row in tried}
    return more[[row.tobytes() not in known for row in more]]


def _without_held(tried: np.ndarray, held: np.ndarray) -> np.ndarray:
    """The exchanges (X, M + E) that leave the markers `held` alone."""
    return tried[(tried[:, held] == held).all(axis=1)]


def usual_residual(likelihood: Likelihood, placed: np.ndarray, upright: bool = True) -> float:
    """The middle frame's mean square between markers placed (T, M + E, 3) m and where the set has them, over its noise.

    A set that is not the subject's has its markers elsewhere, whatever the pose. 0 where too few frames show enough.
    Who is not `upright`, but may lie or hang, is turned as the set stands first.
    """
    some = _frames(placed, len(likelihood))
    if not upright:
        some = in_axes(*laid_on(likelihood.shape.mean, some[:, : len(likelihood)]), some)
    now = _settled(likelihood, some)
    if now is None:
        return 0.0
    square = (now.left**2).sum(axis=2) / likelihood.known.fine.noise
    return float(np.median(square.sum(axis=1) / (3 * now.named.sum(axis=1))))


def _settled(likelihood: Likelihood, some: np.ndarray) -> Settled | None:
    """Frames (F, M + E, 3) m with the names that they have; None where they are too few."""
    if len(some) < LAYOUT_NAMING.min_frames:
        return None
    points = upright_aligned(some, likelihood.shape.mean)
    present = np.isfinite(points[..., 0])
    naming = np.where(present[:, : len(likelihood)], np.arange(len(likelihood)), NO_POINT)
    known = likelihood.known
    return settle(known.fine, known.constraints, np.where(present[..., None], points, 0), present, naming)


def _gains(
    known: Known, now: Settled, place: np.ndarray, tried: np.ndarray, seldom: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Namings (F, X, M) of frames by other names (X, M + E), and log likelihoods (X,) that these win.

    The one is the middle frame's, the other, where that is more, the mean of all frames: names that are wrong for the
    usual pose of a short take are far off in another. More of the markers are then something that is there, not
    `seldom` (M + E,), or fewer.
    """
    markers = now.naming.shape[1]
    others = place[tried[:, :markers]]
    fewer = seldom[place[:markers]].sum() - seldom[others].sum(axis=1)
    others = np.where(now.present[:, others], others, NO_POINT)
    each = _scores(known, now, others) - now.score[:, None]
    middle, usual = _usual(each)
    more = LAYOUT_NAMING.missing * fewer
    return others, middle + more, usual + more


def _usual(each: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the middle one of frames (F, X) wins and, where that is more, all of them on average: (X,) each."""
    middle = np.median(each, axis=0)
    mean = np.clip(each, -LAYOUT_NAMING.max_frame, LAYOUT_NAMING.max_frame).mean(axis=0)
    return middle, np.maximum(middle, mean)


def _questions(tried: np.ndarray, gain: np.ndarray, there: np.ndarray, seldom: np.ndarray) -> tuple[Question, ...]:
    """Which of the exchanges (X, M + E) of two are hardly worse; `there` and `seldom` (M + E,) by the names so far."""
    found = []
    for row, value in zip(tried, gain.tolist(), strict=True):
        pair = np.flatnonzero(row != np.arange(len(row)))
        if len(pair) == 2 and there[pair].any() and value > -LAYOUT_NAMING.max_question:
            one, other = pair.tolist()
            found.append(Question(one, other, -value, missing=bool(seldom[one] and not seldom[other])))
    return tuple(found)


def _several(tried: np.ndarray, gain: np.ndarray, markers: int, shifted: bool = False) -> tuple[Question, ...]:
    """The same of those (X, M + E) of several at once: each marker and the one whose point it would take."""
    found: dict[tuple[int, int], float] = {}
    for row, value in zip(tried.tolist(), gain.tolist(), strict=True):
        moved = [(one, other) for one, other in enumerate(row) if one != other]
        if len(moved) > 2 and value > -LAYOUT_NAMING.max_question:
            for pair in (pair for pair in moved if pair[0] < markers):
                found[pair] = min(-value, found.get(pair, np.inf))
    return tuple(Question(*pair, odds, shifted) for pair, odds in found.items())


def _frames(placed: np.ndarray, markers: int) -> np.ndarray:
    """(F, M + E, 3) m, some of the frames that show most of the markers, all over the take."""
    count = seen_in(placed)[:, :markers].sum(axis=1)
    fullest = np.sort(np.argsort(-count, kind="stable")[: LAYOUT_NAMING.frames * LAYOUT_NAMING.fullest])
    fullest = fullest[count[fullest] >= LAYOUT_NAMING.min_markers]
    return placed[fullest[evenly_spread(len(fullest), LAYOUT_NAMING.frames)]].astype(float)


def _exchanges(known: Known, now: Settled, name: np.ndarray, absent: bool) -> np.ndarray:
    """(X, M + E) for each exchange that is tried, the marker whose point each marker takes.

    Of two that are near each other, of which one is a marker of the set and one is there; and of limbs. A marker that
    is not there is where the others have it.
    """
    limbs = known.exchanges
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
    near[:markers, markers:] &= _worth_trying(known, now, place)
    one, other = np.nonzero(np.triu(near, 1))
    one, other = one[one < markers], other[one < markers]
    worth = (other >= markers) | _may_gain(known, now, one, np.minimum(other, markers - 1))
    one, other = one[worth], other[worth]
    pairs = np.tile(np.arange(every), (len(one), 1))
    rows = np.arange(len(one))
    pairs[rows, one], pairs[rows, other] = other, one
    rest = np.broadcast_to(np.arange(markers, every), (len(limbs), every - markers))
    return np.concatenate([pairs, np.concatenate([limbs, rest], axis=1)])


def _may_gain(known: Known, now: Settled, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(K,) whether names may gain by an exchange of markers (K,), or nearly, by what it does to them alone.

    That is quickly known, but of a point that is far from where the other's marker is expected.
    """
    found = alternatives(known.fine, known.constraints, now)
    first, second = now.named[:, one], now.named[:, other]
    moved = np.where(first, found.move[:, one, other], found.move[:, other, one])
    swapped = found.swap[:, np.maximum(one, other), np.minimum(one, other)]
    each = np.where(first & second, swapped, np.where(first | second, moved, 0.0))
    unknown = (each <= IMPOSSIBLE).any(axis=0)
    return unknown | (_usual(each)[1] > -LAYOUT_NAMING.max_question - LAYOUT_NAMING.about)


def _worth_trying(known: Known, now: Settled, place: np.ndarray) -> np.ndarray:
    """(M, E) whether a marker may be an extra, by what all others say of it: that is quickly known."""
    markers = now.naming.shape[1]
    odds = name_odds(known.fine, known.constraints, now)
    own = np.take_along_axis(odds, np.maximum(now.naming, 0)[..., None], axis=2)
    gain = odds[:, :, place[markers:]] - np.where(now.named[..., None], own, 0)
    return np.median(gain, axis=0) > -LAYOUT_NAMING.max_question - LAYOUT_NAMING.about


def _scores(known: Known, now: Settled, others: np.ndarray) -> np.ndarray:
    """(F, X) log likelihoods of other namings (F, X, M) of frames."""
    found = np.empty(others.shape[:2])
    for first in range(0, others.shape[1], LAYOUT_NAMING.block):
        some = others[:, first : first + LAYOUT_NAMING.block]
        points, worth = (np.repeat(part, some.shape[1], axis=0) for part in (now.points, now.worth))
        score = score_of(known.fine, known.constraints, points, worth, some.reshape(-1, some.shape[2]))
        found[:, first : first + LAYOUT_NAMING.block] = score.reshape(some.shape[:2])
    return found
