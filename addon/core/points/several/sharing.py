# SPDX-License-Identifier: GPL-3.0-or-later
"""What may be on several bodies is one's alone: whoever is surer of a tracklet keeps it."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...data.lanes import blocks
from ...data.takes import NO_MARKER, Labels
from ..whole_take.likeness import likeness
from ..whole_take.pairs import in_take, trained_pairs, widened
from ..whole_take.solving import ROUNDS, Solution
from ..whole_take.tracklets import Tracklets, seen_in, tracklets_of
from .bodies import Crowd, NamedBody
from .identification import IDENTIFICATION
from .places import NO_BODY


@dataclass(frozen=True)
class SharingOptions:
    """How tracklets are shared out.

    fitting  measured: log odds, at best, that a tracklet is a marker which the body lacks at the time, for it to be
             offered: what comes before and after may be stronger evidence; to offer all names two who touch alike, in
             twice the time
    """

    fitting: float = -4.0


SHARING = SharingOptions()
ROUNDS_OF_SHARING = 3  # of solving those again that lost some; by time


def share(crowd: Crowd, people: Sequence[NamedBody], may: np.ndarray) -> Generator[float, None, np.ndarray]:
    """Solves those again, in place, who may have tracklets (N, K) that nobody named, or lose some to another.

    Gives the tracklets (N, K) that each may have in the end.
    """
    wider = _offered(crowd, people, may)
    for _ in range(ROUNDS_OF_SHARING):
        for index in np.flatnonzero((wider != may).any(axis=0)).tolist():
            yield from crowd.solve_again(people[index], wider[:, index])
        may, certainty = wider, np.zeros(wider.shape)
        for index, one in enumerate(people):
            if one.solution is not None:
                certainty[:, index] = certainty_of(one.solution, crowd.tracklet, len(crowd))
        wider = shared_out(may, certainty)
        if (wider == may).all():
            break
    return may


def _offered(crowd: Crowd, people: Sequence[NamedBody], may: np.ndarray) -> np.ndarray:
    """(N, K) what tracklets may be on, and further bodies that have some affinity to what nobody named."""
    named = np.array([crowd.named_points(one) for one in people])
    left = crowd.firm & (2 * named.sum(axis=0) < crowd.size)
    body = np.where(named.any(axis=0), named.argmax(axis=0), NO_BODY)
    new = left[:, None] & ~may & (crowd.affinity.on(body, len(people)) > 0)
    for index, one in enumerate(people):
        new[:, index] &= _could_be(crowd, one, new[:, index])
    return may | new


def _could_be(crowd: Crowd, one: NamedBody, some: np.ndarray) -> np.ndarray:
    """(N,) whether some of the tracklets (N,) could be one of the body's markers, by how far they are from the others.

    Most ghosts could not; so who is solved already need not be solved again for them.
    """
    if one.solution is None or not some.any():
        return some
    solution, size = one.solution, len(one.model.markerset)
    placed: Any = solution.tracklets.placed(crowd.take.xyz, solution.marker, size)
    freedom = ROUNDS.freedoms[-1]
    wide = widened(trained_pairs(one.model), freedom.bend, freedom.motion_m, freedom.layout_m)
    own = crowd.tracklets_of(some)
    unnamed = Labels.none(*own.shape)
    tracklets = tracklets_of(crowd.take.xyz, own, unnamed, size)
    nobody = np.full(len(tracklets), NO_MARKER)
    odds = likeness(tracklets, placed, nobody, in_take(wide, placed), crowd.take.rate)
    free = _free(tracklets, seen_in(placed))
    found = np.zeros(len(some), bool)
    found[np.unique(own[own >= 0])] = np.where(free, odds, -np.inf).max(axis=1) >= SHARING.fitting
    return found


def _free(tracklets: Tracklets, seen: np.ndarray) -> np.ndarray:
    """(N, M) which markers are missing in some of the frames that are looked at of each tracklet, seen (T, M)."""
    there = tracklets.frame >= 0
    return (~seen[np.maximum(tracklets.frame, 0)] & there[..., None]).any(axis=1)


def certainty_of(solution: Solution, tracklet: np.ndarray, every: int) -> np.ndarray:
    """(N,) how sure a solution is of a name of each of `every` tracklets (T, L), log odds; 0 where it has none."""
    total, count = np.zeros((2, every))
    margin = np.where(solution.marker != NO_MARKER, np.maximum(solution.margin, 0), 0.0)
    for part in blocks(*tracklet.shape):
        row, lane = np.nonzero(tracklet[part] >= 0)
        number = tracklet[part][row, lane]
        own = solution.tracklets.table[part][row, lane]
        total += np.bincount(number, np.append(margin, 0.0)[own], every)
        count += np.bincount(number, minlength=every)
    return total / np.maximum(count, 1)


def shared_out(may: np.ndarray, certainty: np.ndarray) -> np.ndarray:
    """(N, K) the bodies that tracklets may be on, `may` (N, K) before, by who is surer of them.

    certainty (N, K) is how sure each is of its name of each, 0 for none. Of two that named one the surer has it; where
    neither is surer, nobody. Nothing changes for what only one named.
    """
    if may.shape[1] == 1:
        return may
    certainty = np.where(may, certainty, 0.0)
    order = np.sort(certainty, axis=1)
    wanted = (certainty > 0).sum(axis=1) > 1
    clear = wanted & (order[:, -1] - order[:, -2] >= IDENTIFICATION.lead)
    winner = certainty.argmax(axis=1)[:, None] == np.arange(may.shape[1])
    return np.where(wanted[:, None], clear[:, None] & winner, may)
