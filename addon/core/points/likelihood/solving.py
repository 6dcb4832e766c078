# SPDX-License-Identifier: GPL-3.0-or-later
"""From a frame's guesses to its best naming, and how far ahead of every other naming each of its names is.

Every naming that differs from a given one in one place has an exact gain: it says what to try next, and what to doubt.
For Gaussians all gains follow from the settled naming in closed form. With V the shared covariance, e what is left at
a marker and n its noise, D = n - V:
  drop      a named point becomes a ghost: minus its odds given the rest
  replace   a ghost takes a named point's marker: the difference of their odds given the rest
  move      a named point takes another marker's name, whose own point, if any, becomes a ghost: that marker is
            predicted without either, from V + V D⁻¹ V and expected - V D⁻¹ e
  swap      two points exchange names: -½ uᵀDu - uᵀe over both markers, u being how far each is moved, over n
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from ...geometry.rigid import pairwise_distances
from ...kernels import point_calls, stands_for
from .distances import DistanceConstraints, pulls
from .naming import (
    IMPOSSIBLE,
    NO_POINT,
    Settled,
    density_odds,
    inverse3,
    name_odds,
    names_of_points,
    odds_given,
    one_to_one,
    picked,
    put_rows,
    rows_of,
    score_of,
    settle,
    shared_of,
)
from .shape import FIRST_MODE, Latent
from .starts import Guesses


class SOLVING:
    """How far guesses are followed, by log likelihood, and which neighbouring namings are tried."""

    # a frame's best, from which a guess is followed no further; half or twice names people of other labs, and crowds,
    # alike, with 25 head, trunk and arms alone are refused once
    max_behind_guess: float = 60.0  # measured
    # the same once it has been named again
    max_behind_named: float = 25.0  # measured: half loses 1 to 2 % there, twice nothing
    # the same for a frame's best with a limb exchanged; with twice 4 % of a squat's names and 6 % of a dance's are
    # wrong, with none 814 of 4,050 of pelvis and one leg
    max_behind_exchange: float = 12.0  # measured
    # of a point from where a marker is expected, to be tried there
    max_distance_radii: float = 0.8  # physical: 65 cm, an arm's reach


MIN_GAIN = 0.05  # log likelihood that is worth another round
RENAMING_ROUNDS = 2  # of naming again by everyone's conditional odds
MAX_CLIMBS = 6  # moves and swaps that may follow each other


@dataclass(frozen=True, eq=False)
class Alternatives:
    """Gains in log likelihood of N namings' neighbours; IMPOSSIBLE where there is none."""

    odds: np.ndarray  # (N, M, P) as `name_odds`: drop and replace follow from it
    move: np.ndarray  # (N, M, M) the point of the first marker takes the second's name
    swap: np.ndarray  # (N, M, M) the two markers exchange points; its lower triangle


def alternatives(model: Latent, constraints: DistanceConstraints, settled: Settled) -> Alternatives:
    """All neighbours of settled namings."""
    reach = SOLVING.max_distance_radii * model.radius
    return Alternatives(*neighbours(model, constraints, settled, reach))


