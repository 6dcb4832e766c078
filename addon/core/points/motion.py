# SPDX-License-Identifier: GPL-3.0-or-later
"""From named points to a moving body."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..body.posing import POSING, fit_points
from ..data.markersets import MarkerSet
from ..data.takes import LabelledChunk, Labels, Motion, Points

NO_PLACES: Mapping[tuple[int, int], np.ndarray] = MappingProxyType({})


def motion_of(
    points: np.ndarray,
    residual: np.ndarray,
    labels: Labels,
    markerset: MarkerSet,
    frames: np.ndarray,
    progress: Callable[[float], None] | None = None,
    places: Mapping[tuple[int, int], np.ndarray] = NO_PLACES,
) -> Motion:
    """The named markers and the body posed on them.

    points (T, P, 3) m and residual (T, P) m with their labels (T, P); frames (T,) the source's numbers. `places` are
    markers that a person placed, by frame index and marker, (3,) m: their residual is 0, as nobody measured them.
    `progress` is told the share that is done.
    """
    count, size = len(points), len(markerset)
    xyz, off = labels.placed(points, size), np.full((count, size), np.nan)
    named = labels.named
    frame, column = np.nonzero(named)
    marker = labels.marker[frame, column]
    off[frame, marker] = residual[frame, column]
    for at, place in places.items():
        xyz[at], off[at] = place, 0.0
    model = BodyModel(markerset)
    if (np.isfinite(xyz[..., 0]).sum(axis=1) >= POSING.min_markers).any():
        bodies = fit_points(model, xyz, progress=progress)
    else:
        nobody = model.rest(count, 1.0)
        bodies = replace(nobody, translation=np.full_like(nobody.translation, np.nan))
    found = np.isfinite(bodies.translation).all(axis=1)
    expected, joints, turns, scale = _posed(model, bodies, found)
    mean = np.where(named, labels.confidence, 0).sum(axis=1) / np.maximum(named.sum(axis=1), 1)
    nothing, conflicts = np.full((count, size), np.nan), np.zeros((count, size), int)
    confidence = np.where(found, mean, 0.0)
    return Motion(frames, xyz, off, nothing, conflicts, expected, joints, turns, scale, confidence)


def _posed(model: BodyModel, bodies: Bodies, found: np.ndarray, at_once: int = 2000) -> tuple[np.ndarray, ...]:
    """Expected markers, joints, rotations and scale of all frames, `at_once` posed at a time; NaN where nobody was."""
    count, joints = len(found), model.joint_count
    shapes = ((model.marker_count, 3), (joints, 3), (joints, 3, 3), (3,))
    whole = [np.full((count, *shape), np.nan) for shape in shapes]
    at = np.flatnonzero(found)
    for first in range(0, len(at), at_once):
        frames = at[first : first + at_once]
        posed = model.pose(bodies.pick(frames))
        values = (posed.markers, posed.joints, posed.rotations, bodies.scale[frames])
        for array, value in zip(whole, values, strict=True):
            array[frames] = value
    return tuple(whole)


def labelled_points(take: Points, labelled: LabelledChunk, markerset: MarkerSet) -> Points:
    """A labelled take as points: the model's markers in its order, then what stays unlabelled."""
    motion = labelled.motion
    left = take.present & ~labelled.labels.named
    columns = np.flatnonzero(left.any(axis=0))
    rest = np.where(left[:, columns, None], take.xyz[:, columns], np.nan)
    residual = np.where(left[:, columns], take.residual[:, columns], np.nan)
    names = (*markerset.markers, *[""] * len(columns))
    xyz = np.concatenate([motion.markers, rest], axis=1)
    return Points(names, xyz, np.concatenate([motion.residual, residual], axis=1), take.rate, take.first_frame)
