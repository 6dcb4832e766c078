# SPDX-License-Identifier: GPL-3.0-or-later
"""Which marker of a take is which, decided once for all of it: by where training knows markers to sit.

In a take a marker keeps its distances, so whatever it was called first, its tracklets agree with each other. Whether
the name is right is another question. It is asked of whole frames that show most of the markers: by the exact
likelihood of all names as they are against that with two of them exchanged, or a limb with the other side's.

A heel, an ankle and a toe that have all slipped to points beside theirs explain each other, and are no exchange of two.
So markers that sit side by side are let go together, too: what the rest of the body says of where they are is one
normal density, in which every choice of points for all of them is weighed at the price of a product.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from ...data.takes import NO_POINT
from ...geometry.rigid import pairwise_distances
from ..likelihood.model import Known, Likelihood
from ..likelihood.naming import Settled, expected_of, score_of, settle
from ..likelihood.solving import MIN_GAIN
from ..refusals import REFUSAL
from .objective import OBJECTIVE, clipped, settled_frames
from .pairs import PAIRING


class BLOCKS:
    """What is named again together."""

    size: int = 3  # physical: markers at a time: a heel, an ankle and a toe
    # that each may be, the likeliest on its own, and choices of each block that are weighed exactly; half names crowds
    # alike
    points: int = 6  # memory and time


def block_exchanges(known: Known, now: Settled, place: np.ndarray) -> np.ndarray:
    """(X, M + E) of each choice, the marker whose point each marker takes; nothing where no other choice is as likely.

    now are the settled frames, place (M + E,) the point that each marker has in them, extras after the set's own.
    """
    found = [_choices(known, now, place, block) for block in _blocks(known.fine.mean)]
    return np.concatenate(found) if found else np.zeros((0, len(place)), int)


def _blocks(mean: np.ndarray) -> np.ndarray:
    """(K, B) markers, of a mean shape (M, 3) m, that sit side by side."""
    apart = pairwise_distances(mean)
    near = (apart < PAIRING.max_confused_m).sum(axis=1) >= BLOCKS.size
    order = np.argsort(apart, axis=1, kind="stable")
    return np.unique(np.sort(order[near, : BLOCKS.size], axis=1), axis=0)


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
    choice = free[choice[np.argsort(square, kind="stable")[: BLOCKS.points]]]
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


LAYOUT_ROUNDS = 12  # of asking, and asking again; by time


@dataclass(frozen=True)
class Question:
    """A marker whose points may be another's, or an extra's, and the log odds of the names that they have.

    `answered` are those that the surest of their names has once it is known.
    """

    one: int
    other: int
    odds: float
    answered: float = np.inf


def named_by_layout(
    likelihood: Likelihood, placed: np.ndarray, held: np.ndarray
) -> tuple[np.ndarray, tuple[Question, ...]]:
    """The name (M + E,) that each marker of a crowd should have, and what is hardly sure.

    placed (F, M + E, 3) m in frames that show most, NaN where there is none: the set's M markers as they are named so
    far, and E extras, of which each may be what a marker's name belongs to. The markers `held` keep their names; those
    that nothing has are tried too.
    """
    name, known = np.arange(placed.shape[1]), likelihood.known
    now = settled_frames(likelihood, placed)
    if now is None:
        return name, ()
    present = now.present
    questions: tuple[Question, ...] = ()
    for _ in range(LAYOUT_ROUNDS):
        place = np.argsort(name)
        tried = _without_held(_exchanges(known, now, name), held)
        others, middle, usual = _gains(known, now, place, tried)
        questions = _questions(tried, usual, len(likelihood))
        if middle.max(initial=0) <= MIN_GAIN:
            tried = _without_held(block_exchanges(known, now, place), held)
            others, middle, usual = _gains(known, now, place, tried)
            questions += _questions(tried, usual, len(likelihood))
            if middle.max(initial=0) <= MIN_GAIN:
                break
        best = int(middle.argmax())
        name = np.argsort(place[tried[best]])
        now = settle(known.fine, known.constraints, now.points, present, others[:, best])
    return name, questions


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
    each = _scores(known, now, others) - now.score[:, None]
    middle = np.median(each, axis=0)
    return others, middle, np.maximum(middle, clipped(each, 2))


def _questions(tried: np.ndarray, gain: np.ndarray, markers: int) -> tuple[Question, ...]:
    """Of exchanges (X, M + E) that are hardly worse: each marker, and the marker whose point it would take."""
    found: dict[tuple[int, int], float] = {}
    for row, value in zip(tried.tolist(), gain.tolist(), strict=True):
        if value > -OBJECTIVE.max_marker:
            for pair in [(one, other) for one, other in enumerate(row[:markers]) if one != other and other < markers]:
                found[pair] = min(-value, found.get(pair, np.inf))
    return tuple(Question(*pair, odds) for pair, odds in found.items())


def _exchanges(known: Known, now: Settled, name: np.ndarray) -> np.ndarray:
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
    both = there | there[:, None]
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
    for first in range(0, others.shape[1], PAIRING.block):
        some = others[:, first : first + PAIRING.block]
        points, worth = (np.repeat(part, some.shape[1], axis=0) for part in (now.points, now.worth))
        score = score_of(known.fine, known.constraints, points, worth, some.reshape(-1, some.shape[2]))
        found[:, first : first + PAIRING.block] = score.reshape(some.shape[:2])
    return found
