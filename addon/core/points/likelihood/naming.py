# SPDX-License-Identifier: GPL-3.0-or-later
"""How well a naming explains a frame: its exact likelihood, and what each marker is expected to do given the others.

A naming's likelihood is that of all its named points at once under the shape, with place, yaw, person and pose
integrated out; every unnamed point is a ghost, of a density that the number of points in the frame tells; every unnamed
marker is hidden at a constant price.
"""

from dataclasses import dataclass, fields, is_dataclass

import numpy as np

from ...data.takes import NO_POINT
from .distances import DistanceConstraints, Pulls, pulls, total_fit
from .latent import Latent, yaw_absorbed

IMPOSSIBLE = -1e6  # log odds


@dataclass(frozen=True)
class GhostOptions:
    """What is known of a frame's ghosts and hidden markers before it is seen. All reckoned.

    density           ghosts in a cube of one radius
    max_usual         points more than markers that are nothing unusual
    crowd_cubes       such cubes that the points beyond are in, as when more of the body is marked than the set knows
    hidden_chance     that a marker is hidden
    """

    density: float = 0.01
    max_usual: int = 3
    crowd_cubes: float = 15.0
    hidden_chance: float = 0.25


GHOSTS_EXPECTED = GhostOptions()


@dataclass(frozen=True, eq=False)
class Settled:
    """N namings and what follows from them.

    points    (N, P, 3) m in the model's frame
    present   (N, P)
    worth     (N,) what a name is worth beside its density, as `name_worth`
    naming    (N, M) index of the point, NO_POINT where hidden
    score     (N,) log likelihood ratio against all points being ghosts and all markers hidden
    expected  (N, M, 3) m, each marker's mean given all named points
    shared    (N, M, 3, M, 3) m², covariance of the expected positions, without the markers' own noise
    left      (N, M, 3) m, named point minus expected; 0 where hidden
    pulls     what the distance constraints say
    """

    points: np.ndarray
    present: np.ndarray
    worth: np.ndarray
    naming: np.ndarray
    score: np.ndarray
    expected: np.ndarray
    shared: np.ndarray
    left: np.ndarray
    pulls: Pulls

    @property
    def named(self) -> np.ndarray:
        """(N, M) True where a marker has a point."""
        return self.naming >= 0


def settle(
    model: Latent, constraints: DistanceConstraints, points: np.ndarray, present: np.ndarray, naming: np.ndarray
) -> Settled:
    """What follows from namings (N, M) of points (N, P, 3) m that are nearly in the model's frame."""
    worth = name_worth(model, present)
    points, offset, latent, covariance, score = _weighed(model, points, worth, naming)
    fit = pulls(constraints, points, naming)
    expected = model.positions(latent)
    shared = ((model.flat @ covariance) @ model.flat.T).reshape(-1, len(model), 3, len(model), 3)
    left = np.where((naming >= 0)[..., None], offset + model.mean - expected, 0)
    return Settled(points, present, worth, naming, score + fit.total, expected, shared, left, fit)


def score_of(
    model: Latent, constraints: DistanceConstraints, points: np.ndarray, worth: np.ndarray, naming: np.ndarray
) -> np.ndarray:
    """(N,) the score alone, as `settle` gives it."""
    points, _, _, _, score = _weighed(model, points, worth, naming)
    return score + total_fit(constraints, points, naming)


def _weighed(model: Latent, points: np.ndarray, worth: np.ndarray, naming: np.ndarray):
    """Points with the yaw taken up, the named ones' offsets from the mean, latent vectors, their covariance, score."""
    named = naming >= 0
    normal = model.normal(named / model.noise)
    covariance = np.linalg.inv(normal)
    _, side = _pull(model, points, naming)
    points, _ = yaw_absorbed(points, (covariance @ side[..., None])[..., 0])
    offset, side = _pull(model, points, naming)
    latent = (covariance @ side[..., None])[..., 0]
    square = (offset**2 / model.noise[:, None]).sum(axis=(1, 2)) - (side * latent).sum(axis=1)
    spread = np.linalg.slogdet(normal)[1] + named @ (3 * np.log(model.noise))
    score = -0.5 * (square + spread) + named.sum(axis=1) * worth
    return points, offset, latent, covariance, score


