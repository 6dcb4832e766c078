# SPDX-License-Identifier: GPL-3.0-or-later
"""From a frame's guesses to its best naming, and how far ahead of every other naming each of its names is."""

from dataclasses import dataclass

import numpy as np

from .latent import FIRST_MODE, Latent
from .naming import IMPOSSIBLE, NO_POINT, Settled, names_of_points, one_to_one, settle
from .rivals import Rivals, best_neighbour, own_odds, rivals
from .starts import Guesses
from .ties import Pulls, Ties

SURE = 0.5  # share of a point from which a guess names it
ROUNDS = 2  # of naming anew by everyone's conditional odds
CLIMBS = 6  # moves and swaps that may follow each other
ENOUGH = 0.05  # gain in log likelihood worth another round


@dataclass(frozen=True, eq=False)
class Solved:
    """The best naming of each of F frames.

    naming   (F, M) index of the point, NO_POINT where hidden
    score    (F,) its log likelihood ratio against nothing but ghosts
    margin   (F, M) how much likelier the name is than all namings tried without it together, log odds; 0 where hidden
    misfit   (F,) mean square of the named points' distances from where the others expect them, in variances a degree
             of freedom: about 1 for a subject like those of the training
    """

    naming: np.ndarray
    score: np.ndarray
    margin: np.ndarray
    misfit: np.ndarray


def solve(model: Latent, ties: Ties, guesses: Guesses, present: np.ndarray) -> Solved:
    """The best naming of every frame that any of its guesses leads to."""
    frames, each, _, count = guesses.share.shape
    points = guesses.points.reshape(-1, count, 3).astype(float)
    share = guesses.share.reshape(len(points), -1, count)
    naming = np.where(share.max(axis=2) > SURE, share.argmax(axis=2), NO_POINT)
    there = np.repeat(present, each, axis=0)
    settled, found = _improved(model, ties, settle(model, ties, points, there, naming))
    score = settled.score.reshape(frames, each)
    best = np.arange(frames) * each + score.argmax(axis=1)
    named = settled.naming.reshape(frames, each, -1)
    winner, chosen = _rows(settled, best), _rows(found, best)
    against = _against(winner, chosen)
    behind = np.where(named == winner.naming[:, None], -np.inf, (score - winner.score[:, None])[..., None])
    against = np.logaddexp(against, np.logaddexp.reduce(behind, axis=1))
    margin = np.where(winner.named, -against, 0)
    return Solved(winner.naming, winner.score, margin, _misfit(model, winner))


def _rows(data, rows: np.ndarray):
    """The dataclass of arrays `data` cut down to these rows."""
    return type(data)(*(_cut(getattr(data, name), rows) for name in data.__dataclass_fields__))


def _cut(part, rows: np.ndarray):
    return part.rows(rows) if isinstance(part, Pulls) else part[rows]


def _put(old, new, rows: np.ndarray):
    """The dataclass of arrays `old` with `new` in these rows, in place."""
    for name in old.__dataclass_fields__:
        part = getattr(old, name)
        if isinstance(part, Pulls):
            part.put(getattr(new, name), rows)
        else:
            part[rows] = getattr(new, name)


def _improved(model: Latent, ties: Ties, settled: Settled) -> tuple[Settled, Rivals]:
    """Each naming changed for the better until no single change is one.

    First by everyone's conditional odds at once, then by single moves and swaps.
    """
    found = rivals(model, ties, settled)
    for _ in range(ROUNDS):
        _try(model, ties, settled, found, np.arange(len(settled.naming)), one_to_one(found.odds))
    active = np.arange(len(settled.naming))
    for _ in range(CLIMBS):
        tried, gain = best_neighbour(_rows(settled, active), _rows(found, active))
        hopeful = gain > ENOUGH
        active = _try(model, ties, settled, found, active[hopeful], tried[hopeful])
        if not len(active):
            break
        _try(model, ties, settled, found, active, one_to_one(found.odds[active]))
    return settled, found


def _try(model: Latent, ties: Ties, settled: Settled, found: Rivals, rows, naming) -> np.ndarray:
    """Takes over the namings (N, M) for these rows where they are better; which rows those are."""
    changed = (naming != settled.naming[rows]).any(axis=1)
    rows = rows[changed]
    if not len(rows):
        return rows
    tried = settle(model, ties, settled.points[rows], settled.present[rows], naming[changed])
    better = tried.score > settled.score[rows] + ENOUGH
    rows, tried = rows[better], _rows(tried, better)
    _put(settled, tried, rows)
    _put(found, rivals(model, ties, tried), rows)
    return rows


def _against(settled: Settled, found: Rivals) -> np.ndarray:
    """(N, M) log of the summed likelihood, against the naming's own, of its neighbours without each marker's name."""
    own = own_odds(settled, found.odds)
    free = settled.present & (names_of_points(settled.naming, settled.present.shape[1]) < 0)
    ghost = np.where(free[:, None], found.odds, IMPOSSIBLE)
    others = np.logaddexp(0, np.logaddexp.reduce(ghost, axis=2)) - own
    swap = np.maximum(found.swap, found.swap.swapaxes(1, 2))
    changed = np.concatenate([others[..., None], found.move, swap], axis=2)
    return np.logaddexp.reduce(changed, axis=2)


def _misfit(model: Latent, settled: Settled) -> np.ndarray:
    """(N,) from the score, which holds the misfit beside what the naming itself fixes."""
    square = (settled.left**2 / model.noise[:, None]).sum(axis=(1, 2))
    return square / np.maximum(3 * settled.named.sum(axis=1) - FIRST_MODE, 1)
