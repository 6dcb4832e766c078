# SPDX-License-Identifier: GPL-3.0-or-later
"""Every naming that differs from a given one in one place, with its exact gain: what to try next, and what to doubt.

For Gaussians all gains follow from the settled naming in closed form. With V the shared covariance, e what is left at
a marker and n its noise, D = n - V:
  drop      a named point becomes a ghost: minus its odds given the rest
  replace   a ghost takes a named point's marker: the difference of their odds given the rest
  move      a named point takes another marker's name, whose own point, if any, becomes a ghost: that marker is
            predicted without either, from V + V D⁻¹ V and expected - V D⁻¹ e
  swap      two points exchange names: -½ uᵀDu - uᵀe over both markers, u being how far each is moved, over n
"""

from dataclasses import dataclass

import numpy as np

from ...geometry.rigid import pairwise_distances
from ...kernels import point_calls, stands_for
from .distances import DistanceConstraints, pulls
from .latent import Latent
from .naming import IMPOSSIBLE, NO_POINT, Settled, density_odds, inverse3, odds_given, picked, shared_of


@dataclass(frozen=True)
class AlternativeOptions:
    """Which neighbouring namings are tried.

    max_distance_radii  of a point from where a marker is expected, to be tried there; physical: 65 cm, an arm's reach
    """

    max_distance_radii: float = 0.8


ALTERNATIVES = AlternativeOptions()


@dataclass(frozen=True, eq=False)
class Alternatives:
    """Gains in log likelihood of N namings' neighbours; IMPOSSIBLE where there is none.

    odds  (N, M, P) as `name_odds`: drop and replace follow from it
    move  (N, M, M) the point of the first marker takes the second's name
    swap  (N, M, M) the two markers exchange points; its lower triangle
    """

    odds: np.ndarray
    move: np.ndarray
    swap: np.ndarray


def alternatives(model: Latent, constraints: DistanceConstraints, settled: Settled) -> Alternatives:
    """All neighbours of settled namings."""
    reach = ALTERNATIVES.max_distance_radii * model.radius
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
