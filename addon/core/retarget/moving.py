# SPDX-License-Identifier: GPL-3.0-or-later
"""What another armature needs of a take to move as its body does."""

from dataclasses import dataclass, field, replace

import numpy as np

from ..filling.ground import settled
from ..geometry.rotations import carried
from ..posing.character import Character, character_of, toes_of


@dataclass(frozen=True, eq=False)
class Moving:
    """The body of a take as it was posed."""

    name: str
    rate: float  # Hz, and of what smooths it `cutoff`, None where it is not smoothed
    cutoff: float | None
    # of its J joints, -1 for the root
    segments: tuple[str, ...]
    parents: tuple[int, ...]
    # (J, 3) m where the bones of its own armature begin and end at rest
    begins: np.ndarray
    ends: np.ndarray
    frames: np.ndarray  # (F,) Blender's
    # (F, J, 3) m and (F, J, 3, 3), NaN where nobody was found
    joints: np.ndarray
    rotations: np.ndarray
    # (4, 4) from the room to where it is shown: turned, moved and evenly scaled
    place: np.ndarray = field(default_factory=lambda: np.eye(4))

    def with_toes(self) -> "Moving":
        """The same with toes on feet that have none, as in takes of earlier versions.

        They are as the feet are until the floor bends them.
        """
        feet = [at for at, name in enumerate(self.segments) if name.startswith("foot.") and at not in self.parents]
        balls, tips = toes_of((self.ends - self.begins)[feet])
        ends, begins = self.ends.copy(), self.begins[feet] + balls
        ends[feet] = begins
        ways = carried(self.rotations[:, feet], balls)
        return replace(
            self,
            segments=(*self.segments, *(f"toes.{self.segments[foot][-1]}" for foot in feet)),
            parents=(*self.parents, *feet),
            begins=np.concatenate([self.begins, begins]),
            ends=np.concatenate([ends, self.begins[feet] + tips]),
            joints=np.concatenate([self.joints, self.joints[:, feet] + ways], axis=1),
            rotations=np.concatenate([self.rotations, self.rotations[:, feet]], axis=1),
        )

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
