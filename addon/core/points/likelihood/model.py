# SPDX-License-Identifier: GPL-3.0-or-later
"""What is learned from labelled takes to name anonymous points: plain arrays, and the same made ready for use."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...body.sides import limb_exchanges, mirror_order
from ..rigid_bodies.model import RigidBodies
from .calibration import Calibration
from .distances import DistanceConstraints
from .latent import Latent
from .shape import Shape
from .starts import COARSE_MODES


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Everything that naming points takes.

    markers       M names
    shape         of the whole upright cloud
    constraints   distances that stay
    calibration   what margins are worth
    subjects      how many subjects it was learned from
    rigid_bodies  of a set that has most of its markers on such; None for others
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

    coarse, fine               the shape with few modes, for the first steps from nothing, and with all
    constraints, rigid_bodies  as in `Likelihood`
    exchanges                  (X, M) limbs that may be taken for the other side's, as `limb_exchanges` has them
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
            Latent(shape, COARSE_MODES),
            Latent(shape),
            constraints,
            rigid_bodies,
            limb_exchanges(mirror_order(markers), shape.mean),
        )
