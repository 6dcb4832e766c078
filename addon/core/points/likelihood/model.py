# SPDX-License-Identifier: GPL-3.0-or-later
"""What is learned from labelled takes to name anonymous points: plain arrays, and the same made ready for use."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..rigid_bodies.model import RigidBodies
from .distances import DistanceConstraints
from .latent import Latent
from .limbs import limb_exchanges
from .shape import Shape
from .starts import COARSE_MODES


@dataclass(frozen=True, eq=False)
class Calibration:
    """How margins become chances, measured on subjects that were left out of the training.

    weights  logit of the chance to be right, for each of `trust.features`
    rates    (K,) ascending parts of labels that are right
    least    (S, K) the least log odds of labels of which that part is right, for frames of each of the S kinds of
             `trust.kinds`; beyond all odds where no labels are
    """

    weights: np.ndarray
    rates: np.ndarray
    least: np.ndarray

    def rate(self, odds: np.ndarray, kind: np.ndarray) -> np.ndarray:
        """(N,) the part that is right of all labels with at least such log odds (N,) in frames of that kind (N,)."""
        found = np.zeros(len(odds))
        for index, least in enumerate(self.least):
            mine = kind == index
            place = np.searchsorted(least, odds[mine], side="right") - 1
            found[mine] = np.where(place >= 0, self.rates[np.maximum(place, 0)], 0)
        return found


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Everything that naming points takes.

    markers   M names
    shape     of the whole upright cloud
    distance constraints      distances that stay
    calibration     what margins are worth
    subjects  how many subjects it was learned from
    rigid bodies    the rigid groups of a set that has most of its markers on such; None for others
    """

    markers: tuple[str, ...]
    shape: Shape
    constraints: DistanceConstraints
    calibration: Calibration
    subjects: int
    rigid_bodies: RigidBodies | None = None

    def __len__(self) -> int:
        return len(self.markers)

    @cached_property
    def known(self) -> "Known":
        """The same made ready for use."""
        return Known.of(self.markers, self.shape, self.constraints, self.rigid_bodies)


@dataclass(frozen=True, eq=False)
class Known:
    """What frames are solved with.

    coarse, fine  the shape with few modes, for the first steps from nothing, and with all
    distance constraints, rigid bodies  as in `Likelihood`
    exchanges     (X, M) limbs that may be taken for the other side's, as `limbs.limb_exchanges` has them
    """

    coarse: Latent
    fine: Latent
    constraints: DistanceConstraints
    rigid_bodies: RigidBodies | None
    exchanges: np.ndarray

    @classmethod
    def of(
        cls, markers: tuple[str, ...], shape: Shape, constraints: DistanceConstraints, rigid_bodies: RigidBodies | None
    ) -> "Known":
        """Everything made ready."""
        return cls(
            Latent(shape, COARSE_MODES), Latent(shape), constraints, rigid_bodies, limb_exchanges(markers, shape.mean)
        )
