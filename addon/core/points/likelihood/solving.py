# SPDX-License-Identifier: GPL-3.0-or-later
"""From a frame's guesses to its best naming, and how far ahead of every other naming each of its names is."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from .distances import DistanceConstraints
from .latent import FIRST_MODE, Latent
from .naming import (
    IMPOSSIBLE,
    NO_POINT,
    Settled,
    name_odds,
    names_of_points,
    one_to_one,
    put_rows,
    rows_of,
    score_of,
    settle,
)
from .starts import Guesses
from .swaps import Alternatives, alternatives, best_neighbour, own_odds


@dataclass(frozen=True)
class SolvingOptions:
    """How far guesses are followed, by log likelihood.

    max_behind_guess     a frame's best, from which a guess is followed no further; measured: half or twice names people
                         of other labs, and crowds, alike
    max_behind_named     the same once it has been named again; measured: half loses 1 to 2 % there, twice nothing
    max_behind_exchange  the same for a frame's best with a limb exchanged; measured: half or twice names them alike
    """

    max_behind_guess: float = 60.0
    max_behind_named: float = 25.0
    max_behind_exchange: float = 12.0


SOLVING = SolvingOptions()
MIN_GAIN = 0.05  # log likelihood that is worth another round
RENAMING_ROUNDS = 2  # of naming again by everyone's conditional odds
MAX_CLIMBS = 6  # moves and swaps that may follow each other


@dataclass(frozen=True, eq=False)
class Solved:
    """The best naming of each of F frames.

    naming       (F, M) index of the point, NO_POINT where hidden
    score        (F,) its log likelihood ratio against nothing but ghosts
    margin       (F, M) how much likelier the name is than all namings tried without it together, log odds; 0 where
                 hidden
    mean_square  (F,) of the named points' distances from where the others expect them, in variances a degree of
                 freedom: about 1 for a subject like those of the training
    """

    naming: np.ndarray
    score: np.ndarray
    margin: np.ndarray
    mean_square: np.ndarray

    @classmethod
    def none(cls, frames: int, markers: int) -> Self:
        """So many frames of which nothing is known yet."""
        return cls(
            np.full((frames, markers), NO_POINT), np.zeros(frames), np.zeros((frames, markers)), np.zeros(frames)
        )


@dataclass(frozen=True, eq=False)
class Others:
    """A namings of each of F frames that were tried beside the best: naming (F, A, M) and score (F, A)."""

    naming: np.ndarray
    score: np.ndarray

    def against(self, winner: Settled) -> np.ndarray:
        """(F, M) log of their summed likelihood against the winner's own, of those without each of its names."""
        behind = (self.score - winner.score[:, None])[..., None]
        return log_sum(np.where(self.naming == winner.naming[:, None], -np.inf, behind), axis=1)


def solve(
    model: Latent, constraints: DistanceConstraints, exchanges: np.ndarray, guesses: Guesses, present: np.ndarray
) -> Solved:
    """The best naming of every frame that any of its guesses leads to, limbs exchanged (X, M) included."""
    frames, each, _, count = guesses.share.shape
    points = guesses.points.reshape(-1, count, 3)
    share = guesses.share.reshape(len(points), -1, count)
    naming = np.where(2 * share.max(axis=2) > 1, share.argmax(axis=2), NO_POINT)
    there = np.repeat(present, each, axis=0)
    settled = settle(model, constraints, points, there, naming)
    hopeful = _hopeful(settled, frames, SOLVING.max_behind_guess)
    put_rows(settled, _reassigned(model, constraints, rows_of(settled, hopeful)), hopeful)
    hopeful = _hopeful(settled, frames, SOLVING.max_behind_named)
    better, found = _climbed(model, constraints, rows_of(settled, hopeful))
    put_rows(settled, better, hopeful)
    score = settled.score.reshape(frames, each)
    followed = np.full(len(points), -np.inf)
    followed[hopeful] = better.score
    best = np.arange(frames) * each + followed.reshape(frames, each).argmax(axis=1)
    winner, near = rows_of(settled, best), rows_of(found, np.searchsorted(hopeful, best))
    tried = [Others(settled.naming.reshape(frames, each, -1), score)]
    tried += _exchanged(model, constraints, exchanges, winner, near)
    against = _against(winner, near)
    for others in tried:
        against = np.logaddexp(against, others.against(winner))
    margin = np.where(winner.named, -against, 0)
    return Solved(winner.naming, winner.score, margin, _mean_square(model, winner))


