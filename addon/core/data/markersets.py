# SPDX-License-Identifier: GPL-3.0-or-later
"""Marker sets: a skeleton, the markers on it, a capsule body around it, and how all of that varies over people.

Lengths are in units of the subject's height: 1 is from the floor to the top of the head. In the rest pose every
segment's own axes are those of the model: x forward, y left, z up, origin on the floor below the root joint.

A `Layout` is a marker set in words: which marker sits where on which segment.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class Site:
    """Where a marker sits."""

    segment: str  # of the body, such as thigh.L
    place: str  # a landmark of the segment; or one or two sides of the segment with a space between, and `along`
    along: float | None = None  # from the segment's own joint, 0, to the next, 1; None at a landmark
    side: str = ""  # L or R of a landmark that a segment in the middle has on both sides; empty for none
    off_m: float = 0.0  # m, from the skin to the marker, as on a wand; format: most markers are on the skin


@dataclass(frozen=True, eq=False)
class Layout:
    """A marker set in words."""

    name: str  # for people to read, as the next two
    description: str
    source: str  # who has published it
    sites: Mapping[str, Site]  # where each marker sits, in the order of everything that is written


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of J segments; each turns about the joint at its near end."""

    segments: tuple[str, ...]  # J names, parents before children; the first is the root
    parents: np.ndarray  # (J,) index of the parent, -1 for the root
    # (J, 3) the joint in its parent's axes at rest; for the root, its position above the floor's origin
    offsets: np.ndarray

    def __len__(self) -> int:
        return len(self.segments)

    @cached_property
    def rest_joints(self) -> np.ndarray:
        """(J, 3) joint positions in the rest pose, model axes, heights."""
        joints = np.array(self.offsets, dtype=float)
        for index, parent in enumerate(self.parents):
            if parent >= 0:
                joints[index] += joints[parent]
        return joints

    @cached_property
    def limbs(self) -> np.ndarray:
        """(J,) the segment nearest to the trunk of the limb that each belongs to; -1 for trunk and head."""
        limb = np.full(len(self), -1)
        for index, (name, parent) in enumerate(zip(self.segments, self.parents, strict=True)):
            if parent >= 0 and limb[parent] >= 0:
                limb[index] = limb[parent]
            elif name.endswith((".L", ".R")):
                limb[index] = index
        return limb

    @cached_property
    def carries(self) -> np.ndarray:
        """(J, J) True where turning joint j moves segment i: carries[i, j], j an ancestor of i or i itself."""
        chain = np.eye(len(self), dtype=bool)
        for index, parent in enumerate(self.parents):
            if parent >= 0:
                chain[index] |= chain[parent]
        return chain


@dataclass(frozen=True, eq=False)
class Capsules:
    """K capsules, each fixed to a segment: the volume within `radius` of the line from `start` to `end`.

    segment (K,) index; start, end (K, 3) in the segment's axes from its joint, heights; radius (K,) heights
    """

    segment: np.ndarray
    start: np.ndarray
    end: np.ndarray
    radius: np.ndarray

    def __len__(self) -> int:
        return len(self.segment)


@dataclass(frozen=True, eq=False)
class Spread:
    """How people differ from the mean of the marker set, in shape and in pose."""

    height: float  # mean stature, m
    height_sd: float  # its standard deviation, m
    # (K, J + M, 3) change of joint offsets then marker offsets for one standard deviation of each of the K main ways
    # in which bodies and marker placements differ, heights
    modes: np.ndarray
    marker_sd: np.ndarray  # (M,) what the modes leave over, marker by marker, heights
    pose_mean: np.ndarray  # (J, 3) mean rotation vector of each joint over the recorded motion; the root's is zero
    pose_covariance: np.ndarray  # (3J, 3J) its covariance, rad²; the root's rows and columns are zero
    # (P, J, 3) rotation vectors of the joints in the most different poses that were recorded, of the root how it
    # leans against upright and facing along x; none where they were not kept
    poses: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3)))
    # (3J, 3J) further precision of the bends, 1/rad², of axes that no marker shows a turn about; None where all do
    stiffness: np.ndarray | None = None


class Worn(Protocol):
    """The markers of a take: those of one set, or of several subjects side by side, as `MarkerSet` has them."""

    @property
    def markers(self) -> tuple[str, ...]:
        """Their names."""

    @property
    def by_name(self) -> dict[str, int]:
        """The index of each by its name, and by its aliases."""

    @property
    def worn(self) -> "tuple[tuple[str, MarkerSet], ...]":
        """Who wears them by name, and the set of each."""

    def __len__(self) -> int:
        """How many there are."""


@dataclass(frozen=True, eq=False)
class MarkerSet:
    """Everything that is known before a take is seen.

    name, description  for people to read
    markers            M names, in the order of everything that is written
    aliases            other names of a marker: {alias: name}
    skeleton           the tree of segments
    attachment         (M,) the segment that carries each marker
    offsets            (M, 3) the marker in that segment's axes from its joint, heights
    capsules           the body
    spread             variation over people and poses
    source             where the numbers come from: people, dates, counts (free text by key)
    """

    name: str
    description: str
    markers: tuple[str, ...]
    aliases: dict[str, str]
    skeleton: Skeleton
    attachment: np.ndarray
    offsets: np.ndarray
    capsules: Capsules
    spread: Spread
    source: dict[str, str]

    def __len__(self) -> int:
        return len(self.markers)

    @property
    def worn(self) -> tuple[tuple[str, "MarkerSet"], ...]:
        """Who wears it by name, and what each wears: one, who needs no name in a take of one."""
        return (("", self),)

    @cached_property
    def rest_markers(self) -> np.ndarray:
        """(M, 3) marker positions in the rest pose, model axes, heights: the paper's normalised model, X_j."""
        return self.skeleton.rest_joints[self.attachment] + self.offsets

    @cached_property
    def by_name(self) -> dict[str, int]:
        """The index of each marker by its name, and by its aliases."""
        own = {name: index for index, name in enumerate(self.markers)}
        return {alias: own[name] for alias, name in self.aliases.items() if name in own} | own

    def index(self, name: str) -> int:
        """Index of a marker by name or alias; KeyError when it has neither."""
        name = self.aliases.get(name, name)
        try:
            return self.markers.index(name)
        except ValueError:
            raise KeyError(name) from None