@stands_for(point_calls.neighbours)
def neighbours(
    model: Latent, constraints: DistanceConstraints, settled: Settled, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Odds, moves and swaps of `Alternatives`; points up to `reach` m from where a marker is expected are tried."""
    pulled = pulls(constraints, settled.points, settled.naming, settled.size)
    odds = odds_given(model, settled, pulled)
    parts = model, constraints, settled, pulled
    return odds, _moves(*parts, odds, reach), _swaps(*parts)


def own_odds(settled: Settled, odds: np.ndarray) -> np.ndarray:
    """(N, M) the odds of each marker's own point; 0 where hidden."""
    own = np.take_along_axis(odds, np.maximum(settled.naming, 0)[..., None], axis=2)[..., 0]
    return np.where(settled.named, own, 0)


def _moves(model: Latent, constraints: DistanceConstraints, settled: Settled, pulled, odds, reach) -> np.ndarray:
    at = picked(settled.points, settled.naming)
    gains = np.full((*settled.naming.shape, len(model)), IMPOSSIBLE)
    far = ((at[:, :, None] - settled.expected[:, None]) ** 2).sum(axis=-1) > reach**2
    row, old, new = np.nonzero(settled.named[:, :, None] & ~far & ~np.eye(len(model), dtype=bool))
    if not len(row):
        return gains
    noise = model.noise[:, None, None] * np.eye(3)
    first, second = settled.spread[row, old], settled.spread[row, new]
    own, _ = inverse3(noise[old] - shared_of(first, first))
    across = shared_of(second, first)
    carried = across @ own
    shared = shared_of(second, second) + carried @ across.swapaxes(-1, -2)
    expected = settled.expected[row, new] - (carried @ settled.left[row, old][..., None])[..., 0]
    held = settled.named[row, new]
    own, _ = inverse3(noise[new] - np.where(held[:, None, None], shared, 0))
    variance = np.where(held[:, None, None], noise[new] ** 2 @ own, shared + noise[new])
    left = np.where(held[:, None], at[row, new] - expected, 0)
    expected = expected - ((shared @ own) @ left[..., None])[..., 0]
    there = np.stack([at[row, old], at[row, new]], axis=1) - expected[:, None]
    odd = density_odds(settled.worth[row, None], variance, there, True)
    odd += _without_constraint(constraints, settled, pulled, row, old, new)
    gain = odd[:, 0] - np.where(held, odd[:, 1], 0)
    gains[row, old, new] = gain - own_odds(settled, odds)[row, old]
    return gains


def _without_constraint(constraints: DistanceConstraints, settled: Settled, pulled, row, old, new) -> np.ndarray:
    """(K, 2) what the distance constraints of marker `new` but that with `old` say of the points that the two have."""
    points = np.maximum(np.stack([settled.naming[row, old], settled.naming[row, new]], axis=1), 0)
    whole = pulled[row[:, None], new[:, None], points]
    if not len(constraints):
        return whole
    constraint = constraints.joined(settled.naming.shape[1])[old, new]
    at = settled.points[row[:, None], points]
    between = np.linalg.norm(at - at[:, :1], axis=-1) / settled.size[row, None]
    return whole - np.where((constraint >= 0)[:, None], constraints.fit(between, constraint[:, None]), 0)


def _swaps(model: Latent, constraints: DistanceConstraints, settled: Settled, pulled: np.ndarray) -> np.ndarray:
    at = picked(settled.points, settled.naming)
    between = at[:, None] - at[:, :, None]
    noise, (count, markers, _, size) = model.noise, settled.spread.shape
    flat = (settled.spread / noise[:, None, None]).reshape(count, -1, size)
    cross = shared_of(flat, flat).reshape(count, markers, 3, markers, 3).transpose(0, 1, 3, 2, 4)
    own = np.eye(3) / noise[:, None, None] - np.einsum("niijk->nijk", cross)
    curve = own[:, :, None] + own[:, None] + cross + cross.swapaxes(-1, -2)
    slope = settled.left / noise[:, None]
    slope = slope[:, :, None] - slope[:, None]
    gains = -0.5 * ((curve @ between[..., None])[..., 0] * between).sum(axis=-1) - (slope * between).sum(axis=-1)
    both = settled.named[:, :, None] & settled.named[:, None] & np.tri(markers, k=-1, dtype=bool)
    return np.where(both, gains + _swapped_constraints(constraints, settled, pulled), IMPOSSIBLE)


def _swapped_constraints(constraints: DistanceConstraints, settled: Settled, pulled: np.ndarray) -> np.ndarray:
    """(N, M, M) what the constraints gain when two markers exchange points; the one between the two stays as it is."""
    rows = np.arange(len(settled.naming))[:, None, None]
    point = np.maximum(settled.naming, 0)
    crossed = pulled[rows, np.arange(point.shape[1])[:, None], point[:, None]]
    own = np.einsum("nii->ni", crossed)
    gain = crossed + crossed.swapaxes(1, 2) - own[:, :, None] - own[:, None]
    if not len(constraints):
        return gain
    constraint = constraints.joined(point.shape[1])
    at = picked(settled.points, settled.naming)
    kept = constraints.fit(pairwise_distances(at) / settled.size[:, None, None], constraint)
    return gain + np.where(constraint >= 0, 2 * (kept - constraints.fit(np.zeros(1), constraint)), 0)


def best_neighbour(naming: np.ndarray, move: np.ndarray, swap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The namings (N, M) with the best single move or swap made, and its gain (N,); `move` and `swap` (N, M, M)."""
    rows, count = np.arange(len(naming)), naming.shape[1]
    gains = np.concatenate([move.reshape(len(rows), -1), swap.reshape(len(rows), -1)], axis=1)
    best = gains.argmax(axis=1)
    gain = gains[rows, best]
    swapped, pair = best >= count**2, best % count**2
    first, second = pair // count, pair % count
    changed = naming.copy()
    changed[rows, second] = naming[rows, first]
    changed[rows, first] = np.where(swapped, naming[rows, second], NO_POINT)
    return changed, gain


@dataclass(frozen=True, eq=False)
class Solved:
    """The best naming of each of F frames."""

    naming: np.ndarray  # (F, M) index of the point, NO_POINT where hidden
    score: np.ndarray  # (F,) its log likelihood ratio against nothing but ghosts
    # (F, M) how much likelier the name is than all namings tried without it together, log odds; 0 where hidden
    margin: np.ndarray
    # (F,) of the named points' distances from where the others expect them, in variances a degree of freedom: about 1
    # for a subject like those of the training
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
    square = (winner.left**2 / model.noise[:, None]).sum(axis=(1, 2))
    mean_square = square / np.maximum(3 * winner.named.sum(axis=1) - FIRST_MODE, 1)
    return Solved(winner.naming, winner.score, margin, mean_square)


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


def log_sum(logs: np.ndarray, axis: int) -> np.ndarray:
    """The logarithm of the sum of exponentials along an axis; several times faster than NumPy's pairwise one."""
    top = np.maximum(logs.max(axis=axis, keepdims=True), IMPOSSIBLE)
    return np.log(np.maximum(np.exp(logs - top).sum(axis=axis), 1e-300)) + np.squeeze(top, axis)