def _pull(model: Latent, points: np.ndarray, naming: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Offsets of the named points from the mean (N, M, 3) and the right side (N, L) that they make."""
    offset = np.where((naming >= 0)[..., None], picked(points, naming) - model.mean, 0)
    return offset, model.right_side(offset / model.noise[:, None])


def picked(points: np.ndarray, naming: np.ndarray) -> np.ndarray:
    """(N, M, 3) the points named; the first point where none is."""
    return np.take_along_axis(points, np.maximum(naming, 0)[..., None], axis=1)


def name_worth(model: Latent, present: np.ndarray) -> np.ndarray:
    """(N,) what a name is worth beside its density in frames of points present (N, P): a ghost less, a marker seen."""
    ghost = np.log((GHOSTS_EXPECTED.density + crowd_density(model, present)) / model.radius**3)
    hidden = GHOSTS_EXPECTED.hidden_chance
    return np.log((1 - hidden) / hidden) - ghost - 1.5 * np.log(2 * np.pi)


def crowd_density(model: Latent, present: np.ndarray) -> np.ndarray:
    """(N,) points in a cube of one radius that frames of points present (N, P) have beyond what is usual."""
    extra = np.maximum(present.sum(axis=1) - len(model) - GHOSTS_EXPECTED.max_usual, 0)
    return extra / GHOSTS_EXPECTED.crowd_cubes


def is_crowded(model: Latent, present: np.ndarray) -> np.ndarray:
    """(N,) whether frames of points present (N, P) have many more of them than there are markers."""
    return present.sum(axis=1) > len(model) + GHOSTS_EXPECTED.max_usual


def own_blocks(shared: np.ndarray) -> np.ndarray:
    """(N, M, 3, 3) each marker's own covariance out of `shared`."""
    index = np.arange(shared.shape[1])
    return shared[:, index, :, index].swapaxes(0, 1)


def inverse3(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse and determinant of symmetric matrices (..., 3, 3); many times faster than the general routine."""
    a, b, c = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 0, 2]
    d, e, f = matrix[..., 1, 1], matrix[..., 1, 2], matrix[..., 2, 2]
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    dd, ee, ff = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * aa + b * bb + c * cc
    rows = np.stack([aa, bb, cc, bb, dd, ee, cc, ee, ff], axis=-1) / determinant[..., None]
    return rows.reshape(matrix.shape), determinant


def name_odds(model: Latent, settled: Settled) -> np.ndarray:
    """(N, M, P) log odds that a point is a marker rather than a ghost, given all named points but the marker's own."""
    named = settled.named[..., None, None]
    noise = model.noise[:, None, None]
    shared = own_blocks(settled.shared)
    # What the marker's own point says is taken out again; for Gaussians that is exact.
    own, _ = inverse3(noise * np.eye(3) - np.where(named, shared, 0))
    variance = np.where(named, noise**2 * own, shared + noise * np.eye(3))
    without = settled.expected - np.where(named, shared @ own @ settled.left[..., None], 0)[..., 0]
    between = settled.points[:, None] - without[:, :, None]
    odds = density_odds(settled.worth[:, None, None], variance, between, settled.present[:, None])
    return odds + settled.pulls.at


def density_odds(worth: np.ndarray, variance, between, present) -> np.ndarray:
    """Log odds (..., P) of points `between` (..., P, 3) m off where markers of variance (..., 3, 3) are expected."""
    precision, determinant = inverse3(variance)
    square = ((between @ precision) * between).sum(axis=-1)
    return np.where(present, worth - 0.5 * (np.log(determinant)[..., None] + square), IMPOSSIBLE)


def one_to_one(odds: np.ndarray) -> np.ndarray:
    """The naming (N, M) of highest total odds (N, M, P); nothing is named at odds below 0."""
    naming = np.where(odds.max(axis=2) > 0, odds.argmax(axis=2), NO_POINT)
    contested = ((odds > 0).sum(axis=1) > 1).any(axis=1)
    for row in np.flatnonzero(contested):
        naming[row] = _assigned(odds[row])
    return naming


def _assigned(odds: np.ndarray) -> np.ndarray:
    from scipy.optimize import linear_sum_assignment

    markers, points = np.flatnonzero((odds > 0).any(axis=1)), np.flatnonzero((odds > 0).any(axis=0))
    worth = np.maximum(odds[np.ix_(markers, points)], 0)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    good = worth[rows, columns] > 0
    naming = np.full(len(odds), NO_POINT)
    naming[markers[rows[good]]] = points[columns[good]]
    return naming


def names_of_points(naming: np.ndarray, count: int) -> np.ndarray:
    """(N, P) the marker of every point, -1 where none, of namings (N, M)."""
    names = np.full((len(naming), count + 1), -1)
    rows = np.broadcast_to(np.arange(len(naming))[:, None], naming.shape)
    names[rows, np.where(naming >= 0, naming, count)] = np.where(naming >= 0, np.arange(naming.shape[1]), -1)
    return names[:, :count]


def rows_of(data, rows: np.ndarray):
    """The same dataclass with these rows only."""
    parts = ((field, getattr(data, field.name)) for field in fields(data))
    return type(data)(*(_cut(part, rows) if field.metadata.get("rows", True) else part for field, part in parts))


def _cut(part, rows: np.ndarray):
    return rows_of(part, rows) if is_dataclass(part) else part[rows]


def put_rows(data, other, rows: np.ndarray):
    """Writes the rows of `other` over these rows of `data`, in place."""
    for field in fields(data):
        part, new = getattr(data, field.name), getattr(other, field.name)
        if is_dataclass(part):
            put_rows(part, new, rows)
        elif field.metadata.get("rows", True):
            part[rows] = new