def _exchanged(
    model: Latent, constraints: DistanceConstraints, exchanges: np.ndarray, winner: Settled, near: Alternatives
) -> list[Others]:
    """All exchanges of limbs tried on the frames' best; where one leads to a better naming, that wins, in place."""
    if not len(exchanges):
        return []
    frames = len(winner.naming)
    naming = winner.naming[:, exchanges]
    points = np.repeat(winner.points, len(exchanges), axis=0)
    worth = np.repeat(winner.worth, len(exchanges))
    score = score_of(model, constraints, points, worth, naming.reshape(-1, len(model))).reshape(frames, -1)
    score[((naming != winner.naming[:, None]) & (naming >= 0)).sum(axis=2) == 0] = -np.inf
    best = score.argmax(axis=1)
    rows = np.flatnonzero(score[np.arange(frames), best] > winner.score - SOLVING.max_behind_exchange)
    before = Others(winner.naming[:, None].copy(), winner.score[:, None].copy())
    after = Others(before.naming.copy(), before.score.copy())
    if len(rows):
        start = settle(model, constraints, winner.points[rows], winner.present[rows], naming[rows, best[rows]])
        ended, found = _climbed(model, constraints, _reassigned(model, constraints, start))
        after.naming[rows, 0], after.score[rows, 0] = ended.naming, ended.score
        better = ended.score > winner.score[rows] + MIN_GAIN
        put_rows(winner, rows_of(ended, better), rows[better])
        put_rows(near, rows_of(found, better), rows[better])
    return [Others(naming, score), before, after]


def _reassigned(model: Latent, constraints: DistanceConstraints, settled: Settled) -> Settled:
    """Each naming changed for the better by everyone's conditional odds at once."""
    rows = np.arange(len(settled.naming))
    for _ in range(RENAMING_ROUNDS):
        tried = one_to_one(name_odds(model, constraints, _some_of(settled, rows)))
        rows = _try(model, constraints, settled, rows, tried)
        if not len(rows):
            break
    return settled


def _some_of(settled: Settled, rows: np.ndarray) -> Settled:
    """These rows (K,), each once and in their order, to look at: not copied where they are all of them."""
    return settled if len(rows) == len(settled.naming) else rows_of(settled, rows)


def _hopeful(settled: Settled, frames: int, behind: float) -> np.ndarray:
    """The rows that may yet become their frame's best: not further behind it than that, and none twice."""
    score = settled.score.reshape(frames, -1)
    naming = settled.naming.reshape(frames, score.shape[1], -1)
    hopeful = score > score.max(axis=1, keepdims=True) - behind
    for guess in range(1, score.shape[1]):
        same = (naming[:, :guess] == naming[:, guess : guess + 1]).all(axis=2) & hopeful[:, :guess]
        hopeful[:, guess] &= ~same.any(axis=1)
    return np.flatnonzero(hopeful)


def _climbed(model: Latent, constraints: DistanceConstraints, settled: Settled) -> tuple[Settled, Alternatives]:
    """Each naming changed for the better by single moves and swaps until none is one, and its neighbours then."""
    found = alternatives(model, constraints, settled)
    rows = np.arange(len(settled.naming))
    for _ in range(MAX_CLIMBS):
        tried, gain = best_neighbour(settled.naming[rows], found.move[rows], found.swap[rows])
        promising = gain > MIN_GAIN
        rows = _try(model, constraints, settled, rows[promising], tried[promising])
        if not len(rows):
            break
        _try(model, constraints, settled, rows, one_to_one(name_odds(model, constraints, _some_of(settled, rows))))
        put_rows(found, alternatives(model, constraints, _some_of(settled, rows)), rows)
    return settled, found


def _try(
    model: Latent, constraints: DistanceConstraints, settled: Settled, rows: np.ndarray, naming: np.ndarray
) -> np.ndarray:
    """Takes over the namings (N, M) for these rows where they are better, in place; which rows those are."""
    changed = (naming != settled.naming[rows]).any(axis=1)
    rows = rows[changed]
    if not len(rows):
        return rows
    tried = settle(
        model, constraints, settled.points[rows], settled.present[rows], naming[changed], settled.worth[rows]
    )
    better = np.flatnonzero(tried.score > settled.score[rows] + MIN_GAIN)
    rows = rows[better]
    if len(rows):
        put_rows(settled, _some_of(tried, better), rows)
    return rows


def _against(settled: Settled, found: Alternatives) -> np.ndarray:
    """(N, M) log of the summed likelihood, against the naming's own, of its neighbours without each marker's name."""
    own = own_odds(settled, found.odds)
    free = settled.present & (names_of_points(settled.naming, settled.present.shape[1]) < 0)
    ghost = np.where(free[:, None], found.odds, IMPOSSIBLE)
    others = np.logaddexp(0, log_sum(ghost, axis=2)) - own
    swap = np.maximum(found.swap, found.swap.swapaxes(1, 2))
    changed = np.concatenate([others[..., None], found.move, swap], axis=2)
    return log_sum(changed, axis=2)


def _mean_square(model: Latent, settled: Settled) -> np.ndarray:
    """(N,) as `Solved` has it."""
    square = (settled.left**2 / model.noise[:, None]).sum(axis=(1, 2))
    return square / np.maximum(3 * settled.named.sum(axis=1) - FIRST_MODE, 1)


def log_sum(logs: np.ndarray, axis: int) -> np.ndarray:
    """The logarithm of the sum of exponentials along an axis; several times faster than NumPy's pairwise one."""
    top = np.maximum(logs.max(axis=axis, keepdims=True), IMPOSSIBLE)
    return np.log(np.maximum(np.exp(logs - top).sum(axis=axis), 1e-300)) + np.squeeze(top, axis)
