# SPDX-License-Identifier: GPL-3.0-or-later
"""How well a naming explains a frame: its exact likelihood, and what each marker is expected to do given the others.

A naming's likelihood is that of all its named points at once under the shape, with place, yaw, person and pose
integrated out; every unnamed point is a ghost, of a density that the number of points in the frame tells; every unnamed
marker is hidden at a constant price. Where several markers want one point, `assigned` gives the naming that is worth
most.
"""

from dataclasses import dataclass

import numpy as np

from ...data.takes import NO_POINT
from ...kernels import point_calls, stands_for
from .distances import DistanceConstraints, pulls, size_and_fit
from .shape import Latent, yaw_absorbed

ROUNDING = 1e-9  # log odds; chains in a circle bring nothing, and must not seem to

DENSE = 4  # measured: points a marker, beyond which chains take longer than SciPy: 10 s for 40 frames in a wrong unit

Worth = dict[int, dict[int, float]]  # of each marker, the log odds of each point that it may be, above 0


def assigned(odds: np.ndarray) -> np.ndarray:
    """(M,) the point of each marker, NO_POINT for none, of the highest total odds (M, P); none at odds below 0."""
    marker, point = np.nonzero(odds > 0)
    if len(marker) > DENSE * len(odds):
        return _by_scipy(odds)
    worth: Worth = {}
    for own, candidate, value in zip(marker.tolist(), point.tolist(), odds[marker, point].tolist(), strict=True):
        worth.setdefault(own, {})[candidate] = value
    holder: dict[int, int] = {}
    for own in worth:
        _let_in(own, worth, holder)
    naming = np.full(len(odds), NO_POINT)
    naming[list(holder.values())] = list(holder)
    return naming


def _by_scipy(odds: np.ndarray) -> np.ndarray:
    """The same by a solver whose time hangs on the size alone."""
    from scipy.optimize import linear_sum_assignment

    naming = np.full(len(odds), NO_POINT)
    marker, point = linear_sum_assignment(np.maximum(odds, 0.0), maximize=True)
    some = odds[marker, point] > 0
    naming[marker[some]] = point[some]
    return naming


def _let_in(newcomer: int, worth: Worth, holder: dict[int, int]):
    """Changes who holds which point, by the best chain that begins with one more marker."""
    # What has been gained where this marker has no point for now, and who took which from it.
    gained, robbed = {newcomer: 0.0}, {}
    best, last, free = 0.0, newcomer, None
    waiting = [newcomer]
    while waiting:
        one = waiting.pop()
        for point, value in worth[one].items():
            other, gain = holder.get(point), gained[one] + value
            if other is None:
                if gain > best:
                    best, last, free = gain, one, point
                continue
            gain -= worth[other][point]
            if other != one and gain > gained.get(other, -np.inf) + ROUNDING:
                gained[other], robbed[other] = gain, (one, point)
                waiting.append(other)
                if gain > best:
                    best, last, free = gain, other, None
    if free is not None:
        holder[free] = last
    while last != newcomer:
        last, point = robbed[last]
        holder[point] = last


IMPOSSIBLE = -1e6  # log odds


class GHOSTS_EXPECTED:
    """What is assumed of a frame's ghosts and hidden markers before it is seen."""

    # ghosts in a cube of one radius
    density: float = 0.01  # measured: half or twice loses 2 % of walks learned from still trials
    # points more than markers that are nothing unusual
    max_usual: int = 3  # measured: half loses 2 % of other people's plates
    crowd_cubes: float = 15.0  # such cubes that the points beyond are in; physical: about a body that more of is marked
    hidden_chance: float = 0.25  # that a marker is hidden; paper: about 4 of 15 (partial solvers, table 3)


@dataclass(frozen=True, eq=False)
class Settled:
    """N namings and what follows from them."""

    points: np.ndarray  # (N, P, 3) m in the model's frame
    present: np.ndarray  # (N, P)
    worth: np.ndarray  # (N,) what a name is worth beside its density, as `name_worth`
    naming: np.ndarray  # (N, M) index of the point, NO_POINT where hidden
    score: np.ndarray  # (N,) log likelihood ratio against all points being ghosts and all markers hidden
    size: np.ndarray  # (N,) of the subject, as the distance constraints say; 1 is the mean
    expected: np.ndarray  # (N, M, 3) m, each marker's mean given all named points
    left: np.ndarray  # (N, M, 3) m, named point minus expected; 0 where hidden
    # (N, M, 3, L) m, half of the expected positions' covariance without the markers' own noise, see `shared_of`
    spread: np.ndarray

    @property
    def named(self) -> np.ndarray:
        """(N, M) True where a marker has a point."""
        return self.naming >= 0


