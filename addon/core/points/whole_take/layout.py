# SPDX-License-Identifier: GPL-3.0-or-later
"""Which marker of a take is which, decided once for all of it: by where training knows markers to sit.

In a take a marker keeps its distances, so whatever it was called first, its tracklets agree with each other. Whether
the name is right is another question. It is asked of whole frames that show most of the markers: by the exact
likelihood of all names as they are against that with two of them exchanged, or a limb with the other side's.
"""

from dataclasses import dataclass

import numpy as np

from ...data.takes import NO_POINT
from ..likelihood.model import Known, Likelihood
from ..likelihood.naming import IMPOSSIBLE, Settled, name_odds, score_of, settle
from ..likelihood.swaps import alternatives
from .blocks import block_exchanges
from .objective import clipped, settled_frames
from .pairs import PAIRING


@dataclass(frozen=True)
class LayoutNamingOptions:
    """How names are given to the markers of a crowd.

    min_gain      log likelihood of the middle frame by which other names must be better; measured: twice of it names
                  4 % of crowds wrong, half none
    max_question  log odds below which what is right is a question, and that a quick look may be wrong by; measured:
                  half or twice names crowds alike
    block         memory: exchanges at once
    """

    min_gain: float = 0.3
    max_question: float = 6.0
    block: int = 16


LAYOUT_NAMING = LayoutNamingOptions()
LAYOUT_ROUNDS = 12  # of asking, and asking again; by time


@dataclass(frozen=True)
class Question:
    """A marker whose points may be another's, or an extra's, and the log odds of the names that they have."""

    one: int
    other: int
    odds: float


def named_by_layout(
    likelihood: Likelihood, placed: np.ndarray, held: np.ndarray, absent: bool
) -> tuple[np.ndarray, tuple[Question, ...]]:
    """The name (M + E,) that each marker of a crowd should have, and what is hardly sure.

    placed (F, M + E, 3) m in frames that show most, NaN where there is none: the set's M markers as they are named so
    far, and E extras, of which each may be what a marker's name belongs to. The markers `held` keep their names. With
    `absent`, names that nothing has are tried too.
    """
    name, known = np.arange(placed.shape[1]), likelihood.known
    now = settled_frames(likelihood, placed)
    if now is None:
        return name, ()
    present = now.present
    questions: tuple[Question, ...] = ()
    for _ in range(LAYOUT_ROUNDS):
        place = np.argsort(name)
        tried = _without_held(_exchanges(known, now, name, absent), held)
        others, middle, usual = _gains(known, now, place, tried)
        questions = _questions(tried, usual, len(likelihood))
        if middle.max(initial=0) <= LAYOUT_NAMING.min_gain:
            tried = _others_than(tried, _without_held(block_exchanges(known, now, place), held))
            others, middle, usual = _gains(known, now, place, tried)
            questions += _questions(tried, usual, len(likelihood))
            if middle.max(initial=0) <= LAYOUT_NAMING.min_gain:
                break
        best = int(middle.argmax())
        name = np.argsort(place[tried[best]])
        now = settle(known.fine, known.constraints, now.points, present, others[:, best])
    return name, questions


def _others_than(tried: np.ndarray, more: np.ndarray) -> np.ndarray:
    """The exchanges (X, M + E) that are not among those (Y, M + E) that were tried."""
    known = {row.tobytes() for row in tried}
    return more[[row.tobytes() not in known for row in more]]


def _without_held(tried: np.ndarray, held: np.ndarray) -> np.ndarray:
    """The exchanges (X, M + E) that leave the markers `held` alone."""
    return tried[(tried[:, held] == held).all(axis=1)]


def _gains(
    known: Known, now: Settled, place: np.ndarray, tried: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Namings (F, X, M) of frames by other names (X, M + E), and log likelihoods (X,) that these win.

    The one is the middle frame's, the other, where that is more, the mean of all frames: names that are wrong for the
    usual pose of a short take are far off in another.
    """
    others = place[tried[:, : now.naming.shape[1]]]
    others = np.where(now.present[:, others], others, NO_POINT)
    return others, *_usual(_scores(known, now, others) - now.score[:, None])


def _usual(each: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the middle one of frames (F, X) wins and, where that is more, all of them on average: (X,) each."""
    middle = np.median(each, axis=0)
    return middle, np.maximum(middle, clipped(each, 2))


def _questions(tried: np.ndarray, gain: np.ndarray, markers: int) -> tuple[Question, ...]:
    """Of exchanges (X, M + E) that are hardly worse: each marker, and the marker whose point it would take."""
    found: dict[tuple[int, int], float] = {}
    for row, value in zip(tried.tolist(), gain.tolist(), strict=True):
        if value > -LAYOUT_NAMING.max_question:
            for pair in [(one, other) for one, other in enumerate(row[:markers]) if one != other and other < markers]:
                found[pair] = min(-value, found.get(pair, np.inf))
    return tuple(Question(*pair, odds) for pair, odds in found.items())


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
    return unknown | (_usual(each)[1] > -2 * LAYOUT_NAMING.max_question)


def _worth_trying(known: Known, now: Settled, place: np.ndarray) -> np.ndarray:
    """(M, E) whether a marker may be an extra, by what all others say of it: that is quickly known."""
    markers = now.naming.shape[1]
    odds = name_odds(known.fine, known.constraints, now)
    own = np.take_along_axis(odds, np.maximum(now.naming, 0)[..., None], axis=2)
    gain = odds[:, :, place[markers:]] - np.where(now.named[..., None], own, 0)
    return np.median(gain, axis=0) > -2 * LAYOUT_NAMING.max_question


def _scores(known: Known, now: Settled, others: np.ndarray) -> np.ndarray:
    """(F, X) log likelihoods of other namings (F, X, M) of frames."""
    found = np.empty(others.shape[:2])
    for first in range(0, others.shape[1], LAYOUT_NAMING.block):
        some = others[:, first : first + LAYOUT_NAMING.block]
        points, worth = (np.repeat(part, some.shape[1], axis=0) for part in (now.points, now.worth))
        score = score_of(known.fine, known.constraints, points, worth, some.reshape(-1, some.shape[2]))
        found[:, first : first + LAYOUT_NAMING.block] = score.reshape(some.shape[:2])
    return found
