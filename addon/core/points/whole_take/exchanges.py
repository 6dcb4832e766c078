# SPDX-License-Identifier: GPL-3.0-or-later
"""Two markers that have each other's names for a part of the take: found over time, and undone.

While names are exchanged, by how much the first marker is farther than the second from each of their neighbours is so
with the other sign. What the take does most of the time is right for the most part, frames and training say which.
"""

from dataclasses import dataclass

import numpy as np

from ...data.takes import evenly_spread
from ..tracklets import VOTE
from .likeness import worth_of_each
from .pairs import PAIRING, PairDistances
from .tracklets import Tracklets


@dataclass(frozen=True)
class UndoOptions:
    """How exchanges are looked for. All reckoned.

    frames           of a take that are looked at
    neighbours       of the two that are asked
    sd_m             that a difference of distances has at least
    rounds           of asking which is which, and learning it anew
    min_odds         log odds of an exchange that is undone
    max_odds         that one frame can say
    independent_s    that frames must lie between two to count as two
    """

    frames: int = 600
    neighbours: int = 10
    sd_m: float = 0.004
    rounds: int = 10
    min_odds: float = 6.0
    max_odds: float = 8.0
    independent_s: float = 0.25


UNDO = UndoOptions()


def undone(
    tracklets: Tracklets,
    placed: np.ndarray,
    marker: np.ndarray,
    trained: PairDistances,
    pairs: PairDistances,
    rate: float,
) -> np.ndarray:
    """(N,) the markers of the tracklets, those that were exchanged for a while put right.

    placed (T, M, 3) m is where the markers are by the names (N,) so far.
    """
    marker = marker.copy()
    frames = evenly_spread(len(placed), UNDO.frames)
    some = np.ascontiguousarray(placed[frames].swapaxes(0, 1), float)
    near = pairs.mean < PAIRING.max_confused_m
    touched: set[int] = set()
    mine = [np.flatnonzero(marker == one) for one in range(len(near))]
    spans = [list(zip(tracklets.first[own].tolist(), tracklets.last[own].tolist(), strict=True)) for own in mine]
    for one, other in np.argwhere(np.triu(near, 1)).tolist():
        if not {one, other} & touched and _fall_apart(spans[one] + spans[other]):
            own = np.sort(np.concatenate([mine[one], mine[other]]))
            turned = _turned(tracklets, own, marker, some, frames, (one, other), trained, pairs, rate)
            if len(turned):
                touched |= {one, other}
                marker[turned] = one + other - marker[turned]
    return marker


def _turned(tracklets, own, marker, some, frames, names, trained, pairs, rate) -> np.ndarray:
    """The tracklets, of those that have either of two names, that should have the other."""
    one, other = names
    own = own[np.argsort(tracklets.first[own])]
    part = _parts(tracklets.first[own], tracklets.last[own])
    none = np.zeros(0, int)
    begin = tracklets.first[own][np.flatnonzero(np.diff(part, prepend=-1))]
    where = np.searchsorted(begin, frames, side="right") - 1
    near, differs = _differences(some, one, other, pairs)
    known = np.isfinite(differs)
    seen = known.any(axis=0) & (where >= 0)
    differs, known, where = differs[:, seen], known[:, seen], where[seen]
    if len(where) < 2:
        return none
    differs = np.where(known, differs, 0)
    spacing = (frames[1] - frames[0]) / rate
    sign, said, middle = _signs(differs, known, where, part[-1] + 1, min(1.0, spacing / UNDO.independent_s))
    # Which of the two is which: frames on their own, and what training knows of the two markers' distances.
    turns = np.bincount(part, weights=_votes(tracklets, own, marker, names), minlength=len(sign)) * sign
    expected = trained.mean[one, near] - trained.mean[other, near]
    unsure = trained.unsure[one, near] + trained.unsure[other, near] + UNDO.sd_m**2
    for_it = np.nansum(2 * middle * expected / unsure) * worth_of_each(len(near))
    if turns.sum() + for_it < 0:
        sign = -sign
    turn = (sign < 0) & (np.abs(said) > UNDO.min_odds)
    return own[turn[part]]