def settle(
    model: Latent,
    constraints: DistanceConstraints,
    points: np.ndarray,
    present: np.ndarray,
    naming: np.ndarray,
    worth: np.ndarray | None = None,
) -> Settled:
    """What follows from namings (N, M) of points (N, P, 3) m that are nearly in the model's frame.

    `worth` (N,) is what a name is worth in their frames, where that is known.
    """
    if worth is None:
        worth = name_worth(model, present)
    points, *rest = settled(model, constraints, points, naming, worth)
    return Settled(points, present, worth, naming, *rest)


@stands_for(point_calls.settled)
def settled(model: Latent, constraints: DistanceConstraints, points, naming, worth) -> tuple[np.ndarray, ...]:
    """Of `Settled` points, score, size, expected, left and spread."""
    points, left, latent, inverse, score = _weighed(model, points, worth, naming)
    size, fit = size_and_fit(constraints, points, naming)
    spread = (model.flat @ inverse.swapaxes(1, 2)).reshape(*left.shape, -1)
    return points, score + fit, size, model.positions(latent), left, spread


@stands_for(point_calls.score_of)
def score_of(
    model: Latent, constraints: DistanceConstraints, points: np.ndarray, worth: np.ndarray, naming: np.ndarray
) -> np.ndarray:
    """(N,) the score alone, as `settle` gives it."""
    points, _, _, _, score = _weighed(model, points, worth, naming)
    return score + size_and_fit(constraints, points, naming)[1]


