# SPDX-License-Identifier: GPL-3.0-or-later
"""What is learned from labelled takes to name anonymous points, made ready for use, and what its margins are worth.

From margins to chances it is a logistic regression over labels given to subjects who were left out of the training.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...body.sides import limb_exchanges, mirror_order
from ..rigid_bodies.model import RigidBodies
from .distances import DistanceConstraints
from .shape import Latent, Shape
from .sides import NO_SIDES, Sides
from .starts import COARSE_MODES


class CALIBRATION:
    """How the chance of a label is learned from its margin, log odds, and its frame."""

    # margins at which the line may bend
    knees: tuple[float, ...] = (0.0, 2.0, 5.0)  # format: a model file has a weight for each
    # parts wrong between which the kept rates lie, by even ratios: where wrong labels are
    error_range: tuple[float, float] = (1e-5, 0.3)  # format
    # parts of the markers that are named, between which frames are of one kind
    kind_bounds: tuple[float, ...] = (0.7, 0.87)  # format: a row for each kind


LEVELS = 200  # rates whose least log odds are kept, in a model file
MAX_MARGIN = 12.0  # margins beyond are taken for this: trials are too few to tell more
MAX_LOG_ODDS = 30.0  # of a chance, beyond which numbers have no room
RIDGE = 1e-2  # pull of the weights towards 0, so that trials without an error have a finite answer
CALIBRATION_ROUNDS = 30  # Newton steps; a few are enough
FEATURES = 6 + len(CALIBRATION.knees)
FRAME_KINDS = len(CALIBRATION.kind_bounds) + 1
UNNAMED_FEATURE = FEATURES - 2  # the feature that is the part of the markers without a name
NEVER = 100.0  # log odds that no label has


@dataclass(frozen=True, eq=False)
class Calibration:
    """How margins become chances, measured on subjects that were left out of the training."""

    weights: np.ndarray  # logit of the chance to be right, for each of `features`
    rates: np.ndarray  # (K,) ascending parts of labels that are right
    # (FRAME_KINDS, K) the least log odds of labels of which that part is right, for frames of each of the `kinds`;
    # beyond all odds where no labels are
    least: np.ndarray

    def rate(self, odds: np.ndarray, kind: np.ndarray) -> np.ndarray:
        """(N,) the part that is right of all labels with at least such log odds (N,) in frames of that kind (N,)."""
        found = np.zeros(len(odds))
        for index, least in enumerate(self.least):
            mine = kind == index
            place = np.searchsorted(least, odds[mine], side="right") - 1
            found[mine] = np.where(place >= 0, self.rates[np.maximum(place, 0)], 0)
        return found


def features(margin: np.ndarray, ghosts: np.ndarray, named: np.ndarray, mean_square: np.ndarray) -> np.ndarray:
    """(N, FEATURES) what the chance of N labels depends on.

    margin (N,) as in `solving.Solved`; of the label's frame, the number of points left unnamed `ghosts`, the part of
    all markers `named`, and `mean_square` as in `solving.Solved`.
    """
    margin = np.clip(margin, -MAX_MARGIN, MAX_MARGIN)
    bent = [np.minimum(margin - knee, 0) for knee in CALIBRATION.knees]
    return np.stack(
        [
            np.ones(len(margin)),
            margin,
            *bent,
            np.minimum(ghosts, 4),
            np.log1p(ghosts),
            1 - named,
            np.log(mean_square + 0.1),
        ],
        axis=1,
    )


def log_odds(weights: np.ndarray, described: np.ndarray) -> np.ndarray:
    """(N,) the log odds that labels described by `features` are right."""
    return np.clip(described @ weights, -MAX_LOG_ODDS, MAX_LOG_ODDS)


def chance(odds: np.ndarray) -> np.ndarray:
    """(N,) the chance of log odds (N,)."""
    return 1 / (1 + np.exp(-np.clip(odds, -MAX_LOG_ODDS, MAX_LOG_ODDS)))


def kinds(described: np.ndarray) -> np.ndarray:
    """(N,) the kind of frame of labels described (N, FEATURES): the more markers are named, the higher."""
    return np.searchsorted(CALIBRATION.kind_bounds, 1 - described[:, UNNAMED_FEATURE] + 1e-9, side="right")


def learn_calibration(described: np.ndarray, right: np.ndarray, usual: np.ndarray) -> Calibration:
    """The calibration by labels described (N, FEATURES) that are known to be right or not (N,).

    All teach what the chance depends on; what part of the labels is right is counted among the usual ones (N,), each
    kind of frame on its own: else the many labels of easy frames would pay for wrong ones in hard frames.
    """
    weights = _logistic(described, right)
    described, right = described[usual], right[usual]
    odds, kind = log_odds(weights, described), kinds(described)
    rates = 1 - np.geomspace(*CALIBRATION.error_range, LEVELS)[::-1]
    least = []
    for index in range(FRAME_KINDS):
        mine = kind == index if (kind == index).any() else np.ones(len(kind), dtype=bool)
        least.append(_least(odds[mine], right[mine], rates, extra_wrong=1))
    return Calibration(weights, rates, np.array(least))


def raised(calibration: Calibration, odds: np.ndarray, right: np.ndarray) -> Calibration:
    """The calibration asking for more where labels of such log odds (N,), tried elsewhere, were right (N,) less often.

    It never asks for less: few trials without a wrong label promise nothing.
    """
    if not len(odds):
        return calibration
    own = _least(odds, right, calibration.rates)
    # Where all of them may be accepted, so may those that are less sure than any of them, as far as was known before.
    own = np.where(own > odds.min(), own, -np.inf)
    return replace(calibration, least=np.maximum(calibration.least, own))


def _least(odds: np.ndarray, right: np.ndarray, rates: np.ndarray, extra_wrong: int = 0) -> np.ndarray:
    """(K,) the least log odds of labels of which the parts `rates` (K,) are right; NEVER where none are.

    `extra_wrong` labels are added to those that are wrong, so that few trials promise little.
    """
    order = np.argsort(-odds)
    count = np.arange(1, len(order) + 1)
    wrong = np.cumsum(~right[order]) + extra_wrong * count / len(order)
    # Accepting less must never look worse than accepting more.
    reached = np.maximum.accumulate((1 - wrong / count)[::-1])[::-1]
    last = np.searchsorted(-reached, -rates, side="right") - 1
    return np.where(last >= 0, odds[order][np.maximum(last, 0)], NEVER)


def _logistic(described: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Weights by Newton's method with a small ridge."""
    weights = np.zeros(described.shape[1])
    for _ in range(CALIBRATION_ROUNDS):
        expected = chance(log_odds(weights, described))
        curve = (described * (expected * (1 - expected))[:, None]).T @ described
        slope = described.T @ (right - expected) - RIDGE * weights
        step = np.linalg.solve(curve + RIDGE * np.eye(len(weights)), slope)
        weights = weights + step * min(1.0, 5.0 / np.abs(step).max())
        if np.abs(step).max() < 1e-6:
            break
    return weights


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Everything that naming points takes."""

    markers: tuple[str, ...]  # M names
    shape: Shape  # of the whole upright cloud
    constraints: DistanceConstraints  # distances that stay
    calibration: Calibration  # what margins are worth
    subjects: int  # how many subjects it was learned from
    rigid_bodies: RigidBodies | None = None  # of a set that has most of its markers on such; None for others
    sides: Sides = NO_SIDES  # on which side of others markers are; none of a model of before these were learned

    def __len__(self) -> int:
        return len(self.markers)

    @cached_property
    def known(self) -> "Known":
        """The same made ready for use."""
        return Known.of(self.markers, self.shape, self.constraints, self.rigid_bodies)


@dataclass(frozen=True, eq=False)
class Known:
    """What frames are solved with."""

    # the shape with few modes, for the first steps from nothing, and with all
    coarse: Latent
    fine: Latent
    # as in `Likelihood`
    constraints: DistanceConstraints
    rigid_bodies: RigidBodies | None
    exchanges: np.ndarray  # (X, M) limbs that may be taken for the other side's, as `limb_exchanges` has them

    @classmethod
    def of(
        cls, markers: tuple[str, ...], shape: Shape, constraints: DistanceConstraints, rigid_bodies: RigidBodies | None
    ) -> "Known":
        """Everything made ready."""
        return cls(
            Latent(shape, COARSE_MODES),
            Latent(shape),
            constraints,
            rigid_bodies,
            limb_exchanges(mirror_order(markers), shape.mean),
        )