def _differences(some: np.ndarray, one: int, other: int, pairs: PairDistances) -> tuple[np.ndarray, np.ndarray]:
    """The steadiest neighbours (Q,) of two markers, and by how much they are farther from the one (Q, F), m."""
    within = pairs.within[one] + pairs.within[other]
    within[[one, other]] = np.inf
    near = np.argsort(within)[: UNDO.neighbours]
    near = near[np.isfinite(within[near])]
    differs = _distance(some, one, near) - _distance(some, other, near)
    ever = np.isfinite(differs).any(axis=1)
    return near[ever], differs[ever]


def _signs(differs, known, where, parts: int, worth: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The likeliest signs (parts,) of any start, the log odds for them (parts,), and what differs with them (Q,) m."""
    share = worth_of_each(known.sum(axis=0))
    ends = [_settled(differs, known, where, start, share, worth) for start in _starts(differs, where, parts)]
    return max(ends, key=lambda end: np.abs(end[1]).sum())


def _votes(tracklets: Tracklets, own: np.ndarray, marker: np.ndarray, names) -> np.ndarray:
    """(K,) how much more frames say for the name of each tracklet than for the other of the two."""
    one, other = names
    mine = tracklets.votes[own, marker[own]]
    return mine - tracklets.votes[own, one + other - marker[own]]


def _fall_apart(spans: list[tuple[int, int]]) -> bool:
    """Whether spans of frames have more parts than one, as `_parts` has them; most pairs of markers have not."""
    end = None
    for first, last in sorted(spans):
        if end is not None and first > end - VOTE.max_overlap_frames:
            return True
        end = last if end is None else max(end, last)
    return False


def _parts(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(K,) tracklets, sorted by their first frame, that hang together in time: number of the part of each."""
    end = np.maximum.accumulate(last)
    new = first[1:] > end[:-1] - VOTE.max_overlap_frames
    return np.concatenate([[0], np.cumsum(new)])


def _starts(differs: np.ndarray, where: np.ndarray, parts: int) -> list[np.ndarray]:
    """Signs (parts,) to start from: all as they are and, if it is another, as the main way in which parts differ."""
    count = np.maximum(np.bincount(where, minlength=parts), 1)
    mean = np.stack([np.bincount(where, weights=row, minlength=parts) for row in differs], axis=1) / count[:, None]
    mean *= np.sqrt(count)[:, None]
    # All that are positive have the same sign in the main way of a matrix of positive products.
    if (mean @ mean.T > 0).all():
        return [np.ones(parts)]
    left, _, _ = np.linalg.svd(mean, full_matrices=False)
    main = np.where(left[:, 0] < 0, -1.0, 1.0)
    main *= 1 if (main * count).sum() >= 0 else -1
    return [np.ones(parts)] if (main == 1).all() else [np.ones(parts), main]


def _settled(differs, known, where, sign, share, worth) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Signs (parts,) of the parts, the log odds for them (parts,), and what usually differs with them (Q,) m."""
    for _ in range(UNDO.rounds):
        turned = differs * sign[where]
        middle = _middle(turned, known)
        sd = np.maximum(1.5 * _middle(np.abs(turned - middle[:, None]), known), UNDO.sd_m)
        each = ((middle / sd**2) @ differs) * share
        each = np.clip(each, -UNDO.max_odds, UNDO.max_odds)
        odds = np.bincount(where, weights=each, minlength=len(sign)) * worth
        after = np.where(odds < 0, -1.0, 1.0)
        if (after == sign).all():
            return sign, odds, middle
        sign = after
    return sign, odds, _middle(differs * sign[where], known)


def _middle(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(Q,) the median of the known ones of values (Q, F), of which each row has some; NumPy's is slow with NaN."""
    order = np.sort(np.where(known, values, np.inf), axis=1)
    return order[np.arange(len(order)), (known.sum(axis=1) - 1) // 2]


def _distance(points: np.ndarray, one: int, others: np.ndarray) -> np.ndarray:
    """(Q, F) m from a marker to others in frames of markers (M, F, 3) m."""
    away = points[others] - points[one]
    return np.sqrt(np.einsum("qfi,qfi->qf", away, away))
