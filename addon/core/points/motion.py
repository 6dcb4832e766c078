# SPDX-License-Identifier: GPL-3.0-or-later
"""From named points to a moving body."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..body.posing import POSING, fit_points
from ..data.markersets import MarkerSet
from ..data.takes import LabelledChunk, Labels, Motion, Points


def motion_of(
    markers: np.ndarray,
    residual: np.ndarray,
    labels: Labels,
    markerset: MarkerSet,
    frames: np.ndarray,
    progress: Callable[[float], None] | None = None,
) -> Motion:
    """The named markers and the body posed on them.

    markers (T, M, 3) m and residual (T, M) m, NaN where one is not, by the labels (T, P); frames (T,) the source's
    numbers. `progress` hears the share that is done.
    """
    count, size = markers.shape[:2]
    model = BodyModel(markerset)
    if (np.isfinite(markers[..., 0]).sum(axis=1) >= POSING.min_markers).any():
        bodies = fit_points(model, markers, progress=progress)
    else:
        nobody = model.rest(count, 1.0)
        bodies = replace(nobody, translation=np.full_like(nobody.translation, np.nan))
    found = np.isfinite(bodies.translation).all(axis=1)
    expected, joints, turns, scale = _posed(model, bodies, found)
    named = labels.named
    mean = np.where(named, labels.confidence, 0).sum(axis=1) / np.maximum(named.sum(axis=1), 1)
    nothing, conflicts = np.full((count, size), np.nan), np.zeros((count, size), int)
    confidence = np.where(found, mean, 0.0)
    return Motion(frames, markers, residual, nothing, conflicts, expected, joints, turns, scale, confidence)


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
