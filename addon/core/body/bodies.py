# SPDX-License-Identifier: GPL-3.0-or-later
"""The body that is fitted: a marker set placed, scaled, bent and shaped, and how its markers move with every parameter.

The paper's nine parameters (equation 6) are this body with its joints and shape held still; freeing them is the same
fit with more columns. All functions work on a batch of B bodies of one marker set.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.markersets import MarkerSet
from ..geometry import rotations
from ..kernels import calls, stands_for

PLACEMENT = 9  # parameters of a placement, which come first


@dataclass(frozen=True, eq=False)
class Bodies:
    """B bodies."""

    translation: np.ndarray  # (B, 3) T, m
    quaternion: np.ndarray  # (B, 4) R_q, unit, w x y z
    scale: np.ndarray  # (B, 3) S, m for one unit of the marker set along the model's x y z
    bends: np.ndarray  # (B, J, 3) rotation vector of every joint against the rest pose, rad; the root's stays zero
    shape: np.ndarray  # (B, K) amount of each mode of the marker set's spread, in standard deviations
    # (B, M, 3) how far the subject's own markers sit from where the shape puts them, segment axes, heights
    own: np.ndarray

    def __len__(self) -> int:
        return len(self.translation)

    @classmethod
    def join(cls, parts: Sequence["Bodies"]) -> "Bodies":
        """Several batches as one."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))

    def pick(self, index) -> "Bodies":
        """The bodies at `index` (anything NumPy takes as an index of the first axis that keeps it)."""
        return Bodies(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    @property
    def rows(self) -> np.ndarray:
        """(B, N) all but `own` of each body in a row, as the compiled library takes them; see `BodyModel.of_rows`."""
        parts = self.translation, self.quaternion, self.scale, self.bends.reshape(len(self), -1), self.shape
        return np.concatenate(parts, axis=1)

    def moved(self, step: np.ndarray) -> "Bodies":
        """The bodies after a step (B, 9 + 3(J-1) + K): translation, turn, scale, bends but the root's, shape."""
        count, joints = len(self), self.bends.shape[1]
        bends_end = PLACEMENT + 3 * (joints - 1)
        bent = self
        if step.shape[1] > PLACEMENT:
            bends = self.bends.copy()
            bends[:, 1:] += step[:, PLACEMENT:bends_end].reshape(count, joints - 1, 3)
            bent = replace(self, bends=bends, shape=self.shape + step[:, bends_end:])
        return replace(
            bent,
            translation=self.translation + step[:, :3],
            quaternion=rotations.turned(self.quaternion, step[:, 3:6]),
            scale=self.scale + step[:, 6:9],
        )


@dataclass(frozen=True, eq=False)
class Posed:
    """Where B bodies have their parts: rotations (B, J, 3, 3), joints (B, J, 3) m and markers (B, M, 3) m, world."""

    rotations: np.ndarray
    joints: np.ndarray
    markers: np.ndarray


class BodyModel:
    """A marker set made ready for posing many bodies at once."""

    def __init__(self, markerset: MarkerSet):
        self.markerset = markerset
        skeleton = markerset.skeleton
        self.parents = np.asarray(skeleton.parents)
        self.attachment = np.asarray(markerset.attachment)
        self.joint_count, self.marker_count = len(skeleton), len(markerset)
        self.offsets = np.concatenate([skeleton.offsets, markerset.offsets])
        self.rest_parts = np.concatenate([skeleton.rest_joints, markerset.rest_markers])
        self.modes = np.asarray(markerset.spread.modes, dtype=float).reshape(
            -1, self.joint_count + self.marker_count, 3
        )
        self.parameters = PLACEMENT + 3 * (self.joint_count - 1) + len(self.modes)
        depth = np.zeros(self.joint_count, dtype=int)
        for index in range(1, self.joint_count):
            depth[index] = depth[self.parents[index]] + 1
        self.levels = [np.flatnonzero(depth == level) for level in range(1, depth.max(initial=0) + 1)]
        self.carried = np.nonzero(skeleton.carries[self.attachment][:, 1:])

    def rest(self, count: int = 1, height: float = 1.0) -> Bodies:
        """`count` bodies in the rest pose at the world's origin, `height` m tall, facing +x."""
        return Bodies(
            np.zeros((count, 3)),
            np.tile([1.0, 0, 0, 0], (count, 1)),
            np.full((count, 3), float(height)),
            np.zeros((count, self.joint_count, 3)),
            np.zeros((count, len(self.modes))),
            np.zeros((count, self.marker_count, 3)),
        )

    def of_rows(self, rows: np.ndarray, own: np.ndarray) -> Bodies:
        """The bodies of `Bodies.rows` (B, N) and their own offsets (B, M, 3)."""
        bends_end = 10 + 3 * self.joint_count
        bends = rows[:, 10:bends_end].reshape(len(rows), -1, 3)
        return Bodies(rows[:, :3], rows[:, 3:7], rows[:, 7:10], bends, rows[:, bends_end:], own)

    def shaped_offsets(self, bodies: Bodies) -> np.ndarray:
        """(B, J + M, 3) offsets of joints, then markers, of each subject, heights, before S."""
        offsets = self.offsets + np.tensordot(bodies.shape, self.modes, axes=1)
        offsets[:, self.joint_count :] += bodies.own
        return offsets

    def pose(self, bodies: Bodies) -> Posed:
        """Forward kinematics: where every segment, joint and marker of each body is."""
        return Posed(*pose(self, bodies))

    def _pose(self, bodies: Bodies, bend: np.ndarray, offsets: np.ndarray) -> Posed:
        scaled = offsets * bodies.scale[:, None, :]
        turn, joints = bend.copy(), np.empty((len(bodies), self.joint_count, 3))
        turn[:, 0] = rotations.quaternion_to_matrix(bodies.quaternion)
        joints[:, 0] = bodies.translation + rotations.carried(turn[:, 0], scaled[:, 0])
        for level in self.levels:
            above = self.parents[level]
            turn[:, level] = turn[:, above] @ bend[:, level]
            joints[:, level] = joints[:, above] + rotations.carried(turn[:, above], scaled[:, level])
        markers = joints[:, self.attachment] + rotations.carried(
            turn[:, self.attachment], scaled[:, self.joint_count :]
        )
        return Posed(turn, joints, markers)

    def derivatives(self, bodies: Bodies) -> tuple[Posed, np.ndarray]:
        """The posed bodies and d markers / d parameters (B, M, 3, P), columns in the order of `Bodies.moved`."""
        *parts, columns = derivatives(self, bodies)
        return Posed(*parts), columns

    def placement_derivatives(self, bodies: Bodies) -> tuple[Posed, np.ndarray]:
        """The same with joints and shape at rest: derivatives (B, M, 3, 9) of the paper's equation 6.

        `bodies` must be in the rest pose and of the mean shape.
        """
        turn = rotations.quaternion_to_matrix(bodies.quaternion)
        from_root = (self.rest_parts * bodies.scale[:, None, :]) @ turn.transpose(0, 2, 1)
        columns = np.empty((len(bodies), self.marker_count, 3, PLACEMENT))
        columns[..., 0:3] = np.eye(3)
        columns[..., 3:6] = -rotations.cross_matrix(from_root[:, self.joint_count :])
        columns[..., 6:9] = turn[:, None] * self.rest_parts[None, self.joint_count :, None, :]
        placed = from_root + bodies.translation[:, None]
        every = np.broadcast_to(turn[:, None], (len(bodies), self.joint_count, 3, 3))
        return Posed(every, placed[:, : self.joint_count], placed[:, self.joint_count :]), columns

    def _shape_columns(self, posed: Posed, scale: np.ndarray) -> np.ndarray:
        """(B, M, 3, K) d markers / d shape."""
        modes = self.modes.transpose(1, 2, 0)

        def part(turn, items):
            return turn @ (scale[:, None, :, None] * modes[items])

        return self._along_chain(posed.rotations, part, len(self.modes))

    def _along_chain(self, turn: np.ndarray, part, width: int) -> np.ndarray:
        """Adds up, from the root to every marker, what `part(rotations, items)` gives for each link of the chain."""
        total = np.empty((len(turn), self.joint_count, 3, width))
        total[:, 0] = part(turn[:, :1], np.arange(1))[:, 0]
        for level in self.levels:
            above = self.parents[level]
            total[:, level] = total[:, above] + part(turn[:, above], level)
        markers = np.arange(self.joint_count, self.joint_count + self.marker_count)
        return total[:, self.attachment] + part(turn[:, self.attachment], markers)

    def _bend_columns(self, posed: Posed, left: np.ndarray) -> np.ndarray:
        """(B, M, 3, 3(J-1)) d markers / d bends: a joint turns what it carries about axes through itself."""
        marker, joint = self.carried
        axes = (posed.rotations[:, self.parents[1:]] @ left[:, 1:])[:, joint]
        x, y, z = np.moveaxis(posed.markers[:, marker] - posed.joints[:, joint + 1], -1, 0)[..., None]
        columns = np.zeros((*posed.markers.shape, self.joint_count - 1, 3))
        columns[:, marker, 0, joint] = axes[..., 1, :] * z - axes[..., 2, :] * y
        columns[:, marker, 1, joint] = axes[..., 2, :] * x - axes[..., 0, :] * z
        columns[:, marker, 2, joint] = axes[..., 0, :] * y - axes[..., 1, :] * x
        return columns.reshape(*posed.markers.shape, 3 * (self.joint_count - 1))


@stands_for(calls.pose)
def pose(model: BodyModel, bodies: Bodies) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations, joints and markers of `Posed`."""
    posed = model._pose(bodies, rotations.turn_of(bodies.bends), model.shaped_offsets(bodies))
    return posed.rotations, posed.joints, posed.markers


@stands_for(calls.derivatives)
def derivatives(model: BodyModel, bodies: Bodies) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The same, and the columns of `BodyModel.derivatives`."""
    bend, left = rotations.exponential(bodies.bends)
    offsets = model.shaped_offsets(bodies)
    posed = model._pose(bodies, bend, offsets)
    columns = np.empty((len(bodies), model.marker_count, 3, model.parameters))
    bends_end = PLACEMENT + 3 * (model.joint_count - 1)
    columns[..., 0:3] = np.eye(3)
    columns[..., 3:6] = -rotations.cross_matrix(posed.markers - bodies.translation[:, None])
    # Each part of the chain stretches along its own segment's axes.
    columns[..., 6:9] = model._along_chain(posed.rotations, lambda turn, items: turn * offsets[:, items, None, :], 3)
    columns[..., PLACEMENT:bends_end] = model._bend_columns(posed, left)
    columns[..., bends_end:] = model._shape_columns(posed, bodies.scale)
    return posed.rotations, posed.joints, posed.markers, columns