@stands_for(point_calls.expected_of)
def expected_of(
    model: Latent, points: np.ndarray, naming: np.ndarray, markers: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What namings (N, M) of points (N, P, 3) m nearly in the model's frame say of some markers (B,), and no more.

    The points in it, (N, P, 3) m, where the markers are expected, (N, B, 3) m, and the covariance of that,
    (N, 3 B, 3 B) m², without the markers' own noise; as `settle` has them.
    """
    points, _, latent, inverse, _ = _explained(model, points, naming)
    own = model.columns[markers].reshape(-1, model.size)
    expected = model.mean[markers] + (latent @ own.T).reshape(len(latent), -1, 3)
    half = own @ inverse.swapaxes(1, 2)
    return points, expected, shared_of(half, half)


def _explained(model: Latent, points: np.ndarray, naming: np.ndarray):
    """Points with the yaw taken up, the named ones' offsets from the mean, and latent vectors.

    And the inverse of their precision's lower factor, whose diagonal comes last.
    """
    lower = np.linalg.cholesky(model.normal((naming >= 0) / model.noise))
    inverse = np.linalg.inv(lower)
    points, _ = yaw_absorbed(points, _latent(model, points, naming, inverse)[1], model.yaw_sd)
    return points, *_latent(model, points, naming, inverse), inverse, np.einsum("nii->ni", lower)


def _weighed(model: Latent, points: np.ndarray, worth: np.ndarray, naming: np.ndarray):
    """Points with the yaw taken up, what is left at the named ones, latent vectors, half of their covariance, score."""
    named = naming >= 0
    points, offset, latent, inverse, roots = _explained(model, points, naming)
    left = np.where(named[..., None], offset + model.mean - model.positions(latent), 0)
    # The same as the offsets' own square less what the latent vectors explain, without the difference of large numbers.
    square = (left**2 / model.noise[:, None]).sum(axis=(1, 2)) + (latent**2).sum(axis=1)
    spread = 2 * np.log(roots).sum(axis=1) + named @ (3 * np.log(model.noise))
    score = -0.5 * (square + spread) + named.sum(axis=1) * worth
    return points, left, latent, inverse, score


def _latent(model: Latent, points: np.ndarray, naming: np.ndarray, inverse: np.ndarray):
    """Offsets of the named points from the mean (N, M, 3) and the latent vectors (N, L) that they make."""
    offset = np.where((naming >= 0)[..., None], picked(points, naming) - model.mean, 0)
    side = model.right_side(offset / model.noise[:, None])
    return offset, (inverse.swapaxes(1, 2) @ (inverse @ side[..., None]))[..., 0]


def picked(points: np.ndarray, naming: np.ndarray) -> np.ndarray:
    """(N, M, 3) the points named; the first point where none is."""
    return points[np.arange(len(points))[:, None], np.maximum(naming, 0)]


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


def shared_of(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(..., 3, 3) m², what two markers' expected positions share, of the halves (..., 3, L) that `Settled` keeps."""
    return one @ other.swapaxes(-1, -2)


def inverse3(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse and determinant of symmetric matrices (..., 3, 3); many times faster than the general routine."""
    a, b, c = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 0, 2]
    d, e, f = matrix[..., 1, 1], matrix[..., 1, 2], matrix[..., 2, 2]
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    dd, ee, ff = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * aa + b * bb + c * cc
    rows = np.stack([aa, bb, cc, bb, dd, ee, cc, ee, ff], axis=-1) / determinant[..., None]
    return rows.reshape(matrix.shape), determinant


@stands_for(point_calls.name_odds)
def name_odds(model: Latent, constraints: DistanceConstraints, settled: Settled) -> np.ndarray:
    """(N, M, P) log odds that a point is a marker rather than a ghost, given all named points but the marker's own."""
    return odds_given(model, settled, pulls(constraints, settled.points, settled.naming, settled.size))


def odds_given(model: Latent, settled: Settled, pulled: np.ndarray) -> np.ndarray:
    """The same where it is known what the distance constraints say (N, M, P)."""
    named = settled.named[..., None, None]
    noise = model.noise[:, None, None]
    shared = shared_of(settled.spread, settled.spread)
    # What the marker's own point says is taken out again; for Gaussians that is exact.
    own, _ = inverse3(noise * np.eye(3) - np.where(named, shared, 0))
    variance = np.where(named, noise**2 * own, shared + noise * np.eye(3))
    without = settled.expected - np.where(named, shared @ own @ settled.left[..., None], 0)[..., 0]
    between = settled.points[:, None] - without[:, :, None]
    odds = density_odds(settled.worth[:, None, None], variance, between, settled.present[:, None])
    return odds + pulled


def density_odds(worth: np.ndarray, variance, between, present) -> np.ndarray:
    """Log odds (..., P) of points `between` (..., P, 3) m off where markers of variance (..., 3, 3) are expected."""
    precision, determinant = inverse3(variance)
    square = ((between @ precision) * between).sum(axis=-1)
    return np.where(present, worth - 0.5 * (np.log(determinant)[..., None] + square), IMPOSSIBLE)


def one_to_one(odds: np.ndarray) -> np.ndarray:
    """The naming (N, M) of highest total odds (N, M, P); nothing is named at odds below 0."""
    naming = np.where(odds.max(axis=2) > 0, odds.argmax(axis=2), NO_POINT)
    order = np.sort(naming, axis=1)
    twice = ((order[:, 1:] == order[:, :-1]) & (order[:, 1:] != NO_POINT)).any(axis=1)
    for row in np.flatnonzero(twice):
        naming[row] = assigned(odds[row])
    return naming


def names_of_points(naming: np.ndarray, count: int) -> np.ndarray:
    """(N, P) the marker of every point, -1 where none, of namings (N, M)."""
    names = np.full((len(naming), count + 1), -1)
    rows = np.broadcast_to(np.arange(len(naming))[:, None], naming.shape)
    names[rows, np.where(naming >= 0, naming, count)] = np.where(naming >= 0, np.arange(naming.shape[1]), -1)
    return names[:, :count]


def rows_of(data, rows: np.ndarray):
    """The same dataclass of arrays with these rows only."""
    return type(data)(*(getattr(data, name)[rows] for name in data.__dataclass_fields__))


def put_rows(data, other, rows: np.ndarray):
    """Writes the rows of `other` over these rows of `data`, in place."""
    for name in data.__dataclass_fields__:
        getattr(data, name)[rows] = getattr(other, name)
