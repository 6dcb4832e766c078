# SPDX-License-Identifier: GPL-3.0-or-later
"""Which frame of a labelled take to show, and what the picture needs of it."""

import numpy as np

from ..blendfile import Chunks
from ..core.data.markersets import MarkerSet
from ..core.data.takes import Motion
from ..core.geometry.cameras import Cameras
from .picture import Body, Shot


def best_shot(cameras: Cameras, markerset: MarkerSet, chunks: Chunks) -> tuple[int, Shot]:
    """The frame with the most markers, of those the one with the widest step; its number and its picture.

    Raises ValueError when no frame has a body.
    """
    best, score = None, -1.0
    for blobs, chunk in chunks:
        scores = _scores(chunk.motion)
        if len(scores) and scores.max() > score:
            best, score = (blobs, chunk, int(np.argmax(scores))), float(scores.max())
    if best is None:
        raise ValueError("nobody was found in any frame")
    blobs, chunk, index = best
    rows = np.flatnonzero(blobs.frame == index)
    motion, labels = chunk.motion, chunk.labels
    ahead = motion.rotations[index, 0, :, 0]
    shot = Shot(
        cameras,
        markerset,
        posed_capsules(markerset, motion, index),
        motion.markers[index],
        float(np.arctan2(ahead[1], ahead[0])),
        blobs.camera[rows],
        blobs.xy[rows],
        labels.marker[rows],
        labels.step[rows],
    )
    return int(blobs.frames[index]), shot


def _scores(motion: Motion) -> np.ndarray:
    """(F,) markers seen, and for a tie how far they are from the body's middle, ahead and behind; -1 for nobody."""
    seen = np.isfinite(motion.markers).all(axis=2)
    away = motion.expected - motion.expected.mean(axis=1, keepdims=True)
    reach = np.abs(np.einsum("fmi,fi->fm", away, motion.rotations[:, 0, :, 0])).mean(axis=1)
    return np.where(motion.confidence > 0, seen.sum(axis=1) + np.minimum(np.nan_to_num(reach), 0.99), -1.0)


def posed_capsules(markerset: MarkerSet, motion: Motion, index: int) -> Body:
    """The body's capsules in one frame, in the world."""
    capsules = markerset.capsules
    turn, joints = motion.rotations[index, capsules.segment], motion.joints[index, capsules.segment]
    scale = motion.scale[index]

    def placed(points: np.ndarray) -> np.ndarray:
        return joints + (turn @ (points * scale)[..., None])[..., 0]

    return Body(placed(capsules.start), placed(capsules.end), capsules.radius * scale.mean())
