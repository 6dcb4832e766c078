# SPDX-License-Identifier: GPL-3.0-or-later
"""What another armature needs of a take to move as its body does."""

from dataclasses import dataclass, field

import numpy as np

from ..filling.ground import settled
from ..posing.character import Character, character_of


@dataclass(frozen=True, eq=False)
class Moving:
    """The body of a take as it was posed.

    rate    Hz, and of what smooths it `cutoff`, None where it is not smoothed
    segments, parents  of its J joints, -1 for the root
    begins, ends  (J, 3) m where the bones of its own armature begin and end at rest
    frames  (F,) Blender's
    joints, rotations  (F, J, 3) m and (F, J, 3, 3), NaN where nobody was found
    place    (4, 4) from the room to where it is shown: turned, moved and evenly scaled
    """

    name: str
    rate: float
    cutoff: float | None
    segments: tuple[str, ...]
    parents: tuple[int, ...]
    begins: np.ndarray
    ends: np.ndarray
    frames: np.ndarray
    joints: np.ndarray
    rotations: np.ndarray
    place: np.ndarray = field(default_factory=lambda: np.eye(4))

    @property
    def size(self) -> float:
        """How much larger it is shown."""
        return float(np.linalg.norm(self.place[:3, 0]))

    @property
    def character(self) -> Character:
        """Its character; InputError where the body is no person's."""
        return character_of(self.segments, self.size * self.begins, self.size * self.ends)

    def settled(self) -> tuple[np.ndarray, np.ndarray]:
        """Joints (F, J, 3) m and rotations (F, J, 3, 3) as they are shown: with planted feet, and smoothed."""
        pose = self.joints, self.rotations, self.segments, self.parents
        joints, rotations = settled(*pose, self.ends - self.begins, self.rate, self.cutoff)
        turn, way = self.place[:3, :3], self.place[:3, 3]
        return joints @ turn.T + way, turn / self.size @ rotations
